"""How near an identification comes to the truth of a random robot, and what it says of itself."""

import time
from dataclasses import dataclass, field, replace

from butterfly.api.identification import Identification
from butterfly.errors import ButterflyError
from butterfly.identification.estimators import HarmonicBalance, OutputError, WeakForm
from butterfly.identification.identify import identify
from butterfly.identification.problem import Start
from butterfly.model.terms import PARAMETERS, FrictionTerms
from butterfly.verdict import Level

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

    Error and half-width are in % of the true value; of p3 in % of |p3| and the largest added
    gravity moment; of the delay in ms; of a true value of zero as it stands.
    """

    error: float
    half_width: float
    covered: bool  # whether the interval holds the truth
    claimed: bool  # whether it is said to be known within 10 %
    miss: float  # distance to the truth over the true value's size, which the claim is about

    @property
    def false_claim(self) -> bool:
        """Whether it is said to be known, and is not."""
        return self.claimed and self.miss > _FALSE


@dataclass(frozen=True, kw_only=True)
class Score:
    """One robot identified by one method; ``refused`` says why not, if it was not."""

    family: str
    number: int
    repeat: int
    method: str
    refused: str = ""
    readings: dict[str, Reading] = field(default_factory=dict)
    fit: float = float("nan")  # median, in %
    condition: float = float("nan")
    ending: str = ""
    verdict: str = ""
    excess: float = float("nan")  # cost over that of a fit begun at the truth, if there is one
    misfit: float = float("nan")  # what is left over what sensors explain, where it was asked for
    text: str = ""  # the answer in words, the same
    follows: list[str] = field(default_factory=list)  # which parameter follows which condition
    seconds: float = 0.0  # that the identification took

    @property
    def local_minimum(self) -> bool:
        """Whether a fit begun at the truth ends lower."""
        return self.excess > LOCAL_MINIMUM

    @property
    def flagged(self) -> bool:
        """Whether the verdict is not good, or conditions are said to disagree."""
        return self.verdict != Level.GOOD.verdict or bool(self.follows)

    @property
    def name(self) -> str:
        """What draws the robot again."""
        return f"{self.family}{self.number}" + (f"/{self.repeat}" if self.repeat else "")


def score(robot, method):
    """Identify a robot of a family by one of `METHODS`."""
    estimator = METHODS[method][0]
    named = {"family": robot.family, "number": robot.number, "repeat": robot.repeat}
    truth = {name: getattr(robot.truth, name) for name in PARAMETERS}
    heaviest = max(mass.gravity_moment for mass in robot.masses)
    return scored(
        lambda: Identification.of(identify(robot.data, estimator)),
        truth,
        heaviest,
        lambda found: {"excess": _excess(robot, estimator, found.estimate)},
        method=method,
        **named,
    )


def scored(identified, truth, heaviest, besides=lambda _: {}, *, names=PARAMETERS, **named):
    """Return the score of what is identified; a refusal or a crash is a score too.

    ``besides`` says further fields of what was found; of ``names`` readings are taken.
    """
    began = time.perf_counter()
    try:
        found = identified()
        seconds, estimate = time.perf_counter() - began, found.estimate
        return Score(
            **named,
            readings=readings_of(estimate, truth, heaviest, names),
            fit=found.fit.median,
            condition=estimate.condition,
            ending=str(estimate.ending),
            verdict=str(found.standing),
            follows=[f"{each.parameter} by {each.condition}" for each in estimate.agreement],
            seconds=seconds,
            **besides(found),
        )
    except ButterflyError as refusal:
        said = str(refusal)
    except Exception as crash:  # it is counted, not hidden
        said = f"{type(crash).__name__}: {crash}"
    return Score(**named, refused=said, seconds=time.perf_counter() - began)


def readings_of(estimate, truth, heaviest, names=PARAMETERS):
    """Compare an estimate with true values by name; the heaviest added moment sizes p3's error."""
    claimed = {row.name for row in estimate.table() if row.claim == "precise"}
    rows = zip(estimate.names, estimate.values, estimate.lower, estimate.upper, strict=True)
    limits = {name: row for name, *row in rows}
    readings = {}
    for name in names:
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
    """Least squares that are reached from an output error's answer, over those from the truth.

    The answer itself need not have the least squares: its logs may be weighed.
    """
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
    found = same.problem(data.logs, Start(estimate.parameters, dict.fromkeys(robot.masses, zero)))
    best = same.problem(data.logs, Start(truth, zeros))
    return found.descend().cost / best.descend().cost
