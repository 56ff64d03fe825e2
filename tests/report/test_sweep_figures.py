"""Figures of a sweep."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from butterfly.experiment.sweep_tables import Estimates
from butterfly.report.pictures import draw, write_pictures
from butterfly.report.sweep_figures import axis_figure, heat_maps
from tests.report.setting import ODD

GRID = [(1.0, 1.0), (1.0, 2.0), (2.0, 1.0), (2.0, 2.0)]


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


def test_a_map_has_each_estimate_s_worst_parameter_so_that_a_good_one_hides_none():
    rows = [(n, a, b, name) for n, (a, b) in enumerate(GRID) for name in ("p1", "p2")]
    number, across, up, parameter = zip(*rows, strict=True)
    texts = {"estimator": ["m"] * len(rows), "parameter": parameter}
    columns = {name: np.array(each, dtype=object) for name, each in texts.items()}
    columns |= {"number": np.array(number), "a": np.array(across), "b": np.array(up)}
    columns |= {"value": np.ones(len(rows)), "deviation": np.tile([0.001, -0.6], len(GRID))}
    (figure,) = heat_maps(Estimates(columns), ["a", "b"]).values()
    np.testing.assert_allclose(np.array(figure.data[0].z, dtype=float), 60.0)
