"""The weak form: the equation of motion against test functions, linear in the parameters.

Multiplied by a bump phi(t - c) and integrated by parts, (78) needs neither velocity nor
acceleration of the angle th:

    (p1 + Z) int phi'' th - p2 int phi' th + (p3 + X) int phi sin th + T_c int phi sgn thd + ...
        = p4 int phi u(t - d)

so every trajectory will do, not sines alone (Shinbrot, Trans. ASME 79, 1957; Messenger & Bortz,
J. Comput. Phys. 443, 2021). The bump is (1 - s^2)^4. Only the friction terms need a velocity, from
local polynomials; windows in which the joint sticks are left out, since friction is then not a
function of the motion. The delay enters as p4 d int phi' u, about the current one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple

import numpy as np

from butterfly.errors import require_number
from butterfly.identify.estimate import ParameterEstimate, Solved
from butterfly.identify.estimators.base import Estimator, names_of
from butterfly.identify.judgement.findings import Finding, FindingKind, Severity
from butterfly.identify.judgement.identifiability import refuse_one_mass
from butterfly.identify.judgement.intervals import without_each_mass
from butterfly.identify.regression import Regression
from butterfly.identify.weak_signals import HALF_WIDTH, Averaging
from butterfly.model.friction import require_periods
from butterfly.model.terms import FrictionTerms

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from butterfly.identify.data import DataSet
    from butterfly.logs.log import Log
    from butterfly.model.parameters import AddedMass

_ROUNDS = 8  # about the delay
_SETTLED = 1e-5  # s; less can go to and fro, as windows in which the joint sticks come and go


@dataclass(frozen=True, kw_only=True)
class WeakForm(Estimator):
    """p1..p4, Coulomb torque, delay and terms by linear least squares, from any input.

    Of at least two different added masses (none counts as one). The covariance is the
    cluster-robust one over logs; the intervals are widened to hold the estimates that leave one
    added mass out. Stribeck velocity is held.

    Parameters
    ----------
    terms
        Fitted besides p1..p4, Coulomb torque and delay.
    half_width
        Of the test functions in s; a sine's logs use at most a quarter period.
    cogging_periods
        Of a cogging torque in a turn, as known; the sine of one period is what p3 is.
    check
        Whether to fit again without each added mass.
    """

    method: Literal["weak-form"] = "weak-form"
    terms: tuple[str, ...] = ("drag",)
    half_width: float = HALF_WIDTH
    cogging_periods: float = 1.0
    check: bool = True

    summary: ClassVar[str] = "linear fit against test functions, for any input"

    def __post_init__(self) -> None:
        names_of(self.method, self.terms)
        require_number(self.method, positive=True, unit="s", half_width=self.half_width)
        require_periods(self.method, self.cogging_periods)

    def __call__(self, data: DataSet) -> ParameterEstimate:
        """Estimate from all logs of a data set (see `Estimator`)."""
        return self.of_logs(data.logs, data.equilibria)

    def of_logs(self, logs: Sequence[Log], zeros: Mapping[AddedMass, float]) -> ParameterEstimate:
        """Estimate from logs, given the encoder's reading in rad at rest for each added mass.

        Raises
        ------
        IdentifiabilityError
            If the logs cannot determine the parameters.
        InputError
            If a log is shorter than a test function.
        """
        refuse_one_mass(log.added_mass for log in logs)
        windows = [self._windows(log, zeros[log.added_mass]) for log in logs]
        solved = self._solve(windows)

        def without(mass: AddedMass) -> NDArray[np.float64]:
            return self._solve([each for each in windows if each.added != mass]).values

        masses = [log.added_mass for log in logs]
        left_out, said = without_each_mass(masses, without, asked=self.check)
        return ParameterEstimate.from_rows(
            solved,
            method="weak form",
            left_out=left_out,
            findings=said,
            held={"cogging_periods": self.cogging_periods},
            masses=masses,
        )

    def _solve(self, windows: Sequence[_Windows]) -> Solved:
        """Solve about a delay, and about the delay found, until it no longer moves."""
        names = names_of(self.method, self.terms)
        late, delay, settled = names.index("delay"), 0.0, False
        for _ in range(_ROUNDS):
            regression = _regression(windows, names, delay)
            solution = regression.solve()
            step, delay = solution.values[late] - delay, float(solution.values[late])
            settled = bool(abs(step) < _SETTLED)
            if settled:
                break
        rounds = Finding(kind=FindingKind.ROUNDS, number=_ROUNDS, severity=Severity.WARNING)
        return Solved.of(regression, solution, unsettled=None if settled else rounds)

    def _windows(self, log: Log, zero: float) -> _Windows:
        period = 2 * np.pi / log.excitation.omega if log.excitation else np.inf
        settings = FrictionTerms(cogging_periods=self.cogging_periods)
        half_width = min(self.half_width, period / 4)
        return _Windows(log.added_mass, Averaging(log, zero, half_width, settings))


class _Windows(NamedTuple):
    """A log's added mass, and what the log says over test functions."""

    added: AddedMass
    averaging: Averaging

    def equations(
        self, names: tuple[str, ...], delay: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(m, n) regressors and (m,) targets, the rms inertial term being 1/sqrt(m)."""
        signals = self.averaging.signals(names, delay=delay)
        rows = np.column_stack([signals.mean[name] for name in names])[signals.moving]
        inertia, gravity = rows[:, names.index("p1")], rows[:, names.index("p3")]
        size = float(np.linalg.norm(inertia)) or 1.0
        carried = self.added.inertia * inertia + self.added.gravity_moment * gravity
        return rows / size, -carried / size


def _regression(windows: Sequence[_Windows], names: tuple[str, ...], delay: float) -> Regression:
    """Put the windows of all logs together, each log weighing the same."""
    rows, targets = zip(*(each.equations(names, delay) for each in windows), strict=True)
    return Regression(
        names=names,
        rows=np.concatenate(rows),
        target=np.concatenate(targets),
        cluster=np.repeat(np.arange(len(windows)), [target.size for target in targets]),
        about={"delay": delay},
    )
