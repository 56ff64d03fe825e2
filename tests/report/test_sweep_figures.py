"""Figures of a sweep."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from butterfly.experiment.sweep_tables import Estimates
from butterfly.report.pictures import draw, write_pictures
from butterfly.report.sweep_figures import axis_figure
from tests.report.setting import ODD


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
