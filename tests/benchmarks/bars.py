"""Bars of the benchmarks, and the one table of what was measured against them.

A bar stays as it was asked for. `make bench` writes the table into docs/performance.md;
`bench-short` doubles the bars of time, for machines that others share, and fails where the page has
other bars.
"""

import os
from pathlib import Path

SHORT = bool(os.environ.get("BUTTERFLY_BENCH_SHORT"))
"""Whether fewer draws are made and the bars of time are twice as wide."""

PAGE = Path(__file__).parents[2] / "docs" / "performance.md"
BEGIN, END = "<!-- table: make bench -->", "<!-- end of table -->"
HEADS = ("what is measured", "found", "bar", "as a multiple of", "")

MISSED = {
    "identify 41 real logs",
    "mujoco.sysid, 6 logs, 4 parameters: from the logs on",
    "motor wrapper",
    "output error: fit of 12 parameters",
    "select by output error, 5 terms",
    "the same run in MuJoCo",
    "the whole run, identified and recorded",
    "weak form of two logs of 70 s",
}
"""Bars that were missed when this table was begun, or since identification judges what is left
over of every fit: printed as missed until they are met."""

ROWS = []
"""The table, a tuple in the order of `HEADS` for each measurement."""


def at_most(found, bar, what, of=None, *, time=True):
    """Fail unless what was found is at most the bar; `time` tells bars that `SHORT` doubles."""
    _record(what, found, found <= bar, f"≤ {bar:g}", of, time)
    most = bar * (2.0 if SHORT and time else 1.0)
    assert found <= most or what in MISSED, f"{what}: {found:.4g}, at most {most:g} wanted"


def at_least(found, bar, what, of=None, *, time=True):
    """Fail unless what was found is at least the bar; `time` tells bars that `SHORT` halves."""
    _record(what, found, found >= bar, f"≥ {bar:g}", of, time)
    least = bar / (2.0 if SHORT and time else 1.0)
    assert found >= least or what in MISSED, f"{what}: {found:.4g}, at least {least:g} wanted"


def count_missing(what, bar, of, why):
    """Put a measurement that cannot be made here into the table."""
    ROWS.append((what, "missing", f"≥ {bar:g}", of, why))


def table(rows=None):
    """Return the rows as Markdown."""
    lines = [HEADS, ("---",) * len(HEADS), *(ROWS if rows is None else rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in lines)


def write_page(machine):
    """Put the table and the machine it was measured on into the page."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    PAGE.write_text(f"{before}{BEGIN}\n{table()}\n\n{machine}\n{END}{after}", encoding="utf-8")


def other_bars():
    """Return the measurements whose bar is not the page's, or that it lacks."""
    lines = PAGE.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0].splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    page = {(row[0], row[3]): row[2] for row in cells if len(row) == len(HEADS)}
    return [what for what, _, bar, of, _ in ROWS if page.get((what, of)) != bar]


def _record(what, found, met, bar, of, time):  # noqa: PLR0917
    """Add a row to the table; a missed bar is called so, doubled or not."""
    note = ", ".join(filter(None, ("" if met else "**missed**", "time" if time else "accuracy")))
    if of is not None:
        ROWS.append((what, f"{float(f'{found:.3g}'):g}", bar, of, note))
