"""What the encoder reads where the model's angle is 0, for each log, and how that was found.

It is known beforehand; or it is the middle of the steady swings of sines with the same added mass;
or the motion itself tells it; or it is a guess. Readings that are whole turns apart are the same.

The motion tells it whatever the trajectory. Divided by the inertia, and averaged over test
functions, the equation of motion is linear in all that is not known,

    thdd = -p2' thd - a sin th - b cos th - T_c' sgn thd - T_d' |thd| thd + p4' u(t - d),

and a sin th + b cos th = sqrt(a^2 + b^2) sin(th - z) with the zero z = -atan2(b, a): no scale is
needed, no added mass, no guess, and whole turns make no difference. Where the motion is wide enough
to tell a constant torque from gravity, and there is one, it is fitted along.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.identification.blocks import cut, independent_cells_of
from butterfly.identification.equations import compressed, scaled_least_squares
from butterfly.identification.inference.covariance import cluster_covariance
from butterfly.identification.inference.identifiability import SINGULAR_CONDITION
from butterfly.identification.levels import CLEARLY, CONFIDENCE, SPREADS
from butterfly.identification.test_functions import HALF_WIDTH, Averaging
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Known
from butterfly.model.terms import FrictionTerms
from butterfly.signals.frequency_response import ResponsePoint

_TARGET, _GRAVITY, _BIAS = "p1", ("p3", "p3_offset"), "bias"
_NAMES = (*_GRAVITY, "p2", "coulomb", "drag", "p4", "delay")


class OffsetKind(StrEnum):
    """How a zero was found."""

    TOLD = "given"
    SWING = "steady swing"
    FIT = "from the motion"
    GUESS = "guess"


@dataclass(frozen=True, kw_only=True)
class EncoderOffset:
    """An encoder reading in rad where the model's angle is 0, and its standard uncertainty."""

    value: float  # value, uncertainty: in rad; of a steady swing's middle no uncertainty is stated
    uncertainty: float = 0.0
    kind: OffsetKind  # how it was found

    def __str__(self) -> str:
        doubt = f" ± {self.uncertainty:.1g}" if self.uncertainty else ""
        return f"{round(self.value, 4) + 0.0:.4f}{doubt} rad ({self.kind})"


def near(reading: float, home: float) -> float:
    """Return the reading in rad, whole turns taken off, that is next to another."""
    return home + math.remainder(reading - home, 2 * math.pi)


def reading_of(log: Log, zeros: Mapping[AddedMass, float]) -> float:
    """Return a log's zero in rad: what is told of it, or that of its added mass."""
    return zeros[log.added_mass] if log.zero is None else log.zero.value


def encoder_offsets(
    logs: Sequence[Log], points: Sequence[ResponsePoint | None]
) -> tuple[EncoderOffset, ...]:
    """Find the zero of each of n logs, with increasing stamps."""
    open_: dict[AddedMass, list[tuple[Log, ResponsePoint | None]]] = {}
    for log, point in zip(logs, points, strict=True):
        if log.zero is None:
            open_.setdefault(log.added_mass, []).append((log, point))
    found: dict[AddedMass, EncoderOffset] = {}
    if open_:
        home = _home([pair for own in open_.values() for pair in own])
        found = _together({mass: _of_mass(own, home) for mass, own in open_.items()})
    return tuple(found[log.added_mass] if log.zero is None else _told(log.zero) for log in logs)


def offset_errors(zeros: Sequence[EncoderOffset] | Sequence[Known]) -> Samples:
    """(k, n) standard uncertainties in rad of k independent errors in the zeros of n logs."""
    uncertain = sorted({zero for zero in zeros if zero.uncertainty}, key=lambda zero: zero.value)
    rows = [[each.uncertainty * (zero == each) for zero in zeros] for each in uncertain]
    return np.array(rows, dtype=float).reshape(len(uncertain), len(zeros))


def _told(zero: Known) -> EncoderOffset:
    return EncoderOffset(value=zero.value, uncertainty=zero.uncertainty, kind=OffsetKind.TOLD)


def _turns(log: Log) -> bool:
    return float(np.ptp(log.angle)) > 2 * np.pi


def _home(pairs: Sequence[tuple[Log, ResponsePoint | None]]) -> float:
    """Return a reading in rad, within half a turn of which all zeros are given."""
    log, point = next(((log, point) for log, point in pairs if not _turns(log)), (None, None))
    if log is None:
        return float(pairs[0][0].angle[0])
    return float(np.mean(log.angle)) if point is None else point.angle.offset


