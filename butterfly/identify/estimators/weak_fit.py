"""The weak form's regression, solved about a delay until that no longer moves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from butterfly.identify.judgement.findings import Finding, FindingKind, Severity
from butterfly.identify.judgement.nested import Nested
from butterfly.identify.judgement.term_choice import NEGLIGIBLE
from butterfly.identify.regression import Regression
from butterfly.identify.solved import Solved

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.identify.regression import Solution
    from butterfly.identify.weak_signals import Averaging
    from butterfly.model.parameters import AddedMass

_ROUNDS = 8  # about the delay
_SETTLED = 1e-5  # s; less can go to and fro, as windows in which the joint sticks come and go


class Windows(NamedTuple):
    """A log's added mass, and what the log says over test functions."""

    added: AddedMass
    averaging: Averaging

    def moving(self, delay: float) -> NDArray[np.bool_]:
        """Whether the joint moves in each test function."""
        return self.averaging.signals((), delay=delay).moving

    def equations(
        self,
        names: tuple[str, ...],
        delay: float,
        slow: float,
        use: NDArray[np.bool_] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(m, n) regressors and (m,) targets, the rms inertial term being 1/sqrt(m).

        Of the test functions in which the joint moves, or of those that are to be used.
        """
        signals = self.averaging.signals(names, delay=delay, stribeck_velocity=slow)
        rows = np.column_stack([signals.mean[name] for name in names])
        rows = rows[signals.moving if use is None else use]
        inertia, gravity = rows[:, names.index("p1")], rows[:, names.index("p3")]
        size = float(np.linalg.norm(inertia)) or 1.0
        carried = self.added.inertia * inertia + self.added.gravity_moment * gravity
        return rows / size, -carried / size


@dataclass(frozen=True, kw_only=True, eq=False)
class WeakFit:
    """A solution, and the equations about it.

    Parameters
    ----------
    regression, solved
        The equations, and the solution.
    slow
        Stribeck velocity in rad/s.
    """

    regression: Regression
    solved: Solved
    slow: float

    @classmethod
    def of(
        cls, windows: Sequence[Windows], names: tuple[str, ...], slow: float, delay: float = 0.0
    ) -> WeakFit:
        """Solve about a delay, and about the delay found, until it no longer moves."""
        late, settled = names.index("delay"), False
        for _ in range(_ROUNDS):
            regression = _regression(windows, names, delay, slow)
            solution = regression.solve()
            step, delay = solution.values[late] - delay, float(solution.values[late])
            settled = bool(abs(step) < _SETTLED)
            if settled:
                break
        rounds = Finding(kind=FindingKind.ROUNDS, number=_ROUNDS, severity=Severity.WARNING)
        solved = Solved.of(regression, solution, unsettled=None if settled else rounds)
        return cls(regression=regression, solved=solved, slow=slow)

    @property
    def known(self) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.solved.names, self.solved.values.tolist(), strict=True))

    @property
    def delay(self) -> float:
        """From input to torque, in s."""
        return self.known["delay"]

    def about(self, windows: Sequence[Windows], use: Sequence[NDArray[np.bool_]]) -> Regression:
        """Return the equations of windows about this end, of test functions that are to be used."""
        return _regression(windows, self.solved.names, self.delay, self.slow, use)

    def solved_by(self, regression: Regression, through: Regression, solution: Solution) -> WeakFit:
        """Return a fit of some equations through instruments, whose rows stand for its own."""
        solved = replace(
            Solved.of(regression, solution),
            jacobian=through.jacobian(solution.values),
            ending=self.solved.ending,
            findings=self.solved.findings,
        )
        return replace(self, regression=through, solved=solved)

    def nested(
        self,
        windows: Sequence[Windows],
        names: tuple[str, ...],
        slow: float,
        folds: NDArray[np.intp],
    ) -> Nested:
        """Return the equations with other terms, or another Stribeck velocity, about this end."""
        regression = _regression(windows, names, self.delay, slow)
        values = np.array([self.known.get(name, 0.0) for name in names])
        jacobian, residuals = regression.jacobian(values), regression.residuals(values)
        ends = np.cumsum(np.bincount(regression.cluster, minlength=len(windows)))[:-1]
        parts = list(zip(np.split(jacobian, ends), np.split(residuals, ends), strict=True))
        return Nested(
            names=names,
            values=values,
            lower=regression.lower,
            curvature=np.array([rows.T @ rows for rows, _ in parts]),
            gradient=np.array([rows.T @ left for rows, left in parts]),
            cost=np.array([float(left @ left) for _, left in parts]),
            folds=folds,
            negligible=NEGLIGIBLE,
        )


def _regression(
    windows: Sequence[Windows],
    names: tuple[str, ...],
    delay: float,
    slow: float,
    use: Sequence[NDArray[np.bool_] | None] | None = None,
) -> Regression:
    """Put the windows of all logs together, each log weighing the same."""
    pairs = zip(windows, use or [None] * len(windows), strict=True)
    equations = [each.equations(names, delay, slow, used) for each, used in pairs]
    rows, targets = zip(*equations, strict=True)
    return Regression(
        names=names,
        rows=np.concatenate(rows),
        target=np.concatenate(targets),
        cluster=np.repeat(np.arange(len(windows)), [target.size for target in targets]),
        about={"delay": delay},
    )
