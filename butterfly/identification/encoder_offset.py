"""What the encoder reads where the model's angle is 0, for each log, and how that was found.

It is known beforehand; or it is the middle of the steady swings of sines with the same added mass;
or the motion itself tells it; or it is where a hand hangs at rest, without a torque to speak of, as
far as friction lets it; or it is a guess. Readings that are whole turns apart are the same.

The motion tells it whatever the trajectory. Divided by the inertia, and averaged over test
functions, the equation of motion is linear in all that is not known,

    thdd = -p2' thd - a sin th - b cos th - T_c' sgn thd + p4' u(t - d),

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

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.identification.blocks import cut, independent_cells_of
from butterfly.identification.equations import compressed, scaled_least_squares
from butterfly.identification.inference.covariance import cluster_covariance
from butterfly.identification.test_functions import HALF_WIDTH, Averaging
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Known
from butterfly.model.terms import FrictionTerms
from butterfly.signals.frequency_response import ResponsePoint

_GUESSED = 0.5  # rad, largest standard uncertainty of a guess: more says no more
_SLACK = 0.1  # friction over the moment of gravity, where nothing is known of it
_APART = 3.0  # standard errors between readings that are not the same
_ALIKE = 0.005  # rad between readings that are

_TARGET, _GRAVITY, _BIAS = "p1", ("p3", "p3_offset"), "bias"
_NAMES = (*_GRAVITY, "p2", "coulomb", "p4", "delay")
_PER_UNKNOWN = 3  # test functions at least
_OF_LOG = 1 / 16  # longest half-width of a test function
_WELL = 0.02  # rad: a zero beside a bias that is as well known
_SEEN = 5.0  # standard errors of a bias that counts
_INDEPENDENT = 1e-6  # least share of a column that the others do not explain
_LEAST_SECONDS = 0.7  # of standstill, longer than any turning point lasts
_SMALL = 0.02  # of the largest command: no torque to speak of
_STEPS, _SIGMAS = 2.0, 8.0  # of the encoder and of its noise: what a resting hand reads
_SIGMA_OF_MEDIAN = 0.6745 * 6**0.5  # median absolute second difference of white noise of sigma 1


class OffsetKind(StrEnum):
    """How a zero was found."""

    TOLD = "told"
    SWING = "steady swing"
    FIT = "the motion itself"
    REST = "rest"
    GUESS = "a guess"


@dataclass(frozen=True, kw_only=True)
class EncoderOffset:
    """An encoder reading in rad where the model's angle is 0, and its standard uncertainty."""

    value: float  # value, uncertainty: in rad; of a steady swing's middle no uncertainty is stated
    uncertainty: float = 0.0
    kind: OffsetKind  # how it was found

    def __str__(self) -> str:
        doubt = f" ± {self.uncertainty:.1g}" if self.uncertainty else ""
        return f"{round(self.value, 4) + 0.0:.4f}{doubt} rad ({self.kind})"

    def near(self, home: float) -> EncoderOffset:
        """Return the same zero, read within half a turn of ``home`` rad."""
        return replace(self, value=near(self.value, home))


def near(reading: float, home: float) -> float:
    """Return the reading in rad, whole turns taken off, that is next to another."""
    return home + math.remainder(reading - home, 2 * math.pi)


def reading_of(log: Log, zeros: Mapping[AddedMass, float]) -> float:
    """Return a log's zero in rad: what is told of it, or that of its added mass."""
    return zeros[log.added_mass] if log.zero is None else log.zero.value


def encoder_offsets(
    logs: Sequence[Log], points: Sequence[ResponsePoint | None]
) -> tuple[EncoderOffset, ...]:
    """Find the zero of each of n logs.

    ``logs``: with increasing stamps; ``points``: the steady response of each, None where the input
    is no sine.
    """
    found = [_told(log) for log in logs]
    open_ = [k for k, zero in enumerate(found) if zero is None]
    if not open_:
        return tuple(zero for zero in found if zero is not None)
    home = _home(logs, points, open_)
    masses = sorted({logs[k].added_mass for k in open_})
    of_mass = {}
    for mass in masses:
        own = [k for k in open_ if logs[k].added_mass == mass]
        of_mass[mass] = _of_mass([logs[k] for k in own], [points[k] for k in own], home)
    of_mass = _together(of_mass)
    return tuple(
        of_mass[log.added_mass] if zero is None else zero
        for log, zero in zip(logs, found, strict=True)
    )


