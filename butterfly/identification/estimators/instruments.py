"""The weak form's last step: its equations seen through those of the model's own motion.

The noise of the angle enters regressors and targets alike, so that least squares is biased by its
power. The same regressors of a simulation with the recorded inputs are free of it: equations that
are multiplied by them, not by their own regressors, are not biased by noise (instrumental
variables; Soderstrom & Stoica, Instrumental Variable Methods for System Identification, 1983;
Young, Automatica 17, 1981).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError
from butterfly.identification.diagnostics.goodness_of_fit import LEAST_FIT
from butterfly.identification.estimators.weak_fit import WeakFit, Windows
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.identification.regression import Regression, Solution
from butterfly.identification.zeros import reading_of
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass, LumpedParameters


class Seen(NamedTuple):
    """A log's windows, and those of its simulation (or again its own, where that fails)."""

    windows: Windows
    instruments: Windows


def seen(
    logs: Sequence[Log],
    windows: Sequence[Windows],
    parameters: LumpedParameters,
    zeros: Mapping[AddedMass, float],
    cut: Callable[[Log, float], Windows],
) -> list[Seen]:
    """Simulate logs, and cut the simulations into windows as the logs were cut.

    Parameters
    ----------
    logs, windows
        The logs, and what they were cut into.
    parameters
        Of the bare hand.
    zeros
        Encoder reading in rad at rest for each added mass, where a log tells none.
    cut
        From a log and its zero to windows.
    """
    if not parameters.p1 + min(log.added_mass.inertia for log in logs) > 0:
        return [Seen(each, each) for each in windows]
    pairs = []
    for log, own in zip(logs, windows, strict=True):
        zero = reading_of(log, zeros)
        run = FreeRun.of(log, Setting(parameters=parameters, zero=zero))
        like = run.fit > LEAST_FIT
        pairs.append(Seen(own, cut(replace(log, angle=run.simulated), zero) if like else own))
    return pairs


def refined(fit: WeakFit, pairs: Sequence[Seen]) -> WeakFit:
    """Return the fit of some logs through their instruments; what a bound holds stays there."""
    names = fit.solved.names
    moving = [
        windows.moving(fit.about.delay) & instruments.moving(fit.about.delay)
        for windows, instruments in pairs
    ]
    regression = fit.about.regression([each.windows for each in pairs], moving)
    through = fit.about.regression([each.instruments for each in pairs], moving)
    regression = _corrected(regression, through, fit, pairs)
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
    return fit.solved_by(regression, through, solution)


def _corrected(
    regression: Regression, through: Regression, fit: WeakFit, pairs: Sequence[Seen]
) -> Regression:
    """Take from equations of the logs what those of their simulations lack of balance.

    A simulation obeys the equation of motion with the parameters that it was made with; what its
    averages leave over is their own error, and the logs' averages have it too.
    """
    simulated = np.array([each.instruments is not each.windows for each in pairs])
    error = np.where(simulated[through.cluster], through.residuals(fit.solved.values), 0.0)
    return replace(regression, target=regression.target + error)


def _through(
    multiplied: NDArray[np.float64], rows: NDArray[np.float64], target: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Solve equations that are multiplied by instruments.

    Raises
    ------
    IdentifiabilityError
        If these logs do not move what is sought.
    """
    scale = np.linalg.norm(multiplied, axis=0)
    if not (scale > 0).all():
        raise IdentifiabilityError("these logs do not move all parameters")
    turned = (multiplied / scale).T
    try:
        return np.asarray(np.linalg.solve(turned @ (rows / scale), turned @ target) / scale)
    except np.linalg.LinAlgError:
        raise IdentifiabilityError("these logs do not tell the parameters apart") from None
