"""What `butterfly inspect` says of logs."""

import pytest

from butterfly.logs.health import examine
from butterfly.report.inspection import (
    conditions_text,
    health_rows,
    log_columns,
    shared_findings,
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


def _row(*texts):
    return {"log": "a.csv", "condition": "note", "findings": [{"text": text} for text in texts]}


def test_what_all_logs_have_is_not_repeated_in_the_row_of_each():
    rows = [_row("input taken in V", "2 gaps"), _row("input taken in V")]
    assert shared_findings(rows) == ["input taken in V"]
    column = log_columns(shared_findings(rows))["findings"]
    assert [column(row) for row in rows] == ["2 gaps", ""]


def test_a_single_log_keeps_all_its_findings():
    (row,) = rows = [_row("2 gaps")]
    assert shared_findings(rows) == []
    assert log_columns([])["findings"](row) == "2 gaps"
