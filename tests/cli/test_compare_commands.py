"""The commands that put things side by side."""

from __future__ import annotations

import re

import pytest


def test_both_simulators_are_compared_with_the_logs_and_reported(butterfly, quick_data, tmp_path):
    report = tmp_path / "compare.html"
    code, out, err = butterfly("compare", quick_data, "--log", "0,3", "--report", report)
    assert code == 0, err
    assert "MuJoCo" in out
    assert "grey box" in out
    assert f"Report: {report}" in out
    assert "residual torque" in report.read_text(encoding="utf-8").lower()


@pytest.mark.parametrize("numbers", ["0,99", "-1", "x"])
def test_a_log_that_is_not_there_is_one_line(butterfly, quick_data, numbers):
    code, _, err = butterfly("compare", quick_data, "--log", numbers)
    assert code == 2
    assert "numbers from 0 to 11" in err
    assert err.count("\n") == 1


def test_estimators_are_ranked_over_data_sets(butterfly, quick_data, tmp_path):
    report = tmp_path / "board.html"
    told = ("--method", "harmonic-balance, linear", "--report", report)
    code, out, err = butterfly("leaderboard", quick_data, *told)
    assert code == 0, err
    best = re.search(r"(\S+) predicts best what it has not seen", out)
    assert best.group(1) == "harmonic-balance"
    assert report.stat().st_size > 1e5


def test_an_estimator_that_is_none_is_one_line(butterfly, quick_data):
    code, _, err = butterfly("leaderboard", quick_data, "--method", "weekform")
    assert code == 2
    assert "did you mean" in err
    assert err.count("\n") == 1
