"""Re-calibrate the model next to an orbit, from logs of the control loop itself.

The equation of motion (or its product with the velocity, the balance of energy) against test
functions is linear in the parameters, whatever controller made the input; see
`butterfly.identification.test_functions`. One robot without a known mass gives the ratios p_i/p1
alone, which is all that a controller needs; logs with another known mass set the scale.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError, InputError, nearest, require_number
from butterfly.identification.estimate import Estimate
from butterfly.identification.fit import Fit
from butterfly.identification.infer import Basis, infer
from butterfly.identification.limits import SINGULAR_CONDITION, Conditioning
from butterfly.identification.linearisation import Linearisation, Regression, Solution
from butterfly.identification.scatter import Submodels, without_logs
from butterfly.identification.stagewise import Offer, is_near, offers_in, stagewise
from butterfly.identification.test_functions import HALF_WIDTH, Averaging, Balance
from butterfly.identification.trust import Finding, FindingKind
from butterfly.logs.log import Lead, Log
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.terms import PARAMETERS, TERMS, DriveTerms, FrictionTerms, companions, offered

CANDIDATES = offered("re-calibration")
"""Terms that can be estimated besides p1..p4."""

BASE = PARAMETERS[:4]  # always estimated
LEAST = {"p4": 0.0}  # bounds besides those of the table of terms: the input drives forwards
SEGMENT = 10  # test functions in a row, which share noise; such stretches count as independent

_FOLDS = 5  # parts that are held out in turn when terms are chosen
_COMPRESSION_ROUNDS = 5  # about the compression, which alone is not linear
_FEWEST_RUNS = 3  # to leave one out


@dataclass(frozen=True, kw_only=True)
class RecalibrationOptions:
    """How to re-calibrate."""

    balance: Balance = Balance.MOMENTUM
    """Of momentum (the weak form) or of energy."""
    candidates: tuple[str, ...] = tuple(row.name for row in TERMS.values() if row.recalibrated)
    """Of `CANDIDATES`; each is kept only if it predicts held-out parts of the logs better."""
    half_width: float = HALF_WIDTH
    """Of the test functions in s."""
    delay: float = 0.0
    """From input to torque in s, as known."""
    cogging_periods: float = 1.0
    """Of the cogging torque in a turn, as known; the sine of one period a turn is what p3 is."""

    def __post_init__(self) -> None:
        for name in self.candidates:
            if name not in CANDIDATES:
                raise InputError("recalibration", "candidates", name, nearest(name, CANDIDATES))
        if "cogging" in self.candidates and self.cogging_periods == 1:
            expected = "2 or more (one period per turn is not distinguishable from p3)"
            raise InputError("recalibration", "cogging_periods", 1, expected)
        require_number("recalibration", positive=True, half_width=self.half_width)
        require_number("recalibration", delay=self.delay)

    def averaging(self, log: Log, zero: float) -> Averaging:
        """Make a log ready to be averaged, no test function reaching before its beginning."""
        settings = FrictionTerms(cogging_periods=self.cogging_periods)
        running = replace(log, lead=log.lead or Lead(time=log.time[:0], input=log.input[:0]))
        return Averaging(running, zero, self.half_width, settings, self.balance)


@dataclass(frozen=True, kw_only=True, eq=False)
class Recalibration:
    """Parameters next to an orbit, and how far to trust them."""

    # if p1 is not in it, all but a compression is over that of the hand with what it carried
    estimate: Estimate
    rejected: tuple[str, ...]  # candidates that did not help
    carried: AddedMass | None  # the added mass, if all logs had the same one
    cogging_periods: float

    def is_ratio(self, name: str) -> bool:
        """Whether the value of a parameter is one over p1."""
        return self.estimate.ratios and not TERMS[name].of_gain

    def loaded(self, added: AddedMass = NO_ADDED_MASS, inertia: float = 1.0) -> LumpedParameters:
        """Return the parameters of the hand carrying a mass; of ratios, with p1 = ``inertia``."""
        values = self.estimate.named
        if not self.estimate.ratios:
            bare = LumpedParameters(**values, cogging_periods=self.cogging_periods)
            return bare.with_added_mass(added)
        if added != self.carried:
            raise IdentifiabilityError(
                f"ratios p_i/p1 identified with {self.carried} do not give those with {added}; "
                "re-calibrate with both"
            )
        return from_ratios(values, inertia, self.cogging_periods)


def from_ratios(
    ratios: dict[str, float], inertia: float, cogging_periods: float
) -> LumpedParameters:
    """Return parameters from ratios to p1, given p1 = ``inertia`` in kg m^2."""
    scaled = {
        name: value if TERMS[name].of_gain else inertia * value for name, value in ratios.items()
    }
    return LumpedParameters(p1=inertia, **scaled, cogging_periods=cogging_periods)


def recalibrate(
    logs: Sequence[Log], zero: float, options: RecalibrationOptions = RecalibrationOptions()
) -> Recalibration:
    """Estimate p1..p4 and friction by bounded linear least squares, from runs next to the orbit."""
    masses = {log.added_mass for log in logs}
    base = BASE if len(masses) > 1 else BASE[1:]
    loop = LoopEquations(logs, zero, options)
    solution, regression, run = loop.fit((*base, *options.candidates))
    if np.unique(regression.cluster).size <= 2 * _FOLDS:
        moving = f"{run.size * options.half_width / 2:.3g} s of motion"
        raise IdentifiabilityError(f"{moving} are too short to re-calibrate; record longer runs")
    names = chosen_terms(regression.linearised(solution), base)
    solution, regression, run = loop.fit(names)
    conditioning = Conditioning.of(regression.rows, names)
    if conditioning.number > SINGULAR_CONDITION:
        raise IdentifiabilityError(
            f"these runs do not separate {' and '.join(conditioning.weakest)} (condition number "
            f"{conditioning.number:.1e}); perturb the start, use several orbits, or add dither"
        )
    scale = FindingKind.ABSOLUTE if "p1" in names else FindingKind.RATIOS
    estimate = estimate_of(regression, run, solution, options.balance.value, scale)
    first = logs[0]
    estimate = replace(estimate, input_kind=first.input_kind, joint=first.added_mass.joint)
    return Recalibration(
        estimate=estimate,
        rejected=tuple(name for name in options.candidates if name not in names),
        carried=masses.pop() if len(masses) == 1 else None,
        cogging_periods=options.cogging_periods,
    )


def estimate_of(
    regression: Regression,
    run: NDArray[np.intp],
    solution: Solution,
    method: str,
    scale: FindingKind,
) -> Estimate:
    """Return the estimate of equations, with its values without each run if there are enough."""
    solved = regression.linearised(solution)
    left_out: dict[Hashable, Samples] = {}
    runs = np.unique(run)
    for number in runs.tolist() if runs.size >= _FEWEST_RUNS else []:
        values = without_logs(solved, np.unique(regression.cluster[run == number]).tolist())
        if np.isfinite(values).all():
            left_out[f"run {number}"] = values
    findings = [Finding(scale)]
    basis = Basis(method=method, left_out=left_out, findings=findings)
    return infer(Fit(linearisation=solved), basis)


def chosen_terms(equations: Linearisation, base: tuple[str, ...]) -> tuple[str, ...]:
    """Return the base and those of all terms that help to predict stretches that were held out."""
    folds = np.arange(equations.log.size) % _FOLDS
    rows = tuple(name for name in equations.names if name not in base)
    model = LinearModel(every=Submodels(equations=equations, folds=folds), optional=rows)
    terms = stagewise(model, rows, ()).model.terms
    return (*base, *(name for name in rows if name in terms))


class LoopEquations:
    """The equations of all logs of a re-calibration, with any terms."""

    def __init__(self, logs: Sequence[Log], zero: float, options: RecalibrationOptions) -> None:
        self._logs, self._delay = logs, options.delay
        self._averagings = [options.averaging(log, zero) for log in logs]

    def fit(self, names: tuple[str, ...]) -> tuple[Solution, Regression, NDArray[np.intp]]:
        """Return the solution, the equations in clusters of stretches, and each row's run."""
        about, needed = 0.0, {*names, "p1", "p3"}
        for _ in range(1 + _COMPRESSION_ROUNDS if "compression" in names else 1):
            rows, targets, clusters, runs, count = [], [], [], [], 0
            drive = DriveTerms(compression=about)
            for number, (log, averaging) in enumerate(
                zip(self._logs, self._averagings, strict=True)
            ):
                signals = averaging.signals(needed, delay=self._delay, drive=drive)
                mean = {name: column[signals.moving] for name, column in signals.mean.items()}
                added = log.added_mass
                known = added.inertia * mean["p1"] + added.gravity_moment * mean["p3"]
                rows.append(np.column_stack([mean[name] for name in names]))
                targets.append(-known if "p1" in names else -mean["p1"])
                clusters.append(count + np.arange(known.size) // SEGMENT)
                runs.append(np.full(known.size, number))
                count += -(-known.size // SEGMENT)
            regression = Regression(
                names=names,
                rows=np.concatenate(rows),
                target=np.concatenate(targets),
                cluster=np.concatenate(clusters),
                about={"compression": about},
                least=LEAST,
            )
            solution = regression.solve()
            if "compression" in names:
                about = float(solution.values[names.index("compression")])
        return solution, regression, np.concatenate(runs)


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel:
    """A fit of some of the terms of linear equations (see `stagewise.Model`)."""

    every: Submodels  # the equations with all terms
    optional: tuple[str, ...]  # terms that may be absent
    terms: frozenset[str] = frozenset()  # those that are fitted
    masses: Sequence[AddedMass] = ()
    simulates: bool = False

    @cached_property
    def nested(self) -> Submodels:
        """The equations about the values."""
        return self.every.about(self.values)

    @cached_property
    def is_fitted(self) -> NDArray[np.bool_]:
        """(n,) which of the parameters are fitted."""
        absent = {*self.optional} - self.terms
        absent |= companions(absent) - companions(self.terms)
        return np.array([name not in absent for name in self.every.names])

    @cached_property
    def values(self) -> Samples:
        """(n,) values of the parameters; nan if the equations do not determine them."""
        return np.asarray(self.every.fitted(self.is_fitted[np.newaxis])[0])

    def offers(self, rows: Collection[str]) -> list[Offer]:
        """Return score tests of missing terms."""
        return offers_in(self.nested, self.is_fitted, rows, self.masses)

    def adding(self, offer: Offer) -> LinearModel | None:
        """Return the fit with a term more; None if its value is on a bound."""
        more = replace(self, terms=self.terms | {offer.name})
        place = more.nested.names.index(offer.name)
        return more if more.values[place] > more.nested.equations.lower[place] else None

    def without(self, names: Collection[str]) -> LinearModel:
        """Return the fit without some terms."""
        return replace(self, terms=self.terms.difference(names))

    def confirms(self, rival: Mapping[str, float]) -> bool:
        """Whether a rival may be believed: what linear equations promise needs no other check."""
        here = dict(zip(self.nested.names, self.values.tolist(), strict=True))
        return is_near(rival, here, self.masses)

    @property
    def determined(self) -> bool:
        """Whether the equations determine the parameters."""
        return bool(np.isfinite(self.values).all())