def offset_errors(zeros: Sequence[EncoderOffset] | Sequence[Known]) -> Samples:
    """(k, n) standard uncertainties in rad of k independent errors in the zeros of n logs.

    Logs of one zero share its error.
    """
    uncertain = sorted({zero for zero in zeros if zero.uncertainty}, key=lambda zero: zero.value)
    rows = [[each.uncertainty * (zero == each) for zero in zeros] for each in uncertain]
    return np.array(rows, dtype=float).reshape(len(uncertain), len(zeros))


def _told(log: Log) -> EncoderOffset | None:
    return (
        None
        if log.zero is None
        else EncoderOffset(
            value=log.zero.value, uncertainty=log.zero.uncertainty, kind=OffsetKind.TOLD
        )
    )


def _turns(log: Log) -> bool:
    return float(np.ptp(log.angle)) > 2 * np.pi


def _home(
    logs: Sequence[Log], points: Sequence[ResponsePoint | None], numbers: Sequence[int]
) -> float:
    """Return a reading in rad, within half a turn of which all zeros are given."""
    for k in numbers:
        point = points[k]
        if not _turns(logs[k]):
            return float(np.mean(logs[k].angle)) if point is None else point.angle.offset
    return float(logs[numbers[0]].angle[0])


def _of_mass(
    logs: Sequence[Log], points: Sequence[ResponsePoint | None], home: float
) -> EncoderOffset:
    """Find what logs with one added mass share."""
    middles = [
        near(point.angle.offset, home)
        for log, point in zip(logs, points, strict=True)
        if point is not None and not _turns(log)
    ]
    if middles:
        return EncoderOffset(value=float(np.median(middles)), kind=OffsetKind.SWING)
    fitted = fitted_offset(logs)
    rests = [reading for log in logs for reading in rest_readings(log)]
    friction, found = _SLACK, []
    if fitted is not None:
        own, friction = fitted
        found.append(own)
        rests = [each for each in rests if abs(near(each, own.value) - own.value) < np.pi / 2]
    slack = math.asin(min(friction, 1.0))
    if rests:
        middle = float(np.median([near(each, rests[0]) for each in rests]))
        found.append(
            EncoderOffset(value=middle, uncertainty=slack / math.sqrt(3), kind=OffsetKind.REST)
        )
    likely = [zero for zero in found if zero.uncertainty < _GUESSED]
    best = min(likely, key=lambda zero: zero.uncertainty, default=_guess(logs, home))
    return best.near(home)


def _guess(logs: Sequence[Log], home: float) -> EncoderOffset:
    """Guess the median of what logs of small motion go about; a turning one tells its start."""
    calm = [log for log in logs if not _turns(log)]
    means = [near(float(np.mean(log.angle)), home) for log in calm]
    swings = [float(np.std(log.angle)) for log in calm]
    return EncoderOffset(
        value=float(np.median(means or [logs[0].angle[0]])),
        uncertainty=float(np.median(np.minimum(swings or [_GUESSED], _GUESSED))),
        kind=OffsetKind.GUESS,
    )


def _together(found: Mapping[AddedMass, EncoderOffset]) -> dict[AddedMass, EncoderOffset]:
    """Put the zeros that the motion told with different masses together, where they agree."""
    told = {mass: zero for mass, zero in found.items() if zero.kind is OffsetKind.FIT}
    one = _shared(list(told.values()))
    joint = {**found, **dict.fromkeys(told, one)} if one else dict(found)
    best = min(joint.values(), key=lambda zero: (zero.kind is OffsetKind.GUESS, zero.uncertainty))
    return {mass: best if z.kind is OffsetKind.GUESS else z for mass, z in joint.items()}


def _shared(told: Sequence[EncoderOffset]) -> EncoderOffset | None:
    """Return the weighted mean of zeros; None if there are no two, or they do not agree."""
    if len(told) < 2:  # noqa: PLR2004 - alone it has no others
        return None
    values = np.array([near(zero.value, told[0].value) for zero in told])
    own = np.array([zero.uncertainty for zero in told])
    errors = np.hypot(own, _ALIKE)
    weights = errors**-2 / np.sum(errors**-2)
    mean = float(weights @ values)
    if (np.abs(values - mean) > _APART * errors).any():
        return None
    return EncoderOffset(
        value=mean, uncertainty=float(np.sqrt(weights**2 @ own**2)), kind=OffsetKind.FIT
    )


