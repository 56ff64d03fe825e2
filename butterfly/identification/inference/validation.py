"""How well an estimator predicts logs that it has not seen."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FitSummary, FreeRun, fit_of
from butterfly.identification.inference.splits import ENOUGH_MASSES, Division, Split, divide, remedy
from butterfly.progress import Track, untracked

Fitter = Callable[[DataSet], Estimate]


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOut:
    """Prediction of what was left out.

    Parameters
    ----------
    division
        What was left out together.
    fits
        (n,) FIT in per cent of each log, over what was left out of it, each part of it simulated
        with the estimate from the others; NaN of logs that were never left out.
    estimates
        One for each part left out, by its name.
    horizon
        Longest stretch in s that was simulated at a time.
    """

    division: Division
    fits: NDArray[np.float64]
    estimates: dict[str, Estimate]
    horizon: float = math.inf

    @property
    def summary(self) -> FitSummary:
        """Median, mean and worst FIT."""
        return FitSummary.of(self.fits[~np.isnan(self.fits)], self.horizon)


def hold_out(
    data: DataSet,
    estimator: Fitter,
    split: Split = Split.AUTO,
    *,
    folds: int | None = None,
    track: Track = untracked,
) -> HeldOut:
    """Estimate from all logs but a part, predict that part, and go on to the next.

    Logs are simulated from their first sample on, also where a stretch of them was left out, whose
    FIT alone counts. Where the estimator finds no zero of the encoder, that of a left-out added
    mass is the mean angle of its own logs.

    Parameters
    ----------
    data
        The logs.
    estimator
        Estimates from a part of them.
    split, folds
        See `butterfly.identification.inference.splits.divide`.
    track
        Shows progress.

    Raises
    ------
    InputError
        If there cannot be so many folds.
    IdentifiabilityError
        If there are fewer than two parts, or the rest cannot determine the parameters.
    """
    division = divide(data, split, folds)
    errors, estimates, predictor = _Errors(data), {}, data.simulations
    horizon = math.inf
    for name, samples in track(division.parts.items(), f"In turns, {division.left_out}"):
        try:
            found = estimator(division.kept(data, name))
        except IdentifiabilityError as error:
            raise IdentifiabilityError(_refusal(data, division.split, name, error)) from None
        estimates[name] = found
        for number, stretch in samples.items():
            errors.add(number, stretch, predictor.run(number, found))
        horizon = min(horizon, predictor.horizon(found))
    return HeldOut(division=division, fits=errors.fits, estimates=estimates, horizon=horizon)


def _refusal(data: DataSet, split: Split, name: str, error: Exception) -> str:
    """Say why the rest is too little, and which split leaves enough."""
    part = f"the logs with {name}" if split is Split.MASS else name
    if split is Split.MASS and len(data.masses) == ENOUGH_MASSES - 1:
        return (
            f"without {part} there is one added mass left of two, which tells p1..p4 but for a "
            "common factor unless one of them is known (known: {p4: ...}, say)"
            f"{remedy(data, besides=split)}"
        )
    return f"without {part}: {error}{remedy(data, besides=split)}"


class _Errors:
    """Sums of squares in rad^2 over what was left out of each log so far."""

    def __init__(self, data: DataSet) -> None:
        self._angles = [log.angle for log in data.logs]
        self._squares = np.zeros((len(data.logs), 2))

    def add(self, number: int, stretch: slice, run: FreeRun) -> None:
        """Add the errors of a free run over a stretch of a log, and the motion there."""
        measured = self._angles[number]
        with np.errstate(over="ignore", invalid="ignore"):  # of a simulation that diverged
            error = float(np.sum((run.simulated[stretch] - measured[stretch]) ** 2))
        motion = float(np.sum((measured[stretch] - measured.mean()) ** 2))
        self._squares[number] += error, motion

    @property
    def fits(self) -> NDArray[np.float64]:
        """(n,) FIT in per cent; NaN where nothing was left out."""
        return np.array([fit_of(*each) if each.any() else np.nan for each in self._squares])
