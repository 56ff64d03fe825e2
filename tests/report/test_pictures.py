"""Pictures of figures: no text is a formula, and every kind of trace is drawn."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from plotly.graph_objects import Figure, Heatmap, Scatter

from butterfly.report.pictures import draw
from tests.report.setting import ODD


def test_a_dollar_is_no_formula_wherever_it_stands():
    cells = Heatmap(x=list(ODD), y=["$", "$$"], z=np.ones((2, 3)))
    for trace in (Scatter(x=[1, 2], y=[1, 2], name=ODD[1]), cells):
        figure = Figure([trace])
        figure.update_layout(xaxis_title="$x", yaxis_title=ODD[1])
        FigureCanvasAgg(draw(figure)).draw()


def test_marks_of_a_logarithmic_axis_are_plain_numbers_in_pictures():
    figure = Figure(Scatter(x=[2, 9], y=[1e-6, 1e-5]))
    figure.update_xaxes(type="log").update_yaxes(type="log")
    still = draw(figure)
    FigureCanvasAgg(still).draw()
    (axes,) = still.axes
    texts = [label.get_text() for label in axes.get_xticklabels(which="both")]
    assert {"2", "3"} <= {*texts}
    assert all("10^" in label.get_text() for label in axes.get_yticklabels() if label.get_text())


def test_the_range_of_a_logarithmic_axis_is_the_same_in_pictures():
    figure = Figure(Scatter(x=[0, 1], y=[0.2, 0.3])).update_yaxes(type="log", range=[-1, 1])
    assert draw(figure).axes[0].get_ylim() == pytest.approx((0.1, 10.0))


def test_lines_across_a_figure_are_in_its_picture():
    figure = Figure(Scatter(x=[0, 1], y=[2, 3], mode="markers"))
    line = {"color": "#888888", "width": 1, "dash": "dash"}
    points, up = draw(figure.add_vline(x=0.5, line=line)).axes[0].lines
    assert list(points.get_xdata()) == [0, 1]
    assert list(up.get_xdata()) == [0.5, 0.5]


def test_a_band_is_filled_and_a_map_of_correlations_has_its_own_scale():
    lower = Scatter(x=[0, 1], y=[-1, -2], line={"width": 0})
    upper = Scatter(x=[0, 1], y=[1, 2], line={"width": 0}, fill="tonexty", name="band")
    (axes,) = draw(Figure([lower, upper])).axes
    assert len(axes.collections) == 1
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["band"]
    cells = Heatmap(z=[[1.0, -0.2]], x=["a", "b"], y=["c"], zmin=-1, zmax=1, showscale=False)
    still = draw(Figure(cells))
    assert len(still.axes) == 1
    assert still.axes[0].images[0].get_clim() == (-1, 1)


def test_every_kind_of_trace_has_its_picture():
    cells = Figure(Heatmap(z=[[1.0, 2.0]], x=["a", "b"], y=["c"], texttemplate="%{z}"))
    assert len(draw(cells).axes[0].texts) == 2
    filled = Scatter(x=[0, 1, 1], y=[0, 0, 1], fill="toself", fillcolor="#0072B2", opacity=0.5)
    (patch,) = draw(Figure(filled)).axes[0].patches
    assert patch.get_alpha() == 0.5
    spread = {"array": [1, 1], "arrayminus": [0.5, 0.5]}
    lines = Figure(Scatter(x=[1, 10], y=[1, 2], error_y=spread, error_x={"array": [0.1, 1]}))
    lines.update_xaxes(type="log", title="x<br>in m")
    drawn = draw(lines).axes[0]
    assert drawn.get_xscale() == "log"
    assert drawn.get_xlabel() == "x in m"
    assert len(drawn.containers[0].lines[2]) == 2  # error bars, across and up
