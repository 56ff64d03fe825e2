"""What commands print fits 80 columns, on a terminal and piped, and what help says fits 60.

Whether the tables of commands that rest on an estimate fit is asserted where their verdicts are.
"""

import re

import pytest

from butterfly.experiment.sweep import run_sweep
from tests.cli.fitting import assert_tables_fit
from tests.cli.test_app import CALLS
from tests.experiment.setting import HereEngine, small_plan

PRINTED = {
    "inspect": (),
    "inspect one": ("--log", 1),
    "identify": ("--method", "linear", "--against", "p1=0.003,p2=0.001,p3=0.05"),
    "model show": ("--added-mass", 0.05),
    "results list": (),
    "results show": (0,),
    "results table": (),
    "results table of estimates": ("--table", "estimates"),
    "results table with all columns": ("--columns", "key,seed,status,logs,noise"),
    "results compare": (0, 1),
}
COLOURS = re.compile(r"\x1b\[[0-9;]*m")
WORDS = re.compile(r"[\w.=,+-]{4,}")


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    folder = tmp_path_factory.mktemp("widths")
    grid = {"plant.friction.coulomb": [1e-4, 2e-4], "plant.encoder.noise": [1e-4]}
    run_sweep(small_plan(folder, sweep={"grid": grid}), folder / "one", HereEngine())
    return folder / "one"


@pytest.mark.parametrize("call", PRINTED)
def test_output_fits_80_columns_and_says_on_a_terminal_what_it_says_piped(
    butterfly, quick_data, sweep, monkeypatch, call
):
    words = call.split()[: 2 if call.startswith(("results", "model")) else 1]
    told = (*words, sweep if "results" in call else quick_data, *PRINTED[call])
    monkeypatch.setenv("COLUMNS", "80")
    code, piped, err = butterfly(*told)
    assert code in {0, 3}, err
    assert_tables_fit(piped)
    monkeypatch.setenv("FORCE_COLOR", "1")
    shown = COLOURS.sub("", butterfly(*told)[1])
    assert shown.split() == piped.split()
    paths = [line for line in piped.splitlines() if "/" in line]  # nothing is to break a path
    assert [line for line in shown.splitlines() if len(line) > 80 and line not in paths] == []


@pytest.mark.parametrize("call", CALLS, ids=" ".join)
def test_help_fits_splits_no_word_and_speaks_of_no_equation(butterfly, monkeypatch, call):
    monkeypatch.setenv("COLUMNS", "400")
    wide = butterfly(*call, "--help")[1]
    assert not re.search(r"\(\d{2,3}\)", wide)
    for columns in (60, 80):
        monkeypatch.setenv("COLUMNS", str(columns))
        _, out, _ = butterfly(*call, "--help")
        assert max(map(len, out.splitlines())) <= columns
        assert not re.search(r"\w…", out)
        assert {*WORDS.findall(out)} <= {*WORDS.findall(wide)}
