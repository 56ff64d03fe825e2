"""The linear equations of a re-calibration, their constrained solution, and which terms to keep."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import lsq_linear

from butterfly.identify.estimate import lower_bounds
from butterfly.identify.weak_signals import WeakSignals, weak_signals

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.orbit.recalibration import RecalibrationOptions

BASE = ("p1", "p2", "p3", "p4")
"""Always estimated."""

FOLDS = 5
"""Parts that are held out in turn when terms are chosen."""

_SEGMENT = 10  # test functions in a row, which share noise; segments count as independent
_SIGNIFICANT = 2.0  # standard errors by which a term must lower the held-out loss
_ROUNDS = 5  # about the compression, which alone is not linear


def least(names: Sequence[str]) -> NDArray[np.float64]:
    """(n,) least values of parameters: as everywhere, and the input drives forwards."""
    return np.where(np.isin(names, ["p4", "compression"]), 0.0, lower_bounds(names))


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations:
    """What the test functions say: ``rows`` times the unknowns is ``target``.

    The unknowns are the parameters themselves, but for the compression c: p4 (c - about).

    Parameters
    ----------
    names
        Of the n parameters; without p1 among them it is taken as 1.
    rows, target
        (m, n) and (m,).
    segment, run
        (m,) numbers of the few consecutive test functions that a row belongs to, and of its run.
    about
        Compression about which the equations are linear.
    """

    names: tuple[str, ...]
    rows: NDArray[np.float64]
    target: NDArray[np.float64]
    segment: NDArray[np.intp]
    run: NDArray[np.intp]
    about: float

    def solve(
        self, use: NDArray[np.bool_] | slice = slice(None)
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return (n,) values from the rows to use, and which of them are held by a bound."""
        rows, target = self.rows[use], self.target[use]
        scale = np.linalg.norm(rows, axis=0)
        scale[scale == 0] = 1.0  # a column of zeros stays without effect
        free = (np.array(self.names) == "compression") & (self.about > 0)
        lowest = np.where(free, -np.inf, least(self.names))
        fit = lsq_linear(rows / scale, target, (lowest, np.inf), method="bvls", tol=1e-14)
        values = fit.x / scale
        values = values / self._slopes(values) + self._shift()
        return np.maximum(values, least(self.names)), np.asarray(fit.active_mask != 0)

    def residuals(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m,) left sides less right sides, with (n,) values."""
        return self.jacobian(values) @ (values - self._shift()) - self.target

    def jacobian(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m, n) derivatives of the residuals by the values, about (n,) values."""
        return self.rows * self._slopes(values)

    def _slopes(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        gain = max(float(values[self.names.index("p4")]), 1e-300)
        return np.where(np.array(self.names) == "compression", gain, 1.0)

    def _shift(self) -> NDArray[np.float64]:
        return np.where(np.array(self.names) == "compression", self.about, 0.0)


class Regression:
    """All logs of a re-calibration.

    Parameters
    ----------
    logs
        Of runs next to the orbit.
    zero
        Encoder reading in rad of the hanging hand.
    options
        See `butterfly.orbit.recalibration.RecalibrationOptions`.
    """

    def __init__(self, logs: Sequence[Log], zero: float, options: RecalibrationOptions) -> None:
        self._logs, self._zero, self._options = logs, zero, options
        self._signals = lru_cache(maxsize=4)(self._all_signals)

    def fit(
        self, names: tuple[str, ...]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], Equations]:
        """Return (n,) values, which are on a bound, and the equations that they solve."""
        equations = self._equations(names, 0.0)
        values, on_bound = equations.solve()
        for _ in range(_ROUNDS if "compression" in names else 0):
            equations = self._equations(names, float(values[names.index("compression")]))
            values, on_bound = equations.solve()
        return values, on_bound, equations

    def select(self, base: tuple[str, ...], candidates: Sequence[str]) -> tuple[str, ...]:
        """Add terms one by one, the most helpful first, while held-out segments gain by it."""
        chosen: tuple[str, ...] = ()
        losses = self._held_out_losses(base)
        while True:
            gains = {
                name: losses - self._held_out_losses((*base, *chosen, name))
                for name in candidates
                if name not in chosen
            }
            helpful = {
                name: float(gain.mean())
                for name, gain in gains.items()
                if gain.mean() > _SIGNIFICANT * gain.std(ddof=1) / gain.size**0.5
            }
            if not helpful:
                return chosen
            best = max(helpful, key=lambda name: helpful[name])
            chosen = (*chosen, best)
            losses = losses - gains[best]

    def _held_out_losses(self, names: tuple[str, ...]) -> NDArray[np.float64]:
        """(k,) mean squared residuals of k segments, each by a fit that has not seen it."""
        _, _, equations = self.fit(names)
        squares = np.empty(equations.target.size)
        for fold in range(FOLDS):
            held = equations.segment % FOLDS == fold
            values, _ = equations.solve(~held)
            squares[held] = equations.residuals(values)[held] ** 2
        return np.asarray(np.bincount(equations.segment, squares) / np.bincount(equations.segment))

    def _equations(self, names: tuple[str, ...], about: float) -> Equations:
        rows, targets, segments, runs, count = [], [], [], [], 0
        for number, (log, signals) in enumerate(zip(self._logs, self._signals(about), strict=True)):
            moving = signals.moving
            mean = {name: column[moving] for name, column in signals.mean.items()}
            added = log.added_mass
            known = added.inertia * mean["p1"] + added.gravity_moment * mean["p3"]
            rows.append(np.column_stack([mean[name] for name in names]))
            targets.append(-known if "p1" in names else -mean["p1"])
            segments.append(count + np.arange(known.size) // _SEGMENT)
            runs.append(np.full(known.size, number))
            count += -(-known.size // _SEGMENT)
        return Equations(
            names=names,
            rows=np.concatenate(rows),
            target=np.concatenate(targets),
            segment=np.concatenate(segments),
            run=np.concatenate(runs),
            about=about,
        )

    def _all_signals(self, compression: float) -> list[WeakSignals]:
        options = self._options
        return [
            weak_signals(
                log,
                self._zero,
                options.half_width,
                options.delay,
                balance=options.balance,
                cogging_periods=options.cogging_periods,
                compression=compression,
            )
            for log in self._logs
        ]
