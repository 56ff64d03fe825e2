"""How well an estimator predicts logs that it has not seen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from butterfly.errors import IdentifiabilityError
from butterfly.identify.predict import FitSummary, Predictor
from butterfly.progress import Track, untracked

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from butterfly.identify.data import DataSet
    from butterfly.identify.estimate import ParameterEstimate

    Fitter = Callable[[DataSet], ParameterEstimate]

FREQUENCY_FOLDS = 5
"""Number of parts into which the drive frequencies are dealt, neighbours into different ones."""


class Split(StrEnum):
    """What is left out together."""

    MASS = "mass"
    FREQUENCY = "frequency"


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOut:
    """Prediction of logs that were left out.

    Parameters
    ----------
    split
        What was left out together.
    fits
        (n,) FIT in per cent of each log, simulated with the estimate from the others.
    estimates
        One for each part left out, by its name.
    horizon
        Longest stretch in s that was simulated at a time.
    """

    split: Split
    fits: NDArray[np.float64]
    estimates: dict[str, ParameterEstimate]
    horizon: float = math.inf

    @property
    def summary(self) -> FitSummary:
        """Median, mean and worst FIT."""
        return FitSummary.of(self.fits, self.horizon)


def hold_out(
    data: DataSet, estimator: Fitter, split: Split, *, track: Track = untracked
) -> HeldOut:
    """Estimate from all logs but a part, predict that part, and go on to the next.

    Where the estimator finds no zero of the encoder, that of a held-out added mass is the mean
    angle of its own logs.

    Raises
    ------
    IdentifiabilityError
        If there are fewer than two parts, or a part of the logs cannot determine the parameters.
    """
    parts = _parts(data, split)
    if len(parts) < 2:  # noqa: PLR2004 - nothing would be left to estimate from
        raise IdentifiabilityError(f"all logs have the same {split}: none can be held out")
    fits = np.empty(len(data.logs))
    estimates, predictor = {}, Predictor(data)
    horizon = math.inf
    for name, rows in track(parts.items(), f"Leaving out one {split} at a time"):
        rest = data.take([k for k in range(len(data.logs)) if k not in rows])
        try:
            found = estimator(rest)
        except IdentifiabilityError as error:
            raise IdentifiabilityError(f"without {name}: {error}") from None
        estimates[name] = found
        fits[rows] = predictor.fits(found, rows)
        horizon = min(horizon, predictor.horizon(found))
    return HeldOut(split=split, fits=fits, estimates=estimates, horizon=horizon)


def _parts(data: DataSet, split: Split) -> dict[str, list[int]]:
    parts: dict[str, list[int]] = {}
    omegas = sorted({log.excitation.omega for log in data.logs if log.excitation})
    for k, log in enumerate(data.logs):
        if split is Split.MASS:
            name = str(log.added_mass)
        elif log.excitation is None:
            continue
        else:
            name = f"part {omegas.index(log.excitation.omega) % FREQUENCY_FOLDS + 1}"
        parts.setdefault(name, []).append(k)
    return parts
