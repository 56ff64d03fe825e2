"""Bars of the benchmarks, and the one table of what was measured against them.

`make bench` writes the table into docs/performance.md. `bench-short` doubles the bars of time, for
machines that others share. The page has the bars that stand here; tests/test_bars.py holds it so.
"""

import os
from pathlib import Path
from typing import NamedTuple

SHORT = bool(os.environ.get("BUTTERFLY_BENCH_SHORT"))
"""Whether fewer draws are made and the bars of time are twice as wide."""

PAGE = Path(__file__).parents[2] / "docs" / "performance.md"
BEGIN, END = "<!-- table: make bench -->", "<!-- end of table -->"
HEADS = ("what is measured", "found", "bar", "as a multiple of", "")


class Bar(NamedTuple):
    """What is wanted of a measurement, as a multiple of what is done in the same run."""

    sense: str  # ≤ or ≥
    level: float
    of: str
    kind: str = "time"  # or accuracy, whose bars are never doubled

    def met(self, found, allowance=1.0):
        """Whether what was found meets it, so many times as wide."""
        return (
            found <= self.level * allowance
            if self.sense == "≤"
            else found >= self.level / allowance
        )

    def __str__(self):
        return f"{self.sense} {self.level:g}"


_SIMULATION, _LOGS = "a simulation of 41 logs", "their bare integration"
_COLUMN, _KERNEL = "the column's norm", "the kernel, its input delivered"
_PEER = "mujoco.sysid, 6 logs, 4 parameters"

BARS = {
    "free run and FIT of 41 logs": Bar("≤", 2, _SIMULATION),
    "the same, inputs delivered anew": Bar("≤", 3, _SIMULATION),
    "best p4 for given parameters": Bar("≤", 100, _SIMULATION),
    "harmonic balance of 41 logs": Bar("≤", 1, "their free run and FIT, inputs delivered anew"),
    "identify 41 real logs": Bar("≤", 6.5, "reading them (loadmat)"),
    "identify 24 logs of 10 s": Bar("≤", 25, _LOGS),
    "butterfly identify, quick start": Bar("≤", 2, "importing what it needs"),
    "what --report adds to it": Bar("≤", 1.5, "importing what draws it"),
    "output error: residuals and Jacobian": Bar("≤", 2.5, _SIMULATION),
    "output error: fit of 12 parameters": Bar("≤", 16, _SIMULATION),
    "select by output error, 5 terms": Bar("≤", 3, "output error of 41 logs"),
    "output error: Jacobian less central differences, worst column": Bar(
        "≤", 1e-5, _COLUMN, "accuracy"
    ),
    "output error: Jacobian less central differences, delay": Bar("≤", 1e-3, _COLUMN, "accuracy"),
    f"{_PEER}: from the logs on": Bar("≥", 300, "output error from the logs on, 6 parameters"),
    f"{_PEER}: the fit": Bar("≥", 200, "output error of the 4 from the same start"),
    "error of output error from the logs": Bar("≤", 1, "mujoco.sysid's", "accuracy"),
    "error of output error from the same start": Bar("≤", 1, "mujoco.sysid's", "accuracy"),
    "motor wrapper": Bar("≤", 1.33, "a bare loop of mj_step"),
    "a run in MuJoCo on a jittered clock": Bar("≤", 1.4, "its steps, taken in C"),
    "39 runs in MuJoCo": Bar("≤", 1.05, "a bare rollout"),
    "the exported twin with Stribeck friction, 2 ms": Bar(
        "≤", 1.3, "a hinge with damping and frictionloss"
    ),
    "a step of the energy-shaping controller": Bar("≤", 2, "a step of MuJoCo"),
    "scipy's solve_ivp at the kernel's accuracy": Bar("≥", 500, _KERNEL),
    "MuJoCo's bare rollout, RK4 at 1 ms": Bar("≥", 100, _KERNEL),
    "the kernel of a joint with p1..p4 and Coulomb friction": Bar(
        "≤", 1.75, "a bare compiled loop"
    ),
    "butterfly --version": Bar("≤", 1.5, "a bare cyclopts program"),
    "butterfly --help": Bar("≤", 1.5, "a bare cyclopts program"),
    "import butterfly": Bar("≤", 1.5, "import numpy"),
    "logs of a grey-box run of large-sweep.yaml": Bar("≤", 2.5, _LOGS),
    "the whole run, identified and recorded": Bar("≤", 13, "the bare integration of its logs"),
    "the same run in MuJoCo": Bar("≥", 5, "the run in the grey box"),
    "weak form of two logs of 70 s": Bar("≤", 4.5, _LOGS),
}
"""What is measured, in the order of the page."""

MISSED = {
    "identify 41 real logs",
    "butterfly identify, quick start",
    "what --report adds to it",
    "the whole run, identified and recorded",
    "output error: fit of 12 parameters",
    "select by output error, 5 terms",
}
"""Bars that are missed since identification judges what is left of every fit, and tries a moving
base and rarer terms: printed as missed until they are met."""

ROWS = {}
"""Rows of the table that were measured, by what they are of."""


def measured(what, found):
    """Put a measurement into the table; fail unless it meets its bar."""
    bar = BARS[what]
    note = bar.kind if bar.met(found) else f"**missed**, {bar.kind}"
    ROWS[what] = (what, f"{float(f'{found:.3g}'):g}", str(bar), bar.of, note)
    met = bar.met(found, 2.0 if SHORT and bar.kind == "time" else 1.0)
    assert met or what in MISSED, f"{what}: {found:.4g}, {bar} wanted"


def count_missing(what, why):
    """Put a measurement that cannot be made here into the table."""
    ROWS[what] = (what, "missing", str(BARS[what]), BARS[what].of, why)


def at_most(found, bar, what, *, time=False):
    """Fail unless what was found, which the page does not tell, is at most a bar."""
    assert found <= bar * (2.0 if SHORT and time else 1.0), f"{what}: {found:.4g}, ≤ {bar:g} wanted"


def at_least(found, bar, what):
    """Fail unless what was found, which the page does not tell, is at least a bar."""
    assert found >= bar, f"{what}: {found:.4g}, ≥ {bar:g} wanted"


def table(rows):
    """Return the rows as Markdown."""
    lines = [HEADS, ("---",) * len(HEADS), *rows]
    return "\n".join(f"| {' | '.join(row)} |" for row in lines)


def rows_of_page():
    """Return the rows of the page's table by what they are of."""
    lines = PAGE.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0].splitlines()
    cells = (tuple(cell.strip() for cell in line.strip("|").split("|")) for line in lines)
    return {row[0]: row for row in list(cells)[3:] if len(row) == len(HEADS)}


def write_page(machine):
    """Put what was measured, and the machine, into the page; what was not measured stays."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    rows = rows_of_page() | ROWS
    lines = table([rows[what] for what in BARS if what in rows])
    after = rest.partition(END)[2]
    PAGE.write_text(f"{before}{BEGIN}\n{lines}\n\n{machine}\n{END}{after}", encoding="utf-8")
