"""How a log begins: at rest at its first sample, or in motion, as its own first samples tell."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.polynomial import polynomial

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.logs.log import Log

    Samples = NDArray[np.float64]

_SPAN = 0.05  # s, over which an angle advances by more than noise
_REACH = 0.7  # rad of the motion's own phase, over which a cubic follows it
_FEWEST = 12  # samples that a cubic is fitted to
_SURE = 6.0  # standard errors from 0 at which a velocity counts as one
_SETTLED = 0.3  # share by which half as many samples may tell another velocity
_NOTABLE = 0.1  # share of the rms velocity, from which on a beginning is in motion


class Beginning(NamedTuple):
    """Angle in rad, from the encoder's zero, and velocity in rad/s at the first sample of a log."""

    angle: float
    velocity: float


def rms_speed(log: Log) -> float:
    """Return the rms velocity in rad/s, over spans that are long against the noise."""
    every = min(max(1, round(_SPAN / log.mean_step)), log.time.size // 2)
    return float(np.std(np.diff(log.angle[::every]) / np.diff(log.time[::every])))


def beginning(log: Log) -> Beginning:
    """Return how a log begins.

    A piece of a longer recording begins in motion: angle and velocity are those of the cubic that
    fits its first samples best. A whole log begins at rest at its first sample, unless these say
    otherwise: their velocity is no noise, and half of them tell the same one. Of a joint that
    starts from rest half as long a stretch tells a quarter, or half, of it.
    """
    speed, motion = rms_speed(log), float(np.std(log.angle))
    rest = Beginning(float(log.angle[0]), 0.0)
    if not speed > 0:
        return rest
    within = log.time - log.time[0] <= _REACH * motion / speed
    count = max(int(np.count_nonzero(within)), _FEWEST)
    found, _ = _fitted(log, count, 3)
    if log.lead is not None:
        return found
    parts = [_fitted(log, max(count // share, _FEWEST), 2) for share in (1, 2)]
    (whole, _), (half, error) = parts
    sure = abs(half.velocity) > max(_SURE * error, _NOTABLE * speed)
    settled = abs(whole.velocity - half.velocity) <= _SETTLED * abs(half.velocity)
    return found if sure and settled else rest


def _fitted(log: Log, count: int, order: int) -> tuple[Beginning, float]:
    """Fit a polynomial to the first samples; return its beginning, and its velocity's error."""
    time, angle = log.time[:count] - log.time[0], log.angle[:count]
    span = float(time[-1])
    columns = polynomial.polyvander(time / span, order)
    coefficients, *_ = np.linalg.lstsq(columns, angle, rcond=None)
    left = angle - columns @ coefficients
    variance = float(left @ left) / max(angle.size - order - 1, 1)
    spread = np.linalg.inv(columns.T @ columns)[1, 1]
    value, slope = coefficients[:2].tolist()
    return Beginning(value, slope / span), float(np.sqrt(variance * spread)) / span
