"""The equations of a re-calibration, and which terms to keep in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.normal_equations import Regression, Solution
from butterfly.identification.test_functions import Averaging
from butterfly.logs.log import Log
from butterfly.orbit.recalibration_options import LEAST, RecalibrationOptions

FOLDS = 5
"""Parts that are held out in turn when terms are chosen."""

SEGMENT = 10
"""Test functions in a row, which share noise; such stretches count as independent."""

_SIGNIFICANT = 2.0  # standard errors by which a term must lower the held-out loss
_ROUNDS = 5  # about the compression, which alone is not linear


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations:
    """A regression whose clusters are stretches of runs, and the (m,) runs that rows are of."""

    regression: Regression
    run: NDArray[np.intp]


class Selection:
    """The equations of all logs of a re-calibration, with any terms.

    Parameters
    ----------
    logs
        Of runs next to the orbit.
    zero
        Encoder reading in rad of the hanging hand.
    options
        See `RecalibrationOptions`.
    """

    def __init__(self, logs: Sequence[Log], zero: float, options: RecalibrationOptions) -> None:
        self._logs, self._delay = logs, options.delay
        known = options.known(zero)
        self._averagings = [
            Averaging(log, known.zero, options.half_width, known.settings, options.balance)
            for log in logs
        ]

    def fit(self, names: tuple[str, ...]) -> tuple[Solution, Equations]:
        """Return values and which are on a bound, and the equations that they solve."""
        equations = self._equations(names, 0.0)
        solution = equations.regression.solve()
        for _ in range(_ROUNDS if "compression" in names else 0):
            about = float(solution.values[names.index("compression")])
            equations = self._equations(names, about)
            solution = equations.regression.solve()
        return solution, equations

    def select(self, base: tuple[str, ...], candidates: Sequence[str]) -> tuple[str, ...]:
        """Add terms one by one, the most helpful first, while held-out stretches gain by it."""
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
        """(k,) mean squared residuals of k stretches, each by a fit that has not seen it."""
        regression = self.fit(names)[1].regression
        squares = np.empty(regression.target.size)
        for fold in range(FOLDS):
            held = regression.cluster % FOLDS == fold
            values = regression.solve(~held).values
            squares[held] = regression.residuals(values)[held] ** 2
        sums = np.bincount(regression.cluster, squares)
        return np.asarray(sums / np.bincount(regression.cluster))

    def _equations(self, names: tuple[str, ...], about: float) -> Equations:
        rows, targets, clusters, runs, count = [], [], [], [], 0
        needed = {*names, "p1", "p3"}
        for number, (log, averaging) in enumerate(zip(self._logs, self._averagings, strict=True)):
            signals = averaging.signals(needed, delay=self._delay, compression=about)
            moving = signals.moving
            mean = {name: column[moving] for name, column in signals.mean.items()}
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
        return Equations(regression=regression, run=np.concatenate(runs))
