"""How near an identification comes to the truth of a random robot, and what it says of itself."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np

from butterfly.errors import ButterflyError
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.estimators import HarmonicBalance, OutputError, WeakForm
from butterfly.identification.identify import identify
from butterfly.model.terms import PARAMETERS, FrictionTerms

METHODS = {
    "harmonic-balance": (HarmonicBalance(), "AB"),
    "weak-form": (WeakForm(), "C"),
    "output-error": (OutputError(workers=1), "ABC"),
    "output-error(no terms)": (OutputError(terms=(), workers=1), "A"),
}
"""Each with the families that it is scored on."""

LOCAL_MINIMUM = 1.05
"""Multiple of the cost of a fit begun at the truth, above which the fit's end is another one."""

_FALSE = 0.1  # of the value: what a claim to know it within 10 % must not miss
_MILLI = 1e3


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One parameter.

    Parameters
    ----------
    error, half_width
        In % of the true value; of p3 in % of |p3| and the largest added gravity moment; of the
        delay in ms; of a true value of zero as it stands.
    covered
        Whether the interval holds the truth.
    claimed
        Whether it is said to be known within 10 %.
    miss
        Distance to the truth over the true value's size, which the claim is about.
    """

    error: float
    half_width: float
    covered: bool
    claimed: bool
    miss: float

    @property
    def false_claim(self) -> bool:
        """Whether it is said to be known, and is not."""
        return self.claimed and self.miss > _FALSE


@dataclass(frozen=True, kw_only=True)
class Score:
    """One robot identified by one method; ``refused`` says why not, if it was not.

    Parameters
    ----------
    fit
        Median FIT in %.
    ending, verdict, condition
        As the estimate says them; empty if it has none.
    excess
        Cost over that of a fit begun at the truth; NaN where there is no cost.
    seconds
        That the identification took.
    """

    family: str
    number: int
    repeat: int
    method: str
    refused: str = ""
    readings: dict[str, Reading] = field(default_factory=dict)
    fit: float = float("nan")
    condition: float = float("nan")
    ending: str = ""
    verdict: str = ""
    excess: float = float("nan")
    seconds: float = 0.0

    @property
    def local_minimum(self) -> bool:
        """Whether a fit begun at the truth ends lower."""
        return self.excess > LOCAL_MINIMUM

    @property
    def name(self) -> str:
        """What draws the robot again."""
        return f"{self.family}{self.number}" + (f"/{self.repeat}" if self.repeat else "")


def score(robot, method):
    """Identify a robot; a refusal or a crash is a score too."""
    began = time.perf_counter()
    try:
        judged = _judged(robot, METHODS[method][0])
    except ButterflyError as refusal:
        judged = {"refused": str(refusal)}
    except Exception as crash:  # it is counted, not hidden
        judged = {"refused": f"{type(crash).__name__}: {crash}"}
    return Score(
        family=robot.family,
        number=robot.number,
        repeat=robot.repeat,
        method=method,
        **{"seconds": time.perf_counter() - began} | judged,
    )


def _judged(robot, estimator):
    began = time.perf_counter()
    found = identify(robot.data, estimator)
    seconds = time.perf_counter() - began
    estimate = found.estimate
    truth = {name: getattr(robot.truth, name) for name in PARAMETERS}
    verdict = getattr(estimate, "verdict", "") or getattr(found, "verdict", "")
    return {
        "readings": readings_of(estimate, truth, max(m.gravity_moment for m in robot.masses)),
        "fit": found.fit.median,
        "condition": estimate.condition,
        "ending": str(estimate.ending),
        "verdict": str(verdict),
        "excess": _excess(robot, estimator, estimate),
        "seconds": seconds,
    }


def readings_of(estimate, truth, heaviest):
    """Compare an estimate with true values by name; the heaviest added moment sizes p3's error."""
    claimed = {
        name
        for each in estimate.findings
        if each.kind is FindingKind.PRECISE
        for name in each.parameters
    }
    limits = {
        name: (value, lower, upper)
        for name, value, lower, upper in zip(
            estimate.names, estimate.values, estimate.lower, estimate.upper, strict=True
        )
    }
    readings = {}
    for name in PARAMETERS:
        if name not in limits or name not in truth:
            continue
        value, lower, upper = (float(each) for each in limits[name])
        true = truth[name]
        size = abs(true) + (heaviest if name == "p3" else 0.0)
        unit = _MILLI if name == "delay" else 100.0 / size if size else 1.0
        readings[name] = Reading(
            error=float(unit * (value - true)),
            half_width=float(unit * (upper - lower) / 2),
            covered=bool(lower <= true <= upper),
            claimed=name in claimed,
            miss=float(abs(value - true) / (abs(true) or 1.0)),
        )
    return readings


def _excess(robot, estimator, estimate):
    """Cost of an output error's end, over that of the end of a fit begun at the truth."""
    if not isinstance(estimator, OutputError):
        return float("nan")
    terms = tuple(name for name in estimate.names if name not in PARAMETERS)
    same = replace(estimator, terms=terms)
    data = robot.data
    truth = robot.truth
    if "stribeck_velocity" not in terms:  # it is held where the fit holds it
        truth = replace(truth, stribeck_velocity=FrictionTerms.stribeck_velocity)
    zeros = dict.fromkeys(robot.masses, robot.zero)
    zero = estimate.local.get(None, {}).get("zero", robot.zero)
    problem = same.problem(data.logs, estimate.parameters, dict.fromkeys(robot.masses, zero))
    end = problem.equations(problem.initial)
    cost = float(sum(np.sum(log.residuals**2) for log in end.logs))
    best = same.problem(data.logs, truth, zeros)
    least = best.descend(best.initial).at
    return cost / float(sum(np.sum(log.residuals**2) for log in least.logs))
