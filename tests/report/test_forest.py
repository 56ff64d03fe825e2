"""Half-widths of intervals on one axis."""

import numpy as np
import pytest

from butterfly.report.page import forest
from tests.report.setting import parameter_row


def test_all_half_widths_are_on_one_logarithmic_axis_in_per_cent_of_their_values():
    sure = parameter_row(value=2.0, lower=1.9998, upper=2.0004, true=2.0001)
    wide = parameter_row(value=1.0, lower=0.7, upper=1.2, least_left_out=0.9, largest_left_out=1.0)
    idle = parameter_row(value=0.1, lower=-0.3, upper=0.5)
    rows = forest([sure, wide, idle, parameter_row(value=1.0, lower=1.0, upper=1.0, known=True)])
    (axis,) = {each.axis for each in rows}
    assert axis.decades == [0.01, 0.1, 1.0, 10.0, 100.0]
    assert (rows[0].half_width, rows[0].true) == pytest.approx((0.02, 0.005))
    assert rows[1].left_out == pytest.approx(10.0)
    assert [each.may_be_zero for each in rows] == [False, False, True, False]
    places = [axis.place(each.half_width) for each in rows[:3]]
    assert places == pytest.approx([7.5, 86.9, 100.0], abs=0.1)  # each is seen
    assert axis.place(rows[0].true) == 0.0  # at the edge
    unknown = [parameter_row(value=value, lower=-np.inf, upper=1.0) for value in (0.0, np.nan)]
    assert {each.half_width for each in (rows[3], *forest(unknown))} == {None}
    assert forest([parameter_row(value=0.0, lower=-1.0, upper=1.0)])[0].axis.decades == [
        10.0,
        100.0,
    ]
