"""The encoder's reading at model angle 0, of each log, and how it was found.

It is given; or it is the middle of the steady swings of sines with the same added mass; or the
motion determines it; or it is a guess. Readings that differ by whole turns are the same.

From the motion, it follows from the weak form of logs with one added mass, whatever their inputs.
Of unit inertia, as no scale is needed, it yields the two parts of gravity, and

    p3 sin th + p3_offset cos th = sqrt(p3^2 + p3_offset^2) sin(th - z),  z = -atan2(p3_offset, p3).

A constant torque is fitted too where it differs clearly from 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy.special import stdtrit

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.inference.consistency import is_driven
from butterfly.identification.inference.limits import Conditioning, cluster_covariance
from butterfly.identification.levels import CLEARLY, CONFIDENCE, SPREADS
from butterfly.identification.weak_regression import About, WeakFit, averaging_of
from butterfly.logs.log import Log
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.model.prior import Known, Prior
from butterfly.model.terms import OF_GRAVITY, OF_INPUT, PARAMETERS, PLAIN
from butterfly.signals.frequency_response import ResponsePoint


class OffsetKind(StrEnum):
    """How a zero was found."""

    GIVEN = "given"
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
    """Return the reading in rad plus the whole turns that bring it nearest to another."""
    return home + math.remainder(reading - home, 2 * math.pi)


def reading_of(log: Log, zeros: Mapping[AddedMass, float]) -> float:
    """Return a log's zero in rad: the known one, or that of its added mass."""
    return zeros[log.added_mass] if log.zero is None else log.zero.value


def encoder_offsets(
    logs: Sequence[Log], points: Sequence[ResponsePoint | None]
) -> tuple[EncoderOffset, ...]:
    """Find the zero of each of n logs, with increasing stamps."""
    unknown: dict[AddedMass, list[tuple[Log, ResponsePoint | None]]] = {}
    for log, point in zip(logs, points, strict=True):
        if log.zero is None:
            unknown.setdefault(log.added_mass, []).append((log, point))
    zeros: dict[AddedMass, EncoderOffset] = {}
    if unknown:
        home = _guess([log for log in logs if log.zero is None]).value
        zeros = _together({mass: _of_mass(pairs, home) for mass, pairs in unknown.items()})
    kind = OffsetKind.GIVEN
    return tuple(
        zeros[log.added_mass]
        if log.zero is None
        else EncoderOffset(value=log.zero.value, uncertainty=log.zero.uncertainty, kind=kind)
        for log in logs
    )


def offset_errors(zeros: Sequence[EncoderOffset] | Sequence[Known]) -> Samples:
    """(k, n) standard uncertainties in rad of k independent errors in the zeros of n logs."""
    uncertain = sorted({zero for zero in zeros if zero.uncertainty}, key=lambda zero: zero.value)
    rows = [[source.uncertainty * (zero == source) for zero in zeros] for source in uncertain]
    return np.array(rows, dtype=float).reshape(len(uncertain), len(zeros))


def _turns(log: Log) -> bool:
    return float(np.ptp(log.angle)) > 2 * np.pi


def _of_mass(pairs: Sequence[tuple[Log, ResponsePoint | None]], home: float) -> EncoderOffset:
    """Return the zero that logs with one added mass share, within half a turn of ``home`` rad."""
    middles = [near(point.angle.offset, home) for log, point in pairs if point and not _turns(log)]
    if middles:
        return EncoderOffset(value=float(np.median(middles)), kind=OffsetKind.SWING)
    logs = [log for log, _ in pairs]
    best, fitted = _guess(logs), fitted_offset(logs)
    if fitted is not None and fitted.uncertainty <= best.uncertainty:
        best = fitted
    return replace(best, value=near(best.value, home))


def _guess(logs: Sequence[Log]) -> EncoderOffset:
    """Return a guess: the mean of the log that moves least, or its beginning if it turns."""
    still = min(logs, key=lambda log: log.rms_motion)
    if _turns(still):
        value, uncertainty = float(still.angle[0]), math.pi / math.sqrt(3)
    else:
        value, uncertainty = float(np.mean(still.angle)), still.rms_motion
    return EncoderOffset(value=value, uncertainty=uncertainty, kind=OffsetKind.GUESS)


def _together(zeros: Mapping[AddedMass, EncoderOffset]) -> dict[AddedMass, EncoderOffset]:
    """Return the zeros, fitted ones averaged if they agree, and guesses replaced by the best."""
    joint = dict(zeros)
    fitted = {mass: zero for mass, zero in zeros.items() if zero.kind is OffsetKind.FIT}
    if fitted:
        home = min(zero.value for zero in fitted.values())
        values = np.array([near(zero.value, home) for zero in fitted.values()])
        weights = np.array([zero.uncertainty for zero in fitted.values()]) ** -2.0
        mean, error = float(np.average(values, weights=weights)), float(weights.sum() ** -0.5)
        if (np.abs(values - mean) * np.sqrt(weights) <= CLEARLY).all():
            one = EncoderOffset(value=mean, uncertainty=error, kind=OffsetKind.FIT)
            joint |= dict.fromkeys(fitted, one)
    best = min(joint.values(), key=lambda zero: (zero.kind is OffsetKind.GUESS, zero.uncertainty))
    return {mass: best if z.kind is OffsetKind.GUESS else z for mass, z in joint.items()}


def fitted_offset(logs: Sequence[Log]) -> EncoderOffset | None:
    """Return the zero in rad by the motion of logs with one added mass; None if undetermined."""
    middle, windows = float(np.median(logs[0].angle)), []
    for log in logs:
        bare = replace(log, added_mass=NO_ADDED_MASS)
        averages = averaging_of(bare, near(middle, float(np.median(log.angle))))
        with suppress(InputError):  # of a log that is too short
            if averages.moving(0.0).any():
                windows.append(averages)
    if not windows:
        return None
    known = Prior.of({"p1": 1.0} | ({} if is_driven(logs) else dict.fromkeys(OF_INPUT, 0.0)))
    last = "bias"
    others = dict.fromkeys((*OF_GRAVITY, *PARAMETERS, *PLAIN))
    names = known.open(name for name in others if name != last)
    about = About(windows=windows, names=names, known=known, gain=1.0, equal_logs=False)
    return _offset(replace(about, names=(*names, last)), middle) or _offset(about, middle)


def _offset(about: About, middle: float) -> EncoderOffset | None:
    """Return the zero in rad by a fit; None if that is singular, or has a bias that may be 0."""
    try:
        solved = WeakFit.converged(about).solved
    except (IdentifiabilityError, InputError):
        return None
    few = np.count_nonzero(solved.rows.any(axis=1)) <= len(solved.names)
    if few or Conditioning.of(solved.rows, solved.names).singular:
        return None
    covariance, freedom = cluster_covariance(*solved.stack)
    covariance *= np.square(stdtrit(freedom.min(), 0.5 + CONFIDENCE / 2) / SPREADS)
    if abs(solved.named.get("bias", np.inf)) <= CLEARLY * math.sqrt(covariance[-1, -1]):
        return None
    sine, cosine = solved.values[:2].tolist()
    across = np.array([cosine, -sine]) / (sine**2 + cosine**2)
    return EncoderOffset(
        value=middle - math.atan2(cosine, sine),
        uncertainty=math.sqrt(across @ covariance[:2, :2] @ across) or np.finfo(float).eps,
        kind=OffsetKind.FIT,
    )
