"""How well free runs follow the logs decides what parameters mean."""

from __future__ import annotations

import numpy as np
import pytest

from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.diagnostics.plausibility import judge_fit
from butterfly.verdict import Level

NAMES = ("a", "b", "c", "d")


def test_good_fits_say_nothing():
    assert judge_fit(np.array([95.0, 99.0, 60.0, 85.0]), NAMES) == []


@pytest.mark.parametrize(
    ("fits", "severity"),
    [
        ((70.0, 79.0, 60.0, 95.0), Level.CARE),
        ((70.0, 20.0, 10.0, 49.0), Level.WARNING),
        ((-np.inf, -np.inf, -np.inf, 95.0), Level.WARNING),
        ((np.nan, 95.0, 95.0, 95.0), Level.WARNING),
    ],
)
def test_a_poor_median_is_said_as_gravely_as_it_is(fits, severity):
    (said,) = judge_fit(np.array(fits), NAMES)
    assert (said.kind, said.severity) == (FindingKind.POOR_FIT, severity)
    assert said.number == pytest.approx(np.median(fits), nan_ok=True)


def test_single_logs_that_are_not_followed_are_named():
    (said,) = judge_fit(np.array([95.0, 30.0, 96.0, -5.0, 97.0]), (*NAMES, "e"))
    assert (said.kind, said.severity) == (FindingKind.UNFOLLOWED, Level.CARE)
    assert said.logs == ("b", "d")
    assert said.number == -5.0


def test_a_log_that_is_followed_well_below_the_others_is_named():
    (found,) = judge_fit(np.array([99.0] * 9 + [70.0]), [f"log {k}" for k in range(10)])
    assert (found.kind, found.logs) == (FindingKind.UNFOLLOWED, ("log 9",))
    assert judge_fit(np.array([99.0] * 9 + [86.0]), [f"log {k}" for k in range(10)]) == []
