"""Benches: their day, machine and code are known, and pages quote what came out."""

import re

import pytest

from tests.benchmarks import kept, page

BENCHES = kept.parts()


@pytest.mark.parametrize("name", BENCHES)
def test_a_part_says_its_command_day_machine_and_code(name):
    made, text = BENCHES[name]
    assert re.fullmatch(
        r"`make .*`, \d{4}-\d\d-\d\d\. Linux .* cores; .*\. Code: `[0-9a-f]{16}`\.", made
    )
    assert text.strip()


@pytest.mark.parametrize("path", [kept.PAGE, page.PAGE], ids=lambda path: path.stem)
def test_no_cell_is_empty_or_unknown(path):
    text = path.read_text("utf-8")
    assert "unknown" not in text
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert rows
    assert not [row for row in rows if re.search(r"\|\s*\|", row)]


def test_the_page_of_costs_says_its_day_machine_and_code():
    text = page.PAGE.read_text("utf-8")
    assert re.search(r"^Measured \d{4}-\d\d-\d\d\. Linux .* cores; ", text, re.M)
    assert re.search(r"signals and plant: `[0-9a-f]{16}`\.", text)


def _number(name, before):
    """Return the number that a bench printed after some words."""
    (found,) = re.findall(rf"{re.escape(before)} ([\d.]+) %", BENCHES[name][1])
    return found


def _said(path):
    return " ".join((kept.ROOT / path).read_text("utf-8").split())


def test_the_real_logs_fits_in_the_pages_are_those_of_the_bench():
    free = _number("real-logs", "in-sample median FIT")
    held = _number("real-logs", "Held-out median FIT")
    assert f"of free runs {free} %, of logs with a held-out mass {held} %" in _said("README.md")
    assert f"[output error](methods.md) with {free} %" in _said("docs/thesis.md")


def test_the_coverage_in_the_page_on_verdicts_is_that_of_the_bench():
    first, *_ = BENCHES["coverage"][1].split("\n\n")
    rows = re.findall(r"^\| \w+ output-error \|(.*)\|$", first.strip(), re.M)
    cells = [float(cell) for row in rows for cell in row.split("|")]
    assert f"{sum(cells) / len(cells):.1f} % of its intervals contain the truth" in _said(
        "docs/verdict.md"
    )
