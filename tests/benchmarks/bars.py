"""Bars of the benchmarks: as they stand with `make bench`, twice as wide with `bench-short`.

What is said to be a ratio ``of`` something is a row of the table that ends the benchmarks.
"""

import os

SHORT = bool(os.environ.get("BUTTERFLY_BENCH_SHORT"))
"""Whether fewer draws are made and the bars are twice as wide, for a machine that others share."""

ROWS = []
"""The table: what is measured, found, bar, of what it is a ratio."""

_SLACK = 2.0 if SHORT else 1.0


def at_most(found, bar, what, of=None):
    """Fail unless what was found is at most the bar."""
    most = bar * _SLACK
    _record(what, found, f"≤ {most:g}", of)
    assert found <= most, f"{what}: {found:.4g}, at most {most:.4g} wanted"


def at_least(found, bar, what, of=None):
    """Fail unless what was found is at least the bar."""
    least = bar / _SLACK
    _record(what, found, f"≥ {least:g}", of)
    assert found >= least, f"{what}: {found:.4g}, at least {least:.4g} wanted"


def table():
    """Return the rows as Markdown, of which docs/performance.md shows those of one run."""
    heads = ("what is measured", "found", "bar", "as a multiple of")
    rows = [heads, ("---",) * len(heads), *ROWS]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _record(what, found, bar, of):
    if of is not None:
        ROWS.append((what, f"{float(f'{found:.3g}'):g}", bar, of))
