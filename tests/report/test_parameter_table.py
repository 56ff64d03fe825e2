"""Parameters as texts: how well each is known."""

from butterfly.report.parameter_table import parameter_table
from tests.report.setting import parameter_row


def test_a_badge_says_how_well_a_parameter_is_known():
    plain = {"value": 1.0, "lower": 0.95, "upper": 1.05, "claim": "rough"}
    for badge, about in {
        "good": {"upper": 1.09},
        "care": {"upper": 1.2},
        "poor": {"upper": 1.5},
        "may be 0": {"lower": -0.1, "claim": "not-from-zero"},
        "at bound": {"on_bound": True},
        "known": {"known": True},
        "": {"lower": None, "claim": ""},
    }.items():
        assert parameter_table("", [parameter_row(**plain | about)], "mark").rows == [[badge]]
    row = parameter_row(value=0.0, lower=0.0, upper=0.2)
    assert parameter_table("", [row], "±").rows == [["may be 0"]]
