"""What commands print fits 80 columns, on a terminal and piped, and what help says fits 60."""

import re

import pytest

from butterfly.experiment.sweep_runner import run_sweep
from tests.cli.test_app import CALLS
from tests.experiment.setting import HereEngine, small_plan

GIVEN = "p1=0.00325,p2=0.00145,p3=0.04905,p4=0.025,coulomb=3e-4"
OF_DATA = {
    "identify": ("--against", "p1=0.003,p2=0.001,p3=0.05"),
    "identify by known parts": ("--known", "hand_mass=0.1+-0.001"),
    "identify the thesis's way": ("--method", "thesis"),
    "inspect": (),
    "inspect one": ("--log", 1),
    "validate": ("--bootstrap", 20),
    "select": ("--method", "harmonic-balance", "--candidates", "drag"),
    "residual": ("--log", "0,3"),
    "design": ("--limit", 3),
    "compare": ("--log", "0"),
    "leaderboard": ("--method", "harmonic-balance,linear"),
    "predict": ("--with", GIVEN),
    "model show": ("--added-mass", 0.05),
}
OF_SWEEPS = {
    "results list": (),
    "results show": (0,),
    "results table": (),
    "results table of estimates": ("--table", "estimates"),
    "results table with all columns": ("--columns", "key,seed,status,logs,noise"),
    "results compare": (0, 1),
}
ON_A_TERMINAL = {"identify", "inspect", "inspect one", "model show", *OF_SWEEPS}
COLOURS = re.compile(r"\x1b\[[0-9;]*m")


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    folder = tmp_path_factory.mktemp("widths")
    grid = {"plant.friction.coulomb": [1e-4, 2e-4], "plant.encoder.noise": [1e-4]}
    run_sweep(small_plan(folder, sweep={"grid": grid}), folder / "one", HereEngine())
    return folder / "one"


def _words(call):
    return call.split()[: 2 if call.startswith(("results", "model")) else 1]


@pytest.fixture
def printed(butterfly, quick_data, sweep, monkeypatch):
    """Return the lines that a command prints."""
    monkeypatch.setenv("COLUMNS", "80")

    def run(call):
        source, told = (quick_data, OF_DATA[call]) if call in OF_DATA else (sweep, OF_SWEEPS[call])
        code, out, err = butterfly(*_words(call), source, *told)
        assert code in {0, 3}, err
        return COLOURS.sub("", out).splitlines()

    return run


def _is_of_a_table(line):
    return line.startswith("  ")


@pytest.mark.parametrize("call", [*OF_DATA, *OF_SWEEPS])
def test_piped_tables_fit_80_columns_and_sentences_are_whole(printed, call):
    lines = printed(call)
    tables = [line for line in lines if _is_of_a_table(line)]
    assert tables
    assert [line for line in tables if len(line) > 80] == []
    assert not any(line.endswith(" ") for line in lines)
    said = [line for line in lines if line and not _is_of_a_table(line)]
    assert not any(line[0].islower() and line[0] == " " for line in said)


@pytest.mark.parametrize("call", sorted(ON_A_TERMINAL))
def test_on_a_terminal_no_line_is_longer_and_the_words_are_those_of_a_pipe(
    printed, monkeypatch, call
):
    piped = printed(call)
    monkeypatch.setenv("FORCE_COLOR", "1")
    shown = printed(call)
    paths = [line for line in piped if "/" in line]  # nothing is to break a path
    assert [line for line in shown if len(line) > 80 and line not in paths] == []
    assert " ".join(shown).split() == " ".join(piped).split()


@pytest.mark.parametrize("columns", [60, 80])
@pytest.mark.parametrize("call", CALLS, ids=" ".join)
def test_help_fits_and_splits_no_word(butterfly, monkeypatch, call, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    _, out, _ = butterfly(*call, "--help")
    assert max(map(len, out.splitlines())) <= columns
    assert not re.search(r"\w…", out)
    monkeypatch.setenv("COLUMNS", "400")
    words = set(re.findall(r"[\w.=,+-]{4,}", butterfly(*call, "--help")[1]))
    assert set(re.findall(r"[\w.=,+-]{4,}", out)) <= words


def test_help_speaks_of_no_equation(butterfly):
    for call in CALLS:
        assert not re.search(r"\(\d{2,3}\)", butterfly(*call, "--help")[1])
