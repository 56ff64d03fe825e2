"""The weak form: the equation of motion against test functions, linear in the parameters.

Multiplied by a bump phi(t - c) and integrated by parts, (78) needs neither velocity nor
acceleration of the angle th:

    (p1 + Z) int phi'' th - p2 int phi' th + (p3 + X) int phi sin th + T_c int phi sgn thd + ...
        = p4 int phi u(t - d)

so every trajectory will do, not sines alone (Shinbrot, Trans. ASME 79, 1957; Messenger & Bortz,
J. Comput. Phys. 443, 2021). The bump is (1 - s^2)^4. Only the friction terms need a velocity, from
local polynomials; windows in which the joint sticks are left out, since friction is then not a
function of the motion. The delay enters as p4 d int phi' u, about the current one.

The noise of the angle enters regressors and targets alike: its power biases least squares. The same
regressors of a simulation with the recorded inputs are free of it: equations that are multiplied by
them, not by the noisy regressors, are not biased by noise (instrumental variables; Soderstrom &
Stoica, Instrumental Variable Methods for System Identification, 1983; Young, Automatica 17, 1981).

Errors of the encoder's zero, which the fit took as given, add to its covariance: with the
residuals' slopes J by the parameters and g by the zero, an error e of the zero moves the estimate
by -(J^T J)^-1 J^T g e ("consider" parameters; Bierman, Factorization Methods for Discrete
Sequential Estimation, 1977, chapter VIII).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError, require_names, require_number
from butterfly.identification.agreement import Conditions
from butterfly.identification.consistency import is_driven, prior_of_fit
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.base import Estimator
from butterfly.identification.fit import Fit
from butterfly.identification.free_run import LEAST_FIT, FreeRun, Setting
from butterfly.identification.infer import Basis
from butterfly.identification.limits import Conditioning, cells_of
from butterfly.identification.linearisation import Solution
from butterfly.identification.test_functions import Averaging
from butterfly.identification.trust import Finding, FindingKind
from butterfly.identification.weak_regression import (
    WeakFit,
    averaging_of,
    offset_errors,
    reading_of,
)
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass, LumpedParameters, require_periods
from butterfly.model.prior import NO_PRIOR, Prior, require_usable
from butterfly.model.terms import OF_ANGLE, OF_GRAVITY, PARAMETERS, offered

_DIFFERENT = 0.05  # rad between rest angles, whose cosines then differ by a thousandth


@dataclass(frozen=True, kw_only=True)
class WeakForm(Estimator):
    """Estimate p1..p4, coulomb, delay and terms by linear least squares, from any input.

    Needs at least two different added masses (none counts as one), or enough known values. The
    covariance is cluster-robust over logs; the intervals are widened to include the
    leave-one-mass-out estimates. Stribeck friction has the known velocity, or else a tenth of the
    largest speed.

    Parameters
    ----------
    terms
        Terms fitted besides p1..p4, coulomb and delay. Default: none.
    half_width
        Half width of the test functions in s; if not given, each log's own, from its duration, its
        period and its noise.
    cogging_periods
        Periods of the cogging torque per turn; must be known. One period would be the same as p3.
    """

    method: Literal["weak-form"] = "weak-form"
    terms: tuple[str, ...] = ()
    half_width: float | None = None
    cogging_periods: float = 1.0

    summary: ClassVar[str] = "linear fit against test functions, for any input"

    def __post_init__(self) -> None:
        require_names(self.method, "terms", self.terms, offered(self.method))
        if self.half_width is not None:
            require_number(self.method, positive=True, unit="s", half_width=self.half_width)
        require_periods(self.method, self.cogging_periods)

    def fit(self, data: DataSet) -> tuple[Basis, Fit]:
        """Fit all logs of a data set."""
        data.require_angles(*OF_ANGLE.intersection(self.terms))
        zeros = data.equilibria
        uncertain = offset_errors(data.offsets) if data.hangs else None
        basis, fit = self._of_logs(data.logs, zeros, data.known, uncertain)
        findings = [Finding(FindingKind.ZERO_GUESSED, logs=data.guessed)] if data.guessed else []
        spread = max(zeros.values()) - min(zeros.values())
        if data.unread and spread >= _DIFFERENT:
            findings.append(Finding(FindingKind.REST_DIFFERS, number=spread))
        return basis, replace(fit, findings=(*fit.findings, *findings))

    def of_logs(
        self,
        logs: Sequence[Log],
        zeros: Mapping[AddedMass, float],
        known: Prior = NO_PRIOR,
        uncertain: Samples | None = None,
    ) -> Estimate:
        """Estimate from logs, given the encoder's zero in rad for each added mass."""
        return self.infer(*self._of_logs(logs, zeros, known, uncertain))

    def _of_logs(
        self,
        logs: Sequence[Log],
        zeros: Mapping[AddedMass, float],
        known: Prior,
        uncertain: Samples | None,
    ) -> tuple[Basis, Fit]:
        """Fit logs (see `of_logs`); ``uncertain``: (k, logs) errors of their zeros in rad."""
        weak = self.through_instruments(logs, zeros, known)
        solved, cells = weak.solved, cells_of(len(logs), len(weak.solved.names))
        counted = solved.log.size == cells * len(logs)
        basis = Basis(
            method="weak form",
            masses=[log.added_mass for log in logs],
            conditions=Conditions.of(logs, cells) if counted else None,  # one per cell
            known=weak.about.known,
            driven=is_driven(logs),
            timed=all(log.excitation for log in logs),
            consider_covariance=None if uncertain is None else offset_covariance(weak, uncertain),
            torques=True,
            fixed=weak.settings,
        )
        return basis, weak.fit

    def through_instruments(
        self, logs: Sequence[Log], zeros: Mapping[AddedMass, float], known: Prior
    ) -> WeakFit:
        """Return the regression of logs through instruments (see `of_logs`)."""
        require_usable(self.method, known)
        plain = self.least_squares(logs, zeros, prior_of_fit(logs, known))
        return refined(plain, instruments_of(logs, plain.about.windows, plain.parameters, zeros))

    def least_squares(
        self, logs: Sequence[Log], zeros: Mapping[AddedMass, float], known: Prior
    ) -> WeakFit:
        """Return the least-squares fit, which noise of the angle biases."""
        periods = known.fixed.get("cogging_periods", self.cogging_periods)
        windows = [
            averaging_of(log, reading_of(log, zeros), self.half_width, periods) for log in logs
        ]
        names = known.fitted((*PARAMETERS, *(self.terms)))
        _require_enough(windows, names, known.fixed.get("delay", 0.0))
        return WeakFit.of(windows, names, known, periods)


