"""The weak form: the equation of motion against test functions, linear in the parameters.

Multiplied by a bump phi(t - c) and integrated by parts, (78) needs neither velocity nor
acceleration of the angle th:

    (p1 + Z) int phi'' th - p2 int phi' th + (p3 + X) int phi sin th + T_c int phi sgn thd + ...
        = p4 int phi u(t - d)

so every trajectory will do, not sines alone (Shinbrot, Trans. ASME 79, 1957; Messenger & Bortz,
J. Comput. Phys. 443, 2021). The bump is (1 - s^2)^4. Only the friction terms need a velocity, from
local polynomials; windows in which the joint sticks are left out, since friction is then not a
function of the motion. The delay enters as p4 d int phi' u, about the current one.

The noise of the angle enters regressors and targets alike, so that least squares is biased by its
power. The same regressors of a simulation with the recorded inputs are free of it: equations that
are multiplied by them, not by their own regressors, are not biased by noise (instrumental
variables; Soderstrom & Stoica, Instrumental Variable Methods for System Identification, 1983;
Young, Automatica 17, 1981).

Errors of the encoder's zero, which the fit took as given, add to its covariance: with the
residuals' slopes J by the parameters and g by the zero, an error e of the zero moves the estimate
by -(J^T J)^-1 J^T g e ("consider" parameters; Bierman, Factorization Methods for Discrete
Sequential Estimation, 1977, chapter VIII).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError, require_number
from butterfly.identification.blocks import Conditions, cells_of
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.plausibility import LEAST_FIT
from butterfly.identification.encoder_offset import offset_errors, reading_of
from butterfly.identification.equations import CellEquations, Solution
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.base import Estimator, require_names, require_usable
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.identification.inference.identifiability import ScaleParameter, is_driven
from butterfly.identification.inference.infer import FittedLogs, SolvedFit, infer
from butterfly.identification.inference.linear_terms import (
    STRIBECK,
    LinearProblem,
    TermChoice,
    optional_terms,
)
from butterfly.identification.test_functions import HALF_WIDTH
from butterfly.identification.weak_regression import WeakFit, Windows
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass, LumpedParameters, require_periods
from butterfly.model.prior import NO_PRIOR, Prior
from butterfly.model.terms import COMMON, OF_ANGLE, PARAMETERS, offered

_APART = 0.05  # rad between rest angles, whose cosines then differ by a thousandth


def fitted_terms(
    windows: Sequence[Windows],
    terms: tuple[str, ...] | None,
    known: Prior,
    offers: Sequence[str] = COMMON,
) -> tuple[WeakFit, TermChoice]:
    """Fit given terms, or, without any, those that are chosen from some offers."""
    base, masses = known.fitted(PARAMETERS), [each.added for each in windows]
    rows = optional_terms(terms, offers, masses, known)
    candidates = tuple(name for name in rows if name != STRIBECK) if terms is None else ()
    first = WeakFit.of(windows, (*base, *candidates), known)
    problem = LinearProblem(
        equations=first.equations,
        base=base,
        terms=rows,
        masses=masses,
        known=known,
        fastest=max(each.averaging.fastest for each in windows),
    )
    chosen = problem.fitted(choosing=terms is None)
    slow = chosen.settings.get("stribeck_velocity", first.about.slow)
    return WeakFit.settled(replace(first.about, names=chosen.names, slow=slow)), chosen


@dataclass(frozen=True, kw_only=True)
class WeakForm(Estimator):
    """Estimate p1..p4, coulomb, delay and terms by linear least squares, from any input.

    Needs at least two different added masses (none counts as one), or enough known values. The
    covariance is cluster-robust over logs; the intervals are widened to include the
    leave-one-mass-out estimates, and those with other terms that predict as well. The Stribeck
    velocity comes from a grid search.

    Parameters
    ----------
    terms
        Terms fitted besides p1..p4, coulomb and delay; if not given, those that improve the
        prediction of held-out logs.
    half_width
        Half width of the test functions in s; sine logs use at most a quarter period.
    cogging_periods
        Periods of the cogging torque per turn; must be known. One period would be the same as p3.
    """

    method: Literal["weak-form"] = "weak-form"
    terms: tuple[str, ...] | None = None
    half_width: float = HALF_WIDTH
    cogging_periods: float = 1.0

    summary: ClassVar[str] = "linear fit against test functions, for any input"

    def __post_init__(self) -> None:
        require_names(self.method, "terms", self.terms or (), offered(self.method))
        require_number(self.method, positive=True, unit="s", half_width=self.half_width)
        require_periods(self.method, self.cogging_periods)

    def __call__(self, data: DataSet) -> Estimate:
        """Estimate from all logs of a data set (see `Estimator`)."""
        data.require_angles(*OF_ANGLE.intersection(self.terms or ()))
        zeros = data.equilibria
        uncertain = offset_errors(data.offsets) if data.hangs else None
        found = self.of_logs(data.logs, zeros, data.known, uncertain)
        if data.guessed:
            found = found.with_findings(Finding(FindingKind.ZERO_GUESSED, logs=data.guessed))
        apart = max(zeros.values()) - min(zeros.values())
        if data.unread and apart >= _APART:
            found = found.with_findings(Finding(FindingKind.REST_APART, number=apart))
        return found

    def of_logs(
        self,
        logs: Sequence[Log],
        zeros: Mapping[AddedMass, float],
        known: Prior = NO_PRIOR,
        uncertain: Samples | None = None,
    ) -> Estimate:
        """Estimate from logs, given the encoder's zero in rad for each added mass."""
        require_usable(self.method, known)
        masses, reference = [log.added_mass for log in logs], ScaleParameter.of_logs(logs, known)
        periods = known.fixed.get("cogging_periods", self.cogging_periods)
        windows = [
            Windows.of(log, reading_of(log, zeros), self.half_width, periods) for log in logs
        ]
        plain, terms = fitted_terms(windows, self.terms, reference.fixed)
        fixed = terms.settings | {"cogging_periods": periods}
        pairs = seen(logs, windows, LumpedParameters(**fixed | plain.values), zeros)
        fit = refined(plain, pairs)

        solved, cells = fit.solved, cells_of(len(logs), len(fit.solved.names))
        rivals = [each + solved.values - plain.solved.values for each in terms.rival_values]
        whole = reference.whole(solved)
        doubt = None if uncertain is None else offset_covariance(fit, pairs, uncertain, whole.names)
        counted = solved.log.size == cells * len(logs)
        conditions = Conditions.of(logs, cells) if counted else None  # which are cell by cell
        return infer(
            SolvedFit(
                method="weak form",
                equations=whole,
                rivals=[reference.grown(each, solved.names) for each in rivals],
                consider_covariance=doubt,
                torques=True,
                fixed=fixed,
                findings=terms.findings,
            ),
            FittedLogs(masses, conditions, known, is_driven(logs)),
        )

    def path(self, data: DataSet, candidates: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
        """Return the terms after each round of a stagewise choice from some candidates."""
        self.with_terms(candidates)
        known = ScaleParameter.of_logs(data.logs, data.known).fixed
        periods = known.fixed.get("cogging_periods", self.cogging_periods)
        windows = [
            Windows.of(log, data.zero_of(log), self.half_width, periods) for log in data.logs
        ]
        return fitted_terms(windows, None, known, candidates)[1].path


class Seen(NamedTuple):
    """A log's windows, and those of its simulation (or again its own, where that fails)."""

    windows: Windows
    instruments: Windows

    def moving(self, delay: float) -> NDArray[np.bool_]:
        """Whether the joint moves in each test function, in both."""
        return self.windows.moving(delay) & self.instruments.moving(delay)


def seen(
    logs: Sequence[Log],
    windows: Sequence[Windows],
    parameters: LumpedParameters,
    zeros: Mapping[AddedMass, float],
) -> list[Seen]:
    """Simulate logs, and cut the simulations into windows as the logs were."""
    if not parameters.p1 + min(log.added_mass.inertia for log in logs) > 0:
        return [Seen(each, each) for each in windows]
    pairs = []
    for log, own in zip(logs, windows, strict=True):
        zero = reading_of(log, zeros)
        run = FreeRun.of(log, Setting(parameters=parameters, zero=zero))
        like = own._replace(averaging=own.averaging.moving_so(run.simulated))
        pairs.append(Seen(own, like if run.fit > LEAST_FIT else own))
    return pairs


def refined(fit: WeakFit, pairs: Sequence[Seen]) -> WeakFit:
    """Return the fit of some logs through their instruments; what a bound holds stays there."""
    names = fit.solved.names
    moving = [each.moving(fit.about.delay) for each in pairs]
    regression = fit.about.regression(moving)
    through = replace(fit.about, windows=[each.instruments for each in pairs]).regression(moving)
    # what the simulations lack of balance is taken from the logs
    simulated = np.array([each.instruments is not each.windows for each in pairs])
    error = np.where(simulated[through.cluster], through.residuals(fit.solved.values), 0.0)
    regression = replace(regression, target=regression.target + error)
    more, wanted = regression.known_rows
    rows, target = np.concatenate([regression.rows, more]), np.append(regression.target, wanted)
    multiplied = np.concatenate([through.rows, more])
    free = ~fit.solved.on_bound
    held = np.zeros(len(names), dtype=bool)
    while True:
        unknowns = np.zeros(len(names))
        unknowns[free] = _through(multiplied[:, free], rows[:, free], target)
        values = regression.values(unknowns)
        low = free & (values < regression.lower)
        if not low.any():
            break
        free, held = free & ~low, held | low
    solution = Solution(values=values, on_bound=fit.solved.on_bound | held)
    cells = cells_of(len(pairs), len(names))
    solved = replace(
        CellEquations.of(regression, solution, cells=cells, jacobian=through.jacobian(values)),
        ending=fit.solved.ending,
        unsettled=fit.solved.unsettled,
    )
    return replace(fit, regression=through, solved=solved)


def _through(multiplied: Samples, rows: Samples, target: Samples) -> Samples:
    """Solve equations that are multiplied by instruments."""
    scale = np.linalg.norm(multiplied, axis=0)
    if not (scale > 0).all():
        raise IdentifiabilityError("these logs do not excite all parameters")
    turned = (multiplied / scale).T
    try:
        return np.asarray(np.linalg.solve(turned @ (rows / scale), turned @ target) / scale)
    except np.linalg.LinAlgError:
        raise IdentifiabilityError("the parameters cannot be separated with these logs") from None


def offset_covariance(
    fit: WeakFit, pairs: Sequence[Seen], uncertain: Samples, names: Sequence[str]
) -> Samples:
    """(n, n) covariance that (k, logs) errors of zeros add to n parameters."""
    solved, errors = fit.solved, zip(pairs, uncertain.T, strict=True)
    slopes = np.concatenate([np.outer(_slopes(fit, each), own) for each, own in errors])
    pulls = slopes.T @ fit.regression.jacobian(solved.values)
    added = np.zeros((len(names), len(names)))
    places = [list(names).index(name) for name in solved.names]
    for pull in pulls:
        moved = solved.change_by(pull)
        added[np.ix_(places, places)] += np.outer(moved, moved)
    return added


def _slopes(fit: WeakFit, each: Seen) -> Samples:
    """(m,) derivatives of a log's residuals by its zero, of the test functions that were used."""
    used = each.moving(fit.about.delay)
    rows, _ = each.instruments.equations(("p3", "p3_offset"), fit.about, used)
    moment = fit.values["p3"] + each.instruments.added.gravity_moment
    return np.asarray(rows @ [fit.values.get("p3_offset", 0.0), -moment])
