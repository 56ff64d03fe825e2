"""What `butterfly inspect` says of logs."""

import pytest

from butterfly.logs.health import examine
from butterfly.report.inspection import conditions_text, health_rows
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