def _require_enough(windows: Sequence[Averaging], names: Sequence[str], delay: float) -> None:
    """Raise IdentifiabilityError if the joint moves in fewer windows than there are values."""
    moving = sum(int(window.moving(delay).sum()) for window in windows)
    if moving >= len(names):
        return
    longest = max(windows, key=lambda window: window.duration)
    hold = (
        f"{longest.duration:.3g} s contain" if len(windows) == 1 else f"{len(windows)} logs contain"
    )
    plural, length = "" if moving == 1 else "s", 2 * longest.half_width
    raise IdentifiabilityError(
        f"{hold} {moving or 'no'} window{plural} of {length:.3g} s in which the joint moves, fewer "
        f"than the {len(names)} values to be found ({', '.join(names)}): record longer, or in "
        "motion, or give a shorter half_width"
    )


def instruments_of(
    logs: Sequence[Log],
    windows: Sequence[Averaging],
    parameters: LumpedParameters,
    zeros: Mapping[AddedMass, float],
) -> list[Averaging]:
    """Return the averages of each log's simulation, or of the log itself where that fails."""
    if not parameters.p1 + min(log.added_mass.inertia for log in logs) > 0:
        return [*windows]
    instruments = []
    for log, window in zip(logs, windows, strict=True):
        run = FreeRun.of(log, Setting(parameters=parameters, zero=reading_of(log, zeros)))
        follows = run.fit > LEAST_FIT
        instruments.append(window.with_measurement(run.simulated) if follows else window)
    return instruments


def refined(fit: WeakFit, instruments: Sequence[Averaging]) -> WeakFit:
    """Return the instrumental-variables estimate about a fit; active bounds stay active."""
    names, pairs = fit.solved.names, [*zip(fit.about.windows, instruments, strict=True)]
    delay = fit.about.delay
    moving = [window.moving(delay) & other.moving(delay) for window, other in pairs]
    regression = replace(fit.about, use=moving).regression()
    about = replace(fit.about, windows=instruments, use=moving)
    through = about.regression()
    # errors of balance of the simulations are subtracted from those of the logs
    simulated = np.array([window is not other for window, other in pairs])
    error = np.where(simulated[through.cluster], through.residuals(fit.solved.values), 0.0)
    regression = replace(regression, target=regression.target + error)
    more, wanted = regression.known_rows
    rows, target = np.concatenate([regression.rows, more]), np.append(regression.target, wanted)
    multiplied = np.concatenate([through.rows, more])
    free = ~fit.solved.on_bound
    while True:
        unknowns = np.zeros(len(names))
        some = tuple(np.array(names)[free].tolist())
        unknowns[free] = _through(multiplied[:, free], rows[:, free], target, some)
        values = regression.values(unknowns)
        low = free & (values < regression.lower)
        if not low.any():
            break
        free &= ~low
    solution = Solution(values=values, on_bound=~free)
    cells = cells_of(len(instruments), len(names))
    solved = regression.linearised(solution, cells=cells, jacobian=through.jacobian(values))
    return WeakFit(about=about, regression=through, fit=replace(fit.fit, linearisation=solved))


def _through(
    multiplied: Samples, rows: Samples, target: Samples, names: tuple[str, ...]
) -> Samples:
    """Return the (n,) solution of equations multiplied by instruments, or refuse them by names."""
    scale = np.linalg.norm(multiplied, axis=0)
    if not (scale > 0).all():
        raise IdentifiabilityError("these logs do not excite all parameters")
    turned = (multiplied / scale).T
    try:
        return np.asarray(np.linalg.solve(turned @ (rows / scale), turned @ target) / scale)
    except np.linalg.LinAlgError:
        raise Conditioning.of(rows, names).refusal from None


def offset_covariance(fit: WeakFit, uncertain: Samples) -> Samples:
    """(n, n) covariance that (k, logs) errors of zeros add to the n values of a fit."""
    solved, masses = fit.solved, [window.added for window in fit.about.windows]
    gravity = replace(fit.about, names=OF_GRAVITY).regression()
    moment = fit.values["p3"] + np.array([mass.gravity_moment for mass in masses])
    slopes = gravity.rows[:, 0] * fit.values.get("p3_offset", 0.0)
    slopes -= gravity.rows[:, 1] * moment[gravity.cluster]
    pulls = (uncertain[:, gravity.cluster] * slopes) @ fit.regression.jacobian(solved.values)
    moved = np.reshape([solved.inverse @ pull for pull in pulls], pulls.shape)
    return np.asarray(moved.T @ moved)
