"""Uncertainty without formulas: estimates from logs drawn with replacement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.inference.intervals import CONFIDENCE
from butterfly.progress import Track, untracked

_LEAST_REPETITIONS = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class Bootstrap:
    """Estimates from resampled logs.

    Parameters
    ----------
    values
        (repetitions, n) estimates.
    lower, upper
        (n,) limits of the percentile intervals at `CONFIDENCE`.
    """

    values: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]


def bootstrap(
    data: DataSet,
    estimator: Estimator,
    estimate: Estimate,
    *,
    repetitions: int = 200,
    seed: int = 0,
    track: Track = untracked,
) -> Bootstrap:
    """Draw whole logs with replacement, within each added mass, and estimate anew.

    Logs are the blocks: within one, errors are correlated. (Efron & Tibshirani, An Introduction to
    the Bootstrap, 1993, ch. 8.) The terms are those of the estimate from all logs. Draws that
    cannot determine them are drawn again.

    Parameters
    ----------
    data
        The logs.
    estimator, estimate
        What is asked about: an estimator, and its estimate from all logs.
    repetitions, seed
        How often logs are drawn, and of the draws.

    Raises
    ------
    InputError
        If fewer than 20 repetitions are asked for.
    IdentifiabilityError
        If hardly any draw determines the parameters.
    """
    if repetitions < _LEAST_REPETITIONS:
        raise InputError("bootstrap", "repetitions", repetitions, f"at least {_LEAST_REPETITIONS}")
    held = estimator.holding_terms_of(estimate).unchecked()
    rng = np.random.default_rng(seed)
    groups = [
        [k for k, log in enumerate(data.logs) if log.added_mass == mass] for mass in data.masses
    ]
    values: list[NDArray[np.float64]] = []
    failures = 0
    for _ in track(range(repetitions), "Bootstrap"):
        while True:
            rows = [int(k) for group in groups for k in rng.choice(group, len(group))]
            try:
                values.append(_of_draw(data.take(rows), held, estimate.names))
                break
            except IdentifiabilityError:
                failures += 1
                if failures > repetitions:
                    raise
    tails = 100 * np.array([(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    lower, upper = np.percentile(values, tails, axis=0)
    return Bootstrap(values=np.array(values), lower=lower, upper=upper)


def _of_draw(drawn: DataSet, held: Estimator, names: tuple[str, ...]) -> NDArray[np.float64]:
    """Estimate parameters from drawn logs.

    Raises
    ------
    IdentifiabilityError
        If the logs cannot determine all of them.
    """
    found = held(drawn)
    if lost := [name for name in names if name not in found.names]:
        raise IdentifiabilityError(f"draws of these logs cannot tell {', '.join(lost)}")
    return found.values
