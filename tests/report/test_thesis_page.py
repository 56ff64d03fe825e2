"""A figure of the thesis as it is drawn."""

import numpy as np

from butterfly.report.thesis_page import drawn
from butterfly.thesis.tables import ThesisFigure

TIME = np.arange(1.0, 10_001.0)


def test_many_dots_are_thinned_evenly_and_a_mark_crosses_all_curves():
    curves = {"logged": ("dots", {"t": TIME, "y": TIME**2})}
    curves["model"] = ("line", {"s": np.array([1.0, 2.0]), "z": np.array([-5.0, 3.0])})
    figure = ThesisFigure("f", "A title", ("t in s", "y"), curves, [], marks={"printed": 2.5})
    dots, line, mark = drawn(figure).data
    assert len(dots.x) <= 4000
    assert len({*np.diff(dots.x)}) == 1
    np.testing.assert_array_equal(dots.y, np.square(dots.x))
    assert (dots.mode, line.mode) == ("markers", "lines")
    assert [*line.y] == [-5.0, 3.0]
    assert ([*mark.x], [*mark.y], mark.name) == ([2.5, 2.5], [-5.0, 1e8], "printed: 2.5")


def test_axes_are_logarithmic_where_the_thesis_has_them_so():
    curves = {"a": ("circles", {"x": TIME[:9], "y": TIME[:9]})}
    layout = drawn(ThesisFigure("f", "t", ("x", "y"), curves, [], logarithmic="y")).layout
    assert (layout.xaxis.type, layout.yaxis.type) == (None, "log")
