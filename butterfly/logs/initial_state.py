"""How a log begins: angle and velocity at its first sample, by the samples that follow."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial

from butterfly.arrays import Samples

_REACH = 0.7  # rad of the motion's phase that a cubic can follow
_WIDE = 1.0  # rad, beyond which a wider motion is no slower
_FEWEST = 12  # samples that a cubic is fitted to
_FEW, _SAME = 4, 2.0  # samples whose mean is compared with the next; standard errors that are none
_SURE = 6.0  # standard errors from 0 at which a velocity counts
_SETTLED = 0.3  # by which the velocity may change for half the samples
_NOTABLE = 0.1  # of the rms velocity, above which a log begins in motion

_PERIODS = 3  # of a sine that are fitted to find it steady
_HARMONICS = 7  # of it: friction makes many in small swings
_CALM = 0.003  # rms of other motion there, beyond white noise, relative to the swing
_TURNING = 0.02  # of its largest velocity, below which it begins where it turns, at rest
_OVER = 2.0  # rms of it at the very beginning, relative to the whole

_FEWEST_RAD = 1.0  # of phase in all samples of a free swing
_FINEST = 0.6  # of half a period between samples
_SCANNED = 40  # frequencies


class InitialState(NamedTuple):
    """Angle in rad, from the encoder's zero, and velocity in rad/s at the first sample of a log."""

    angle: float
    velocity: float


def initial_state_of(
    time: Samples,
    angle: Samples,
    *,
    motion: float,
    speed: float,
    omega: float | None,
    free: bool,
    cut: bool,
) -> InitialState:
    """Return the state of a steady sine, by samples at rest, or a cubic of what moves at once.

    Of a free swing with too few samples for a cubic it is that of a sine, at rest or not.
    ``motion``, ``speed``: rms of angle and velocity; ``omega``: of a commanded sine; ``free``:
    whether nothing drives the joint; ``cut``: whether it is a piece of a longer recording.
    """
    if not speed > 0:
        return InitialState(float(angle[0]), 0.0)
    steady = omega and _in_steady_swing(time, angle, omega)
    if steady:
        return steady
    span = _REACH * min(motion, _WIDE) / speed
    seen = int(np.searchsorted(time, time[0] + span, "right"))
    count = max(seen, _FEWEST)
    time, angle = time[:count], angle[:count]
    if free and seen < _FEWEST:
        return _free_swing(time, angle)
    begun, error = _fitted(time, angle, 3)
    if cut:
        return begun
    if free:  # no input sets it going, so that it moves as it did before
        moves = abs(begun.velocity) > max(_SAME * error, _NOTABLE * speed)
    else:
        moves = _moves(time, angle, speed)
    return begun if moves else InitialState(_rest(angle), 0.0)


def _free_swing(time: Samples, angle: Samples) -> InitialState:
    """Return the initial state of (n,) first samples, few in a period, by least squares.

    It is that of the offset and sine that fit best, over all frequencies scanned.
    """
    passed = time - time[0]
    slowest, fastest = _FEWEST_RAD, _FINEST * math.pi * (time.size - 1)
    fits = []
    for omega in np.geomspace(slowest, fastest, _SCANNED) / passed[-1]:
        turned = omega * passed
        columns = np.column_stack([np.ones(time.size), np.cos(turned), np.sin(turned)])
        offset, cosine, sine = np.linalg.lstsq(columns, angle, rcond=None)[0].tolist()
        residuals = angle - columns @ [offset, cosine, sine]
        fits.append((float(residuals @ residuals), offset + cosine, float(omega) * sine))
    return InitialState(*min(fits)[1:])


def _in_steady_swing(time: Samples, angle: Samples, omega: float) -> InitialState | None:
    """Return the initial state of a steady sine; None if the first periods hold other motion.

    After a start from rest it is as large as the swing, or largest at the very beginning.
    """
    period = 2 * np.pi / omega
    count, few = np.searchsorted(time, time[0] + period * np.array([_PERIODS, 1 / _PERIODS**2]))
    if count == time.size or few < _FEWEST:
        return None
    harmonics = omega * np.arange(1, 1 + _HARMONICS)
    turns = np.exp(1j * omega * (time[:count] - time[0]))
    turned = np.multiply.accumulate([turns] * _HARMONICS).T
    columns = np.column_stack([np.ones(count), turned.real, turned.imag])
    coefficients = np.linalg.solve(columns.T @ columns, columns.T @ angle[:count])
    mean, cosines, sines = np.split(coefficients, [1, 1 + _HARMONICS])
    other = angle[:count] - columns @ coefficients
    squares, noise = np.square(other), np.square(np.diff(other)).mean() / 2
    swing, velocity = math.hypot(cosines[0], sines[0]), float(harmonics @ sines)
    calm = (
        squares.mean() - noise < (_CALM * swing) ** 2
        and squares[:few].mean() < _OVER**2 * squares.mean()
    )
    if not calm or abs(velocity) < _TURNING * omega * swing:
        return None
    return InitialState(float(mean[0] + cosines.sum()), velocity)


def _moves(time: Samples, angle: Samples, speed: float) -> bool:
    """Whether (n,) first samples are in motion: ever fewer of them give the same velocity."""
    steps = np.abs(np.diff(angle))
    finest = float(np.min(steps, where=steps > 0, initial=np.ptp(angle)))  # an encoder's step
    before, moves = abs(_fitted(time, angle, 2)[0].velocity), False
    while time.size > _FEWEST or not moves:
        count = max(time.size // 2, _FEWEST)
        time, angle = time[:count], angle[:count]
        state, error = _fitted(time, angle, 2, finest)
        if _SURE * error >= before:
            break
        velocity = abs(state.velocity)  # from rest, in the end a quarter to a half of that before
        if velocity < _NOTABLE * speed or abs(velocity - before) > _SETTLED * velocity:
            return False
        before, moves = velocity, True
    return moves


def _rest(angle: Samples) -> float:
    """Return the angle at which (n,) first samples begin: the mean while the joint rests.

    It rests while the mean of as many samples that follow is the same, within its noise.
    """
    count = 0
    while 2 * (half := max(2 * count, _FEW)) <= angle.size:
        before, after = angle[:half], angle[half : 2 * half]
        error = math.sqrt((before.var() + after.var()) / half)
        if abs(after.mean() - before.mean()) > _SAME * error:
            break
        count = half
    return float(angle[:count].mean() if count else angle[0])


def _fitted(
    time: Samples, angle: Samples, order: int, finest: float = 0.0
) -> tuple[InitialState, float]:
    """Fit a polynomial to first samples; return initial state and error of velocity."""
    span = float(time[-1] - time[0])
    columns = polynomial.polyvander((time - time[0]) / span, order)
    coefficients, *_ = np.linalg.lstsq(columns, angle, rcond=None)
    residuals = angle - columns @ coefficients
    variance = max(float(residuals @ residuals) / max(angle.size - order - 1, 1), finest**2 / 12)
    spread = np.linalg.inv(columns.T @ columns)[1, 1]
    value, slope = coefficients[:2].tolist()
    return InitialState(value, slope / span), float(np.sqrt(variance * spread)) / span
