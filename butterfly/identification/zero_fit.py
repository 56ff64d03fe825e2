"""The equation of motion itself tells where its angle is 0, whatever the trajectory.

Divided by the inertia, and averaged over test functions, it is linear in all that is not known,

    thdd = -p2' thd - a sin th - b cos th - T_c' sgn thd + p4' u(t - d),

and a sin th + b cos th = sqrt(a^2 + b^2) sin(th - z) with the zero z = -atan2(b, a): no scale is
needed, no added mass, no guess, and whole turns make no difference. Where the motion is wide enough
to tell a constant torque from gravity, and there is one, it is fitted along.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError
from butterfly.identification.inference.covariance import (
    blocks_of,
    cluster_covariance,
    compress_all,
    split,
)
from butterfly.identification.weak_signals import HALF_WIDTH, Averaging
from butterfly.logs.log import Log
from butterfly.model.terms import FrictionTerms

Samples = NDArray[np.float64]

_TARGET, _GRAVITY, _BIAS = "p1", ("p3", "p3_offset"), "bias"
_NAMES = (*_GRAVITY, "p2", "coulomb", "p4", "delay")
_PER_UNKNOWN = 3  # test functions at least
_OF_LOG = 1 / 16  # longest half-width of a test function
_WELL = 0.02  # rad: a zero beside a bias that is as well known
_SEEN = 5.0  # standard errors of a bias that counts
_INDEPENDENT = 1e-6  # least share of a column that the others do not explain


@dataclass(frozen=True, kw_only=True)
class FittedZero:
    """What the motion of some logs with one added mass tells."""

    # value, uncertainty: encoder reading in rad where the model's angle is 0, and its standard
    # error
    value: float
    uncertainty: float
    friction: float  # Coulomb torque over the moment of gravity


def fitted_zero(logs: Sequence[Log]) -> FittedZero | None:
    """Return the zero that logs with the same added mass share; None where they tell none.

    ``logs``: with increasing stamps, of any input.
    """
    about = float(np.median(logs[0].angle))
    parts = [part for log in logs if (part := _averages(log, about)) is not None]
    if not parts:
        return None
    means = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    cluster = np.repeat(np.arange(len(parts)), [part[_TARGET].size for part in parts])
    plain = _solved(means, _NAMES, cluster, about)
    biased = _solved(means, (*_NAMES, _BIAS), cluster, about)
    if biased is not None and biased[0].uncertainty < _WELL and biased[1] > _SEEN:
        return biased[0]
    return None if plain is None else plain[0]


def _averages(log: Log, about: float) -> dict[str, Samples] | None:
    """Average one log over the test functions in which it moves; None if it is too short."""
    width = min(HALF_WIDTH, float(log.time[-1] - log.time[0]) * _OF_LOG)
    if log.excitation is not None:
        width = min(width, math.pi / 2 / log.excitation.omega)
    turns = round((float(np.median(log.angle)) - about) / (2 * np.pi))
    averaging = Averaging(log, about + 2 * np.pi * turns, width, FrictionTerms())
    try:
        signals = averaging.signals((_TARGET, *_NAMES, _BIAS))
    except InputError:
        return None
    return {name: mean[signals.moving] for name, mean in signals.mean.items()}


def _solved(
    means: dict[str, Samples], names: tuple[str, ...], cluster: NDArray[np.intp], about: float
) -> tuple[FittedZero, float] | None:
    """Return the zero, and how many standard errors the last unknown is from 0."""
    names = tuple(name for name in names if means[name].any())
    target = -means[_TARGET]
    if target.size < _PER_UNKNOWN * len(names) or not set(_GRAVITY) <= set(names):
        return None
    rows = np.column_stack([means[name] for name in names])
    scale = np.linalg.norm(rows, axis=0)
    if np.linalg.svd(rows / scale, compute_uv=False)[-1] < _INDEPENDENT:
        return None
    values = np.linalg.lstsq(rows / scale, target, rcond=None)[0] / scale
    left = rows @ values - target
    logs = int(cluster[-1]) + 1
    cluster = split(cluster, blocks_of(logs, len(names)))
    parts = [cluster == number for number in np.unique(cluster)]
    covariance, _ = cluster_covariance(*compress_all((rows[part], left[part]) for part in parts))
    sine, cosine = (names.index(name) for name in _GRAVITY)
    a, b = float(values[sine]), float(values[cosine])
    gravity = math.hypot(a, b)
    if not (gravity > 0 and np.isfinite(covariance).all()):
        return None
    slope = np.zeros(len(names))
    slope[[sine, cosine]] = b / gravity**2, -a / gravity**2
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    friction = float(values[names.index("coulomb")]) if "coulomb" in names else 0.0
    found = FittedZero(
        value=about - math.atan2(b, a),
        uncertainty=math.sqrt(max(float(slope @ covariance @ slope), 0.0)),
        friction=max(friction, 0.0) / gravity,
    )
    return found, abs(float(values[-1])) / float(errors[-1] or np.inf)