def _of_mass(pairs: Sequence[tuple[Log, ResponsePoint | None]], home: float) -> EncoderOffset:
    """Find what logs with one added mass share."""
    middles = [
        near(point.angle.offset, home)
        for log, point in pairs
        if point is not None and not _turns(log)
    ]
    if middles:
        return EncoderOffset(value=float(np.median(middles)), kind=OffsetKind.SWING)
    logs = [log for log, _ in pairs]
    both = [each for each in (fitted_offset(logs), _guess(logs, home)) if each is not None]
    best = min(both, key=lambda zero: zero.uncertainty)
    return replace(best, value=near(best.value, home))


def _guess(logs: Sequence[Log], home: float) -> EncoderOffset:
    """Guess the mean of the log that moves least; one that turns tells its start, or nothing."""
    still = min(logs, key=lambda log: log.rms_motion)
    if _turns(still):
        value, uncertainty = float(still.angle[0]), math.pi / math.sqrt(3)
    else:
        value, uncertainty = float(np.mean(still.angle)), still.rms_motion
    return EncoderOffset(value=near(value, home), uncertainty=uncertainty, kind=OffsetKind.GUESS)


def _together(found: Mapping[AddedMass, EncoderOffset]) -> dict[AddedMass, EncoderOffset]:
    """Put zeros together that agree with different masses; a guess gives way to others."""
    joint = dict(found)
    told = {mass: zero for mass, zero in found.items() if zero.kind is OffsetKind.FIT}
    if told:
        home = min(zero.value for zero in told.values())
        values = np.array([near(zero.value, home) for zero in told.values()])
        errors = np.array([zero.uncertainty for zero in told.values()])
        weights = errors**-2 / np.sum(errors**-2)
        mean, error = float(weights @ values), float(np.sum(errors**-2) ** -0.5)
        if (np.abs(values - mean) <= CLEARLY * errors).all():
            one = EncoderOffset(value=mean, uncertainty=error, kind=OffsetKind.FIT)
            joint |= dict.fromkeys(told, one)
    best = min(joint.values(), key=lambda zero: (zero.kind is OffsetKind.GUESS, zero.uncertainty))
    return {mass: best if z.kind is OffsetKind.GUESS else z for mass, z in joint.items()}


def fitted_offset(logs: Sequence[Log]) -> EncoderOffset | None:
    """Return the zero that logs with the same added mass share; None where they tell none."""
    about = float(np.median(logs[0].angle))
    parts = [part for log in logs if (part := _averages(log, about)) is not None]
    if not parts:
        return None
    means = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    cluster = np.repeat(np.arange(len(parts)), [part[_TARGET].size for part in parts])
    biased, apart = _solved(means, (*_NAMES, _BIAS), cluster, about)
    return biased if apart > CLEARLY else _solved(means, _NAMES, cluster, about)[0]


def _averages(log: Log, about: float) -> dict[str, Samples] | None:
    """Average one log over the test functions in which it moves; None if it is too short."""
    width = HALF_WIDTH
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
) -> tuple[EncoderOffset | None, float]:
    """Return the zero, and how many standard errors the last unknown is from 0."""
    names = tuple(name for name in names if means[name].any())
    target = -means[_TARGET]
    if target.size <= len(names) or not {*_GRAVITY} <= {*names}:
        return None, 0.0
    rows = np.column_stack([means[name] for name in names])
    if np.linalg.cond(rows / np.linalg.norm(rows, axis=0)) > SINGULAR_CONDITION:
        return None, 0.0
    values = scaled_least_squares(rows, target)
    cells = independent_cells_of(int(cluster[-1]) + 1, len(names))
    parts = cut(rows, rows @ values - target, cluster, cells)
    covariance, freedom = cluster_covariance(*compressed(parts))
    covariance *= np.square(stdtrit(freedom.min(), 0.5 + CONFIDENCE / 2) / SPREADS)
    sine, cosine = (names.index(name) for name in _GRAVITY)
    a, b = float(values[sine]), float(values[cosine])
    gravity = math.hypot(a, b)
    if not (gravity > 0 and np.isfinite(covariance).all()):
        return None, 0.0
    slope = np.zeros(len(names))
    slope[[sine, cosine]] = b / gravity**2, -a / gravity**2
    found = EncoderOffset(
        value=about - math.atan2(b, a),
        uncertainty=math.sqrt(float(slope @ covariance @ slope)) or np.finfo(float).eps,
        kind=OffsetKind.FIT,
    )
    return found, abs(float(values[-1])) / (math.sqrt(covariance[-1, -1]) or math.inf)
