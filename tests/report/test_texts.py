"""Names are texts in every figure and page: no markup, no formulas, no scripts."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from plotly.graph_objects import Figure, Heatmap, Scatter

from butterfly.experiment.sweep_tables import Estimates
from butterfly.report.page import Marked, Page, PageTable, Section, rendered, write_page
from butterfly.report.pictures import draw, write_pictures
from butterfly.report.sweep_figures import axis_figure
from butterfly.report.sweep_page import closest
from butterfly.verdict import Level, Verdict

ODD = ("a$b", r"$\frac{$ <b>bold</b>", "<script>alert(1)</script>")


def _estimates(texts):
    count = len(texts)
    named = {"field": texts, "estimator": ["weak-form"] * count, "parameter": ["p1"] * count}
    columns = {name: np.array(each, dtype=object) for name, each in named.items()}
    numbers = {"value": np.ones(count), "deviation": np.linspace(0, 0.1, count)}
    return Estimates(columns | numbers)


def test_texts_that_vary_stand_below_the_figure_as_they_are(tmp_path):
    figure = axis_figure(_estimates(ODD), "field", ["p1"])
    assert not any("<" in text for text in figure.data[0].x)
    still = draw(figure)
    FigureCanvasAgg(still).draw()
    shown = [label.get_text().replace(r"\$", "$") for label in still.axes[0].get_xticklabels()]
    assert shown == list(ODD)
    write_pictures({"axis": figure}, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"axis.png", "axis.svg"}


def test_a_dollar_is_no_formula_wherever_it_stands():
    cells = Heatmap(x=list(ODD), y=["$", "$$"], z=np.ones((2, 3)))
    for trace in (Scatter(x=[1, 2], y=[1, 2], name=ODD[1]), cells):
        figure = Figure([trace])
        figure.update_layout(xaxis_title="$x", yaxis_title=ODD[1])
        FigureCanvasAgg(draw(figure)).draw()


def test_a_page_runs_no_text(tmp_path):
    script = ODD[-1]
    figure = Figure([Scatter(x=[script], y=[1], name=f"</script>{script}")])
    rows = [(script,), (Marked(script, "runs/x.json"),)]
    parts = {"text": script, "tables": (PageTable(headers=(script,), rows=rows, caption=script),)}
    section = Section(title=script, figures={"f": figure}, **parts)
    about = {"name": script, "description": script, "kind": "sweep", "numbers": {script: 1}}
    write_page(Page(**about, summary=[script], sections=[section]), tmp_path / "page.html")
    assert "<script>alert" not in (tmp_path / "page.html").read_text()


def _page(kind, verdict):
    about = {"name": "n", "description": "", "kind": kind, "numbers": {}, "verdict": verdict}
    return Page(**about, summary=["Said."], lead=Section(title="Lead"), sections=[])


def test_the_answer_stands_first_be_it_a_verdict_or_words():
    judged = rendered(_page("comparison", Verdict(Level.GOOD, ("p1 within 1 %.",))))
    assert judged.index("Parameters: good") < judged.index("Lead") < judged.index("Said.")
    plain = rendered(_page("change", None))
    assert plain.index("Said.") < plain.index("Lead")


def test_long_words_in_tables_may_be_broken_and_numbers_may_not():
    table = PageTable(headers=("log", "FIT"), rows=[("x" * 50, "99.6")])
    page = _page("identification", None)
    text = rendered(replace(page, sections=[Section(title="Logs", tables=(table,))]))
    assert f'<td class="long">{"x" * 50}</td><td>99.6</td>' in text


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


def test_estimates_without_intervals_have_no_coverage():
    bounds = {"lower": [0.0, 2.0, np.nan], "upper": [2.0, 3.0, np.nan], "true": [1.0, 1.0, 1.0]}
    columns = {name: np.array(values) for name, values in bounds.items()}
    assert Estimates(columns).coverage == 0.5
    assert np.isnan(Estimates({name: values[2:] for name, values in columns.items()}).coverage)


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


@pytest.mark.parametrize(
    ("shift", "named"), [(0.0, ["a", "b"]), (0.3, ["a", "b"]), (3.0, ["a"]), (-3.0, ["b"])]
)
def test_a_sweep_names_no_winner_within_noise(shift, named):
    runs = 40
    noise = np.random.default_rng(0).uniform(1, 2, (2, runs))
    deviations = np.concatenate([noise[0] + 5, noise[1] + 5 + shift * 0.1])
    table = Estimates(
        {
            "number": np.tile(np.arange(runs, dtype=float), 2),
            "estimator": np.repeat(np.array(["a", "b"], dtype=object), runs),
            "deviation": deviations * np.tile([1.0, -1.0], runs),
        }
    )
    assert sorted(closest(table)) == named
