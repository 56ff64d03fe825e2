"""Faults of a drive, an encoder, a clock and a person, by the bars of `make faults`, which has all.

The motors and their integrator share no code with the program.
"""

import pytest

from tests.benchmarks.faults import report, trial
from tests.independent.faults import FAULTS

NAMED = {fault.name: fault for fault in FAULTS}


@pytest.mark.parametrize(
    ("fault", "phase", "joint"),
    [
        ("drive at its largest command", "relay", "held by gravity"),
        ("drive holds its last command", "brake", "held by nothing"),
        ("command changes sign", "brake", "held by nothing"),
        ("encoder changes sign", "relay", "geared"),
        ("encoder is frozen", "relay", "held by gravity"),
        ("drive integrates its command", "relay", "held by nothing"),
    ],
)
def test_a_drive_is_off_a_fifth_of_a_second_beyond_a_limit(fault, phase, joint):
    assert not _misses(fault, phase, joint)


@pytest.mark.parametrize(
    ("fault", "phase"),
    [
        ("current is None", "relay"),
        ("clock is NaN", "contact"),
        ("command returns text", "contact"),
        ("cable is out, and stop fails once", "relay"),
        ("Ctrl-C in wait, twice in stop", "relay"),
        ("drive of set-points", "start"),
    ],
)
def test_whatever_a_drive_raises_or_returns_ends_in_a_sentence_with_the_drive_off(fault, phase):
    assert not _misses(fault, phase, "held by gravity")


def _misses(fault, phase, joint):
    """Return what was missed, as a table; the fault has to have begun."""
    result = trial(NAMED[fault], phase, joint)
    assert result.begun is not None
    return result.is_missed and f"{report([result])}\n{result.ending}"