def fitted_offset(logs: Sequence[Log]) -> tuple[EncoderOffset, float] | None:
    """Return the zero that logs with the same added mass share; None where they tell none.

    Besides the zero it is the Coulomb torque over the moment of gravity. ``logs``: with increasing
    stamps, of any input.
    """
    about = float(np.median(logs[0].angle))
    parts = [part for log in logs if (part := _averages(log, about)) is not None]
    if not parts:
        return None
    means = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    cluster = np.repeat(np.arange(len(parts)), [part[_TARGET].size for part in parts])
    plain = _solved(means, _NAMES, cluster, about)
    biased = _solved(means, (*_NAMES, _BIAS), cluster, about)
    if biased is not None and biased[0].uncertainty < _WELL and biased[2] > _SEEN:
        return biased[:2]
    return None if plain is None else plain[:2]


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
) -> tuple[EncoderOffset, float, float] | None:
    """Return zero and friction, and how many standard errors the last unknown is from 0."""
    names = tuple(name for name in names if means[name].any())
    target = -means[_TARGET]
    if target.size < _PER_UNKNOWN * len(names) or not set(_GRAVITY) <= set(names):
        return None
    rows = np.column_stack([means[name] for name in names])
    scale = np.linalg.norm(rows, axis=0)
    if np.linalg.svd(rows / scale, compute_uv=False)[-1] < _INDEPENDENT:
        return None
    values = scaled_least_squares(rows, target)
    left = rows @ values - target
    logs = int(cluster[-1]) + 1
    cells = independent_cells_of(logs, len(names))
    covariance, _ = cluster_covariance(*compressed(cut(rows, left, cluster, cells)))
    sine, cosine = (names.index(name) for name in _GRAVITY)
    a, b = float(values[sine]), float(values[cosine])
    gravity = math.hypot(a, b)
    if not (gravity > 0 and np.isfinite(covariance).all()):
        return None
    slope = np.zeros(len(names))
    slope[[sine, cosine]] = b / gravity**2, -a / gravity**2
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    friction = float(values[names.index("coulomb")]) if "coulomb" in names else 0.0
    found = EncoderOffset(
        value=about - math.atan2(b, a),
        uncertainty=math.sqrt(max(float(slope @ covariance @ slope), 0.0)),
        kind=OffsetKind.FIT,
    )
    last = abs(float(values[-1])) / float(errors[-1] or np.inf)
    return found, max(friction, 0.0) / gravity, last


def rest_readings(log: Log) -> list[float]:
    """Return the encoder's readings in rad of a hand that hangs still with no input.

    At the start it must be the input that sets the hand in motion: one that is let go was held. How
    far friction holds such a hand off its equilibrium is not known here.

    ``log``: of any input, with increasing stamps.
    """
    still = _still_band(log.angle)
    small = _SMALL * float(np.abs(log.input).max())
    readings = []
    first, last = _still_from(log.angle, still), _still_from(log.angle[::-1], still)
    if first < log.angle.size and _seconds(log.time[:first]) >= _LEAST_SECONDS:
        before = np.abs(log.input[:first])
        driven = np.flatnonzero(before > small)
        calm = int(driven[0]) if driven.size else 0
        if _seconds(log.time[:calm]) >= _LEAST_SECONDS:
            readings.append(float(np.median(log.angle[:calm])))
    end = slice(log.angle.size - last, None)
    if last < log.angle.size and _seconds(log.time[end]) >= _LEAST_SECONDS:
        calm = _still_from(np.abs(log.input[::-1][:last]), small, about_zero=True)
        kept = slice(log.angle.size - calm, None)
        if calm and _seconds(log.time[kept]) >= _LEAST_SECONDS:
            readings.append(float(np.median(log.angle[kept])))
    return readings


def _still_band(angle: Samples) -> float:
    """Range in rad of what an encoder reads of a hand at rest, by its step and its noise."""
    differences = np.abs(np.diff(angle))
    moved = differences[differences > 0]
    step = float(moved.min()) if moved.size else 0.0
    noise = float(np.median(np.abs(np.diff(angle, 2)))) / _SIGMA_OF_MEDIAN
    return _STEPS * step + _SIGMAS * noise


def _still_from(values: Samples, band: float, *, about_zero: bool = False) -> int:
    """Return how many of the first values stay within a band of each other, or of 0."""
    if about_zero:
        outside = values > band
    else:
        spread = np.maximum.accumulate(values) - np.minimum.accumulate(values)
        outside = spread > band
    return int(np.argmax(outside)) if outside.any() else values.size


def _seconds(time: Samples) -> float:
    return float(time[-1] - time[0]) if time.size else 0.0
