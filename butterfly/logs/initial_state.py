"""How a log begins: at rest at its first sample, or in motion, by its own first samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

Samples = NDArray[np.float64]

_SPAN = 0.05  # s, over which an angle advances by more than noise
_REACH = 0.7  # rad of the motion's own phase, over which a cubic follows it
_WIDE = 1.0  # rad, beyond which a wider motion is no slower
_FEWEST = 12  # samples that a cubic is fitted to
_SURE = 6.0  # standard errors from 0 at which a velocity counts as one
_SETTLED = 0.3  # share by which half as many samples may give another velocity
_NOTABLE = 0.1  # share of the rms velocity, from which on a beginning is in motion


class InitialState(NamedTuple):
    """Angle in rad, from the encoder's zero, and velocity in rad/s at the first sample of a log."""

    angle: float
    velocity: float


def rms_speed(time: Samples, angle: Samples) -> float:
    """Return the rms velocity in rad/s of (n,) angles, over spans that are long against noise."""
    step = (time[-1] - time[0]) / (time.size - 1)
    every = min(max(1, round(_SPAN / step)), time.size // 2)
    return float(np.std(np.diff(angle[::every]) / np.diff(time[::every])))


def initial_state(time: Samples, angle: Samples, speed: float, *, cut: bool) -> InitialState:
    """Return how a log of (n,) increasing stamps in s and angles in rad begins.

    A piece of a longer recording (``cut``) begins in motion: angle and velocity are those of the
    cubic that fits its first samples best. A whole log begins at rest at its first sample, unless
    these say otherwise: their velocity is no noise, and half of them give the same one. Of a joint
    that starts from rest half as long a stretch gives a quarter, or half, of it. ``speed`` is the
    rms velocity in rad/s.
    """
    rest = InitialState(float(angle[0]), 0.0)
    if not speed > 0:
        return rest
    span = _REACH * min(float(np.std(angle)), _WIDE) / speed
    count = max(int(np.searchsorted(time, time[0] + span, "right")), _FEWEST)
    if not cut:
        half_count = max(count // 2, _FEWEST)
        moved = float(np.ptp(angle[:half_count]))
        if moved < _NOTABLE * speed * (time[half_count - 1] - time[0]) / 2:
            return rest
        whole, _ = _fitted(time[:count], angle[:count], 2)
        half, error = _fitted(time[:half_count], angle[:half_count], 2)
        sure = abs(half.velocity) > max(_SURE * error, _NOTABLE * speed)
        if not sure or abs(whole.velocity - half.velocity) > _SETTLED * abs(half.velocity):
            return rest
    return _fitted(time[:count], angle[:count], 3)[0]


def _fitted(time: Samples, angle: Samples, order: int) -> tuple[InitialState, float]:
    """Fit a polynomial to (n,) first samples; return its beginning, and its velocity's error."""
    span = float(time[-1] - time[0])
    columns = polynomial.polyvander((time - time[0]) / span, order)
    coefficients, *_ = np.linalg.lstsq(columns, angle, rcond=None)
    left = angle - columns @ coefficients
    variance = float(left @ left) / max(angle.size - order - 1, 1)
    spread = np.linalg.inv(columns.T @ columns)[1, 1]
    value, slope = coefficients[:2].tolist()
    return InitialState(value, slope / span), float(np.sqrt(variance * spread)) / span
