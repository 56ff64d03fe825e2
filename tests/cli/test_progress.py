"""Long work tells how far it is, on standard error, until it ends however it does."""

import time

import pytest

from butterfly.cli import output
from butterfly.cli.output import show_progress, tell_no_more


@pytest.fixture
def often(monkeypatch):
    monkeypatch.setattr(output, "EVERY", 0.02)


@pytest.mark.usefixtures("often")
def test_where_there_is_no_terminal_a_line_tells_from_time_to_time(capsys):
    for _ in show_progress([1, 2, 3], "Counting"):
        time.sleep(0.05)
    told = capsys.readouterr()
    assert told.out == ""
    lines = told.err.splitlines()
    assert {line.partition(",")[0] for line in lines} == {
        f"Counting: {done} of 3 done" for done in range(3)
    }
    time.sleep(0.05)
    assert capsys.readouterr().err == ""


def test_short_work_is_silent(capsys):
    assert list(show_progress(iter("ab"), "Reading")) == ["a", "b"]
    assert capsys.readouterr().err == ""


@pytest.mark.usefixtures("often")
def test_work_that_was_left_tells_no_more(capsys):
    left = iter(show_progress([1, 2], "Fitting"))
    next(left)
    time.sleep(0.05)
    tell_no_more()
    time.sleep(0.03)
    assert "Fitting: 0 of 2 done" in capsys.readouterr().err
    time.sleep(0.06)
    assert capsys.readouterr().err == ""
