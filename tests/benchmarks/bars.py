"""What is asked of every measurement, and what was measured: the table of docs/performance.md.

`bench-short` doubles the bars of time, for machines that others share. The page has the bars that
stand here; tests/test_bars.py holds it so.
"""

import os
from typing import NamedTuple

SHORT = bool(os.environ.get("BUTTERFLY_BENCH_SHORT"))
"""Whether less is measured, fewer times, and the bars of time are twice as wide."""


class Bar(NamedTuple):
    """What is asked of a measurement, as a multiple of what is done in the same run."""

    sense: str  # ≤ or ≥
    asked: float | None  # None: printed without a bar
    of: str
    today: float | None = None  # on an idle machine, where that misses what is asked
    accuracy: bool = False  # not time: never doubled

    def limit(self, *, short=SHORT):
        """Return what fails beyond it: what is asked, or a quarter more than a miss of today."""
        level, factor = (self.asked, 1.0) if self.today is None else (self.today, 1.25)
        factor = 2.0 if short and not self.accuracy else factor
        return level * factor if self.sense == "≤" else level / factor

    def met(self, found, level):
        """Whether what was found is on the right side of a level; of none it always is."""
        return level is None or (found <= level if self.sense == "≤" else found >= level)

    def holds(self, found, *, short=SHORT):
        """Whether what was found passes, as asked or below the ceiling of a miss."""
        return self.asked is None or self.met(found, self.limit(short=short))

    def note(self, found):
        """Return the page's last column."""
        notes = ("**missed**" * (not self.met(found, self.asked)), "accuracy" * self.accuracy)
        return ", ".join(filter(None, notes))

    def __str__(self):
        return "–" if self.asked is None else f"{self.sense} {self.asked:g}"


_SIMULATION, _LOGS = "a simulation of 41 logs", "their bare integration"
_COLUMN, _KERNEL = "the column's norm", "the kernel, its input delivered"
_PEER, _SCRIPT = "mujoco.sysid, 6 logs, 4 parameters", "around 20 lines of numba, 4 parameters"
_OURS = "output error from the logs on, 6 parameters"

# Only an issue changes what is asked, or the figure of today from which a miss has its ceiling.
BARS = {
    "free run and FIT of 41 logs": Bar("≤", 2, _SIMULATION),
    "the same, inputs delivered anew": Bar("≤", 3, _SIMULATION),
    "best p4 for given parameters": Bar("≤", 100, _SIMULATION),
    "harmonic balance of 41 logs": Bar("≤", 1, "their free run and FIT, inputs delivered anew"),
    "identify 41 real logs": Bar("≤", None, "reading them (loadmat)"),
    "identify 24 logs of 10 s": Bar("≤", 25, _LOGS),
    "butterfly identify, quick start": Bar("≤", 2, "importing what it needs", today=2.78),
    "what --report adds to it": Bar("≤", 1.5, "importing what draws it", today=1.95),
    "output error: residuals and Jacobian": Bar("≤", 2.5, _SIMULATION),
    "output error: fit of 12 parameters": Bar("≤", 16, _SIMULATION, today=32.4),
    "select by output error, 5 terms": Bar("≤", 3, "output error of 41 logs", today=7.06),
    "output error: Jacobian less central differences, worst column": Bar(
        "≤", 1e-5, _COLUMN, accuracy=True
    ),
    "output error: Jacobian less central differences, delay": Bar(
        "≤", 1e-3, _COLUMN, accuracy=True
    ),
    _OURS: Bar("≤", 1, f"SciPy's least_squares {_SCRIPT}"),
    "the same fit": Bar("≤", 1, f"lmfit {_SCRIPT}"),
    f"{_PEER}: from the logs on": Bar("≥", 300, _OURS),
    f"{_PEER}: the fit": Bar("≥", 200, "output error of the 4 from the same start"),
    "error of output error from the logs": Bar("≤", 1, "mujoco.sysid's", accuracy=True),
    "error of output error from the same start": Bar("≤", 1, "mujoco.sysid's", accuracy=True),
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
    "the whole run, identified and recorded": Bar(
        "≤", 5, "the bare integration of its logs", today=13.4
    ),
    "the same run in MuJoCo": Bar("≥", None, "the run in the grey box"),
    "weak form of two logs of 70 s": Bar("≤", 1.5, _LOGS, today=4.11),
}
"""What is measured, in the order of the page."""

ROWS = {}
"""Rows of the table that were measured, by what they are of."""


def measured(found):
    """Put measurements into the table; fail where one passes neither its bar nor its ceiling."""
    for what, ratio in found.items():
        bar = BARS[what]
        ROWS[what] = (what, f"{float(f'{ratio:.3g}'):g}", str(bar), bar.of, bar.note(ratio))
    beyond = [
        f"{what}: {ratio:.4g}, {BARS[what]} asked, fails beyond {BARS[what].limit():.4g}"
        for what, ratio in found.items()
        if not BARS[what].holds(ratio)
    ]
    assert not beyond, "; ".join(beyond)


def count_missing(what, why):
    """Put a measurement that cannot be made here into the table."""
    ROWS[what] = (what, "missing", str(BARS[what]), BARS[what].of, why)
