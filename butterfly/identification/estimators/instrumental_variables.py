"""The weak form's last step: its equations seen through those of the model's own motion.

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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError
from butterfly.identification.diagnostics.plausibility import LEAST_FIT
from butterfly.identification.encoder_offset import reading_of
from butterfly.identification.estimators.weak_regression import WeakFit, Windows
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.identification.normal_equations import Regression, Solution, scaled_least_squares
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass, LumpedParameters

Samples = NDArray[np.float64]


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

    ``logs``, ``windows``: the logs, and what they were cut into; ``parameters``: of the bare hand;
    ``zeros``: encoder reading in rad at rest for each added mass, where a log tells none; ``cut``:
    from a log and its zero to windows.
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
    """Solve equations that are multiplied by instruments."""
    scale = np.linalg.norm(multiplied, axis=0)
    if not (scale > 0).all():
        raise IdentifiabilityError("these logs do not move all parameters")
    turned = (multiplied / scale).T
    try:
        return np.asarray(np.linalg.solve(turned @ (rows / scale), turned @ target) / scale)
    except np.linalg.LinAlgError:
        raise IdentifiabilityError("these logs do not tell the parameters apart") from None


def offset_covariance(
    fit: WeakFit, pairs: Sequence[Seen], uncertain: Samples, names: Sequence[str]
) -> Samples:
    """(n, n) covariance that uncertain zeros add to n parameters.

    The fit is of the m logs' windows through their instruments; ``uncertain`` are (k, m) standard
    uncertainties in rad of k independent errors (see `encoder_offset.offset_errors`). Parameters
    that the fit held are not moved.
    """
    added = np.zeros((len(names), len(names)))
    if not uncertain.size:
        return added
    slopes = [_slopes(fit, each) for each in pairs]
    errors = np.column_stack(
        [
            np.concatenate([size * slope for size, slope in zip(row, slopes, strict=True)])
            for row in uncertain
        ]
    )
    free = ~fit.solved.on_bound
    rows, _ = fit.solved.with_prior(fit.solved.jacobian[:, None], fit.solved.residuals)
    rows = rows[:, free]
    errors = np.concatenate([errors, np.zeros((rows.shape[0] - errors.shape[0], len(uncertain)))])
    moved = -scaled_least_squares(rows, errors)
    found = (name for name, is_free in zip(fit.solved.names, free, strict=True) if is_free)
    places = [list(names).index(name) for name in found]
    added[np.ix_(places, places)] = moved @ moved.T
    return added


def _slopes(fit: WeakFit, each: Seen) -> Samples:
    """(m,) derivatives of a log's residuals by its zero, of the test functions that were used."""
    used = each.windows.moving(fit.about.delay) & each.instruments.moving(fit.about.delay)
    names = ("p1", "p3", "p3_offset")
    signals = each.instruments.averaging.signals(names, delay=fit.about.delay)
    inertia, sine, cosine = (signals.mean[name][used] for name in names)
    moment = fit.values["p3"] + each.instruments.added.gravity_moment
    offset = fit.values.get("p3_offset", 0.0)
    size = float(np.linalg.norm(inertia)) or 1.0
    return np.asarray((offset * sine - moment * cosine) / size)
