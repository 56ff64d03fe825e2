"""What `butterfly inspect` says of logs."""

import pytest

from butterfly.logs.health import Remark, examine
from butterfly.report.inspection import (
    Inspected,
    conditions_text,
    health_rows,
    shared_sentences,
    shared_texts,
)
from butterfly.verdict import Level


def test_health_rows_find_the_frequency_and_the_swing(sine_log):
    clean, health = examine(sine_log)
    rows = dict(health_rows(clean, health))
    assert float(rows["dominant frequency"].split()[0]) == pytest.approx(5, abs=0.1)
    assert float(rows["amplitude"].split()[0]) == pytest.approx(0.1, rel=1e-2)
    assert health.findings == []


@pytest.mark.parametrize(
    ("counts", "text"),
    [
        ((24, 0, 0, 0), "24 logs: all ok."),
        ((1, 0, 0, 0), "1 log: ok."),
        ((10, 31, 0, 0), "41 logs, all usable (31 with a note)."),
        ((1, 1, 1, 0), "3 logs: 1 ok, 1 with a note, 1 to check."),
        ((0, 0, 0, 1), "1 log: 1 unusable."),
    ],
)
def test_health_is_told_by_severity(counts, text):
    conditions = [each for each, n in zip(Level, counts, strict=True) for _ in range(n)]
    assert conditions_text(conditions) == text


def _log(name, *remarks):
    return Inspected(name=name, remarks=tuple(Remark(level, text) for level, text in remarks))


def test_what_holds_for_all_logs_is_said_once():
    unit, gap = (Level.GOOD, "input taken in V: the file does not say"), (Level.NOTE, "1 gap")
    odd = (Level.CARE, "no sine")
    seen = [_log("a", unit, gap), _log("b", gap, unit, odd)]
    shared = shared_texts(seen)
    assert shared == [unit[1], gap[1]]
    assert shared_sentences(seen, shared) == ["All 2 logs: 1 gap."]  # the unit has its own sentence
    assert shared_texts(seen[:1]) == []
    assert shared_texts([*seen, _log("c")]) == []
