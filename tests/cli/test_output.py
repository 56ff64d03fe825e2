"""Tables and sentences fit the width they are given, and long work tells how far it is."""

import re

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.cli import output
from butterfly.cli.output import show_progress
from butterfly.experiment.sweep import run_sweep
from tests.cli.one_line import assert_tables_fit, done, printed_table
from tests.experiment.setting import HereEngine, small_plan, written

NUMBERS = st.floats(-1e6, 1e6).map(lambda value: f"{value:.6g}")
NAMES = st.text("abcdefgh", min_size=1, max_size=12)


@settings(max_examples=30)
@given(
    st.lists(st.lists(NUMBERS, min_size=9, max_size=9), min_size=1, max_size=4),
    st.lists(st.lists(NAMES, min_size=1, max_size=4).map(" ".join), min_size=10, max_size=10),
    st.integers(40, 120),
)
def test_no_number_is_folded_cut_or_lost_and_no_line_is_too_long(numbers, headers, width):
    rows = [(f"row{k}", *row) for k, row in enumerate(numbers)]
    lines = printed_table(width, "", headers, rows)
    assert all(len(line) <= width for line in lines)
    for row in rows:
        told = [word for line in lines if row[0] in line for word in line.split()]
        assert [word for word in told if word != row[0]] == list(row[1:])


def test_a_table_that_fits_stands_as_it_is_without_columns_that_say_nothing():
    lines = printed_table(80, "", ("", "true", "no"), [("p1", "0.00325", "–"), ("p2", "1", "")])
    assert [line for line in lines if line] == ["         true", "  p1  0.00325", "  p2        1"]


def test_a_table_too_wide_stands_in_blocks_that_each_name_their_rows():
    headers = ("run", "method", *(f"value{k}" for k in range(12)))
    rows = [(f"{run}", "weak-form", *["0.123456"] * 12) for run in range(3)]
    second = [line for line in printed_table(80, "t", headers, rows, lead=2) if line[2:3] == "1"]
    assert len(second) > 1
    assert all(line.split()[:2] == ["1", "weak-form"] for line in second)


def test_a_text_is_folded_between_words_and_no_number_leaves_its_unit(monkeypatch):
    text = "inertia 0.003 kg m², viscous 2 N m s/rad, a median FIT of 99.6 % over 24 logs"
    monkeypatch.setenv("FORCE_COLOR", "1")
    for width in range(24, 80):
        monkeypatch.setenv("COLUMNS", str(width))
        lines = output._folded(text).split("\n")  # noqa: SLF001 - what `say` prints
        assert " ".join(lines) == text
        assert not any(re.search(r"\d$|kg$|N$", line) for line in lines[:-1])


def test_a_command_in_a_sentence_is_never_folded_and_a_value_keeps_its_error(monkeypatch):
    command = "`butterfly identify rehearsal --report page.html`"
    text = f"Coulomb friction is 0.0003 ± 0.00002 N m. Next: {command} shows how the model fits."
    monkeypatch.setenv("FORCE_COLOR", "1")
    for width in range(24, 80):
        monkeypatch.setenv("COLUMNS", str(width))
        folded = output._folded(text)  # noqa: SLF001 - what `say` prints
        assert folded.replace("\n", " ") == text
        assert command in folded
        assert "0.0003 ± 0.00002" in folded


def test_texts_are_no_markup(butterfly, quick_data, tmp_path):
    name = "a[/b][red]:smile:"
    manifest = yaml.safe_load((quick_data / "manifest.yaml").read_text())
    written(tmp_path / "manifest.yaml", **manifest | {"name": name, "root": str(quick_data)})
    assert name in done(butterfly("identify", tmp_path, "--terms="))
    done(butterfly("inspect", tmp_path))


PRINTED = {
    "inspect": (),
    "inspect one": ("--log", 1),
    "identify": ("--terms=", "--against", "p1=0.003,p2=0.001,p3=0.05"),
    "inspect results": (),
    "inspect a sweep": (),
    "inspect a run": (),
}
COLOURS = re.compile(r"\x1b\[[0-9;]*m")


@pytest.fixture(scope="module")
def places(quick_data, tmp_path_factory):
    """Where the data are, and the results of a sweep."""
    folder = tmp_path_factory.mktemp("widths")
    grid = {"plant.friction.coulomb": [1e-4, 2e-4], "plant.encoder.noise": [1e-4]}
    run_sweep(small_plan(folder, sweep={"grid": grid}), folder / "one", HereEngine())
    return quick_data, folder / "one"


@pytest.mark.parametrize("call", [*PRINTED, "compare"])
def test_output_fits_80_columns_and_says_on_a_terminal_what_it_says_piped(
    answer, butterfly, places, monkeypatch, call
):
    data, sweep = places
    of_results = {"results": sweep.parent, "sweep": sweep, "run": sweep / "0"}
    command, *others = call.split()
    told = (command, of_results.get(others[-1] if others else "", data), *PRINTED.get(call, ()))
    if call == "compare":
        told = (call, sweep / "0", sweep / "1")
    code, piped, err = answer(*told)
    assert code in {0, 3}, err
    assert_tables_fit(piped)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("FORCE_COLOR", "1")
    shown = COLOURS.sub("", butterfly(*told)[1])
    assert shown.split() == piped.split()
    paths = [line for line in piped.splitlines() if "/" in line]  # nothing is to break a path
    assert [line for line in shown.splitlines() if len(line) > 80 and line not in paths] == []


def test_work_is_shown_on_a_terminal_and_nowhere_else(capsys, monkeypatch):
    assert list(show_progress(iter("ab"), "Reading")) == ["a", "b"]
    assert capsys.readouterr().err == ""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    assert list(show_progress([1, 2], "Counting")) == [1, 2]
    assert "Counting" in capsys.readouterr().err


def test_long_work_says_elsewhere_than_on_a_terminal_how_far_it_has_come(capsys, monkeypatch):
    monkeypatch.setattr(output, "_EVERY", -1.0)  # s: every item takes longer
    assert list(show_progress(range(3), "Running")) == [0, 1, 2]
    assert capsys.readouterr().err == "Running: 1 of 3 …\nRunning: 2 of 3 …\n"
