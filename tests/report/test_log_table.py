"""Tables of logs: short names, the columns that are asked for, and FITs at a glance."""

import numpy as np
import pytest

from butterfly.report.inspection import (
    RESIDUAL_COLUMNS,
    about_log,
    fit_facts,
    of_logs,
    residual_row,
)


def _rows(*fits):
    about = {"added mass in kg": 0.05, "frequency in rad/s": None}
    return [{"log": f"a/{k}.csv", **about, "FIT in %": fit} for k, fit in enumerate(fits)]


def test_a_log_has_its_short_name_and_the_columns_that_are_asked_for():
    rows = [row | {"more": 1.0} for row in _rows(99.123456, None)]
    assert of_logs("Logs", rows).headers == ("log", "FIT in %", "more")
    table = of_logs("Logs", rows, "FIT in %")
    assert table.headers == ("log", "FIT in %")
    assert table.rows == [("50 g, 0.csv", "99.12"), ("50 g, 1.csv", "–")]


def test_a_log_without_a_fit_counts_neither_as_median_nor_as_worst():
    middle, worst = fit_facts(_rows(90.0, None, 80.0, 70.0), "FIT in %", "held out")
    assert (middle.value, worst.value, worst.detail) == ("80.0 %", "70.0 %", "3.csv")
    assert fit_facts(_rows(None), "FIT in %", "held out") == []


def test_the_residuals_of_a_log_are_shares_of_its_motion(simulated):
    result, _ = simulated
    log, seen = result.data.logs[0], result.residuals.logs[0]
    row = about_log(log) | residual_row(seen)
    assert row["log"] == log.name
    assert [*row][-len(RESIDUAL_COLUMNS) :] == [*RESIDUAL_COLUMNS]
    assert row["error in % of the motion"] == pytest.approx(100 * seen.error / seen.motion)
    assert np.isfinite(row["error over sensor noise"])
