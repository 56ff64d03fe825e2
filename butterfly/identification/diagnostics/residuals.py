"""What a model leaves over: how much of it sensors explain, how it correlates, what it looks like.

It may be torque or, as a score test has it, errors of the free run. What a change of the model's
own coefficients would add is first taken from it and from every candidate, jointly over all logs:
only what is new can be a missing term of the table.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.estimate import Estimate
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import TERMS

Samples = NDArray[np.float64]

LEVELS = (0.95, 0.99)
"""Shares of logs without a misfit whose two curves both stay inside the inner and outer band."""

_CURVES = 2  # autocorrelation and cross-correlation, which share the false alarms
_SMOOTHED = 10  # lags on either side over which the spread of drawn curves is averaged

_SAME = 1e-9  # rad, closer than which two readings are one
_FEWEST_GAPS = 3  # between different readings, of which a step can be told
_NEAR = 10  # steps, up to which gaps are looked at
_OFF = 0.1  # of a step, by which a gap may miss a whole number of them
_REGULAR = 0.95  # share of gaps that are whole numbers of steps where there are any
_MOST_SAMPLES = 20_000  # of a log, from which its noise is told
_HALVINGS = 10  # of the interval that holds the noise
_UNIFORM = 12.0  # square of the width of a uniform distribution over its variance
_CURVATURE = 6.0  # variance of a second difference of white noise over its own

INDEPENDENT = 1e-6
"""Size over the largest, below which a direction is none."""

_SURE = 4.0  # standard errors from 0 at which a coefficient counts as one
_LIKE = 0.3  # share that a term must explain of what is more than noise, to be named
_MORE_THAN_NOISE = 1.2  # rms over the noise's, from which there is something else
_OF_GRAVITY = ("p3", "p3_offset")
_ALIKE = 0.8  # of the likeliest one's share, from which another term looks like it
_SLOW = 0.3  # share of the rms velocity at which Stribeck friction is looked for
_PIECES = 10  # of a log, between which what is left is taken to be independent
_SINGULAR = 1e-8  # size over the largest, below which columns say the same


@dataclass(frozen=True, kw_only=True)
class SensorErrors:
    """The errors of one log's readings: white noise, then rounding to a step of the encoder.

    Where the noise is less than a step the error is not white: it depends on the angle, and the
    slower that moves the longer the error stays.
    """

    step: float  # of the encoder in rad; 0 if the readings lie on no grid
    noise: float  # standard deviation in rad of the noise before rounding

    @property
    def spread(self) -> float:
        """Standard deviation in rad of a reading: of the noise, and of rounding to a step."""
        return math.hypot(self.noise, self.step / math.sqrt(_UNIFORM))

    @classmethod
    def of(cls, measured: Samples, angle: Samples) -> SensorErrors:
        """Tell step and noise from (n,) readings and the angles in rad that a model gives for them.

        The step is the distance of neighbouring readings. The noise is what makes the second
        differences of the errors as large as they are: what a model misses is smooth from sample to
        sample and hardly enters them.
        """
        step = encoder_step(measured)
        some = slice(_MOST_SAMPLES)
        roughness = _roughness(measured[some] - angle[some])
        upper = float(np.sqrt(roughness / _CURVATURE))
        if not step:
            return cls(step=0.0, noise=upper)
        white = np.random.default_rng(0).standard_normal(angle[some].size)
        lower = 0.0
        if _roughness(_errors(angle[some], 0.0 * white, step)) >= roughness:
            return cls(step=step, noise=0.0)
        for _ in range(_HALVINGS):
            middle = (lower + upper) / 2
            if _roughness(_errors(angle[some], middle * white, step)) < roughness:
                lower = middle
            else:
                upper = middle
        return cls(step=step, noise=lower)

    def draw(self, angle: Samples, random: np.random.Generator, *, unsure: float) -> Samples:
        """Return (n,) errors in rad that readings of (n,) angles in rad may have.

        All angles together may be off by a standard deviation of ``unsure`` rad.
        """
        shifted = angle + unsure * random.standard_normal()
        if not self.noise:
            return _errors(shifted, np.zeros(1), self.step)
        return _errors(shifted, self.noise * random.standard_normal(angle.size), self.step)


def encoder_step(readings: Samples) -> float:
    """Return the step in rad of the grid on which (n,) readings in rad lie; 0 if on none."""
    gaps = np.diff(np.unique(readings))
    gaps = gaps[gaps > _SAME]
    if gaps.size < _FEWEST_GAPS:
        return 0.0
    least = float(np.percentile(gaps, 5))
    step = float(np.median(gaps[gaps < 1.5 * least]))
    steps = gaps[gaps < _NEAR * step] / step
    regular = np.mean(np.abs(steps - np.rint(steps)) < _OFF)
    return step if regular > _REGULAR else 0.0


def _errors(angle: Samples, noise: Samples, step: float) -> Samples:
    read = angle + noise
    return (step * np.rint(read / step) if step else read) - angle


def _roughness(errors: Samples) -> float:
    """Mean square of the second differences of (n,) errors."""
    return float(np.mean(np.diff(errors, 2) ** 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorBand:
    """How far a reading may be from the simulation, by the parameters and the sensor."""

    time: Samples  # (m,) instants in s
    reach: Samples  # (m,) half widths in rad, at `CONFIDENCE`


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A correlation over lags, and what sensors make of it."""

    lag: Samples  # (l,) in s
    value: Samples  # (l,) correlation, between -1 and 1
    centre: Samples  # (l,) mean of that of a sensor's errors
    reach: Samples  # (2, l) half-widths of the bands about it that hold whole curves, by `LEVELS`

    @property
    def excess(self) -> Samples:
        """(2,) largest distance from the centre over the band's half-width, by `LEVELS`."""
        return np.asarray((np.abs(self.value - self.centre) / self.reach).max(axis=1))

    @classmethod
    def of(cls, lag: Samples, curves: Samples, count: int, allowance: float) -> Curve:
        """Put bands about a curve.

        (l,) lags in s; (l, 1 + k) the curve, and k of a sensor's errors; the number of errors, of
        which white ones have correlations of variance 1/count; and by how much a misfit too small
        to count may move the curve.
        """
        value, drawn = curves[:, 0], curves[:, 1:]
        variance = _smoothed(drawn.var(axis=1, ddof=1)) * (1 + 1 / drawn.shape[1])
        spread = np.sqrt(np.maximum(variance, 1 / count))
        tails = [(1 - level) / (2 * _CURVES * lag.size) for level in LEVELS]
        factors = np.array([-NormalDist().inv_cdf(tail) for tail in tails])
        return cls(
            lag=lag,
            value=value,
            centre=drawn.mean(axis=1),
            reach=factors[:, None] * spread + allowance,
        )


def autocorrelation(errors: Samples, lags: int) -> Samples:
    """Return the (lags, k) correlations of (m, k) errors with themselves, from lag 1 on."""
    size = _padded(errors.shape[0] + lags)
    spectrum = np.fft.rfft(errors, size, axis=0)
    sums = np.fft.irfft(np.abs(spectrum) ** 2, size, axis=0)[: lags + 1]
    return np.asarray(sums[1:] / _or_one(sums[0]))


def cross_correlation(errors: Samples, inputs: Samples, lags: int) -> Samples:
    """Return the (lags + 1, k) correlations of (m, k) errors with (m,) inputs before them."""
    size = _padded(errors.shape[0] + lags)
    moving = inputs - inputs.mean()
    product = np.fft.rfft(errors, size, axis=0) * np.conj(np.fft.rfft(moving, size))[:, None]
    sums = np.fft.irfft(product, size, axis=0)[: lags + 1]
    powers = np.sum(errors**2, axis=0) * np.sum(moving**2)
    return np.asarray(sums / _or_one(np.sqrt(powers)))


def _padded(size: int) -> int:
    return 1 << (size - 1).bit_length()


def _or_one(values: Samples) -> Samples:
    return np.where(values > 0, values, 1.0)


def _smoothed(values: Samples) -> Samples:
    window = np.ones(min(2 * _SMOOTHED + 1, values.size))
    sums = np.convolve(values, window, "same")
    return np.asarray(sums / np.convolve(np.ones_like(values), window, "same"))


class ResidualEquations(NamedTuple):
    """What one log says, at n instants."""

    # (n,) torque in N m, or simulated less measured angle in rad, that the model leaves over
    left: Samples
    known: Samples  # (n, k) what it would change by with k coefficients that the model has
    candidates: Mapping[str, Samples]  # by term: (n,) what it would change by with one unit of it
    whole: float  # rms of the motor's torque in N m, or of the motion in rad
    noise: float  # rms that the sensor's errors make of it


@dataclass(frozen=True, kw_only=True)
class ResidualSummary:
    """What the model leaves over looks like."""

    # its rms over the motor's torque, or the motion, less what a change of the model's own terms
    # would take
    relative: float
    noise: float  # share of its variance that the sensors' errors explain
    shares: dict[str, float]  # by missing term: the share that it alone explains, largest first
    # those that it looks like, the likeliest first; several where they look alike
    terms: tuple[str, ...] = ()
    size: float = 0.0  # rms of what the likeliest adds, over the same
    shows: bool = False  # whether there is more than noise and what is too little to count

    @property
    def looks_like(self) -> str:
        """Name what it looks like."""
        if not self.shows:
            return "nothing that the data can show"
        names = " or ".join(TERMS[name].looks_like for name in self.terms)
        return names or "no missing term of the table"

    def words(self, whole: str) -> str:
        """Say what it looks like, how much of it that is, and how large beside ``whole``."""
        if not self.shows:
            return self.looks_like
        if not self.terms:
            return f"{self.looks_like} ({100 * self.relative:.2g} % of {whole})"
        share = f"{100 * self.shares[self.terms[0]]:.0f} % of its variance"
        return f"{self.looks_like} ({share}, {100 * self.size:.2g} % of {whole})"

    def numbers(self) -> dict[str, Any]:
        """Return it for programs."""
        return {
            "looks_like": list(self.terms),
            "relative": self.relative,
            "size": self.size,
            "noise_share": self.noise,
            "shares": self.shares,
        }


def absent_terms(estimate: Estimate, added: AddedMass) -> tuple[str, ...]:
    """Names of the terms that are looked for: those with a name for it that the model lacks.

    Without gravity nothing that the joint carries weighs.
    """
    local = {name for values in estimate.local.values() for name in values}
    has = {*estimate.names, *local, *(() if added.gravity else _OF_GRAVITY)}
    named = (row.name for row in TERMS.values() if row.looks_like)
    return tuple(
        name for name in named if name not in has and not getattr(estimate.parameters, name)
    )


def slow_velocity(logs: Iterable[Log]) -> float:
    """Return the velocity in rad/s at which Stribeck friction is looked for in logs."""
    return _SLOW * float(np.median([log.rms_speed for log in logs]))


def summarise_residuals(
    balances: Sequence[ResidualEquations], least: float
) -> tuple[ResidualSummary, list[ResidualSummary]]:
    """Name what several logs leave over, together and each.

    Nothing is said below a share ``least`` of the whole. All logs have the same candidates.
    """
    weights = [1 / each.whole for each in balances]
    ends = np.cumsum([each.left.size for each in balances])[:-1]
    known, left = (
        np.concatenate([w * column for w, column in zip(weights, columns, strict=True)])
        for columns in ([each.known for each in balances], [each.left for each in balances])
    )
    names = list(balances[0].candidates)
    columns = [
        np.concatenate([w * b.candidates[name] for w, b in zip(weights, balances, strict=True)])
        for name in names
    ]
    new = np.split(_less(known, np.column_stack([left, *columns])), ends)
    noises = [w * each.noise for w, each in zip(weights, balances, strict=True)]
    sizes = [max(part.shape[0], 1) for part in new]
    noise = float(np.sqrt(np.average(np.square(noises), weights=sizes)))
    pieces = [piece for part in new for piece in np.array_split(part, _PIECES)]
    each = [
        _summarised(np.array_split(part, _PIECES), names, own, least)
        for part, own in zip(new, noises, strict=True)
    ]
    return _summarised(pieces, names, noise, least), each


def _less(known: Samples, columns: Samples) -> Samples:
    """Take from (n, j) columns what those known explain."""
    sizes = np.linalg.norm(known, axis=0)
    scaled = known[:, sizes > 0] / sizes[sizes > 0]
    change = np.linalg.lstsq(scaled, columns, rcond=_SINGULAR)[0]
    return np.asarray(columns - scaled @ change)


def _summarised(
    pieces: Sequence[Samples], names: Sequence[str], noise: float, least: float
) -> ResidualSummary:
    """Judge pieces of (n, 1 + j): what is left, and what j missing terms would change of it."""
    count = max(sum(piece.shape[0] for piece in pieces), 1)
    products = np.array([piece.T @ piece for piece in pieces])
    total = products.sum(axis=0)
    power = total[0, 0] / count
    shares: dict[str, float] = {}
    likely: dict[str, float] = {}
    for column, name in enumerate(names, start=1):
        own = total[column, column]
        if not own > 0 or not power > 0:
            continue
        value = total[column, 0] / own
        scores = products[:, column, 0] - value * products[:, column, column]
        error = float(np.sqrt(np.sum(scores**2))) / own
        shares[name] = float(value * total[column, 0] / total[0, 0])
        added = abs(value) * (own / count) ** 0.5
        possible = -value >= TERMS[name].lower
        if possible and abs(value) > _SURE * error and added > least:
            likely[name] = float(added)
    quiet = float(min(noise**2 / power, 1.0)) if power > 0 else 1.0
    ordered = dict(sorted(shares.items(), key=lambda item: -item[1]))
    enough = max(_LIKE * (1 - quiet), _ALIKE * max(shares.values(), default=0.0))
    terms = tuple(name for name in ordered if name in likely and ordered[name] > enough)
    beyond = (power * (1 - quiet)) ** 0.5 > least and quiet * _MORE_THAN_NOISE**2 < 1
    return ResidualSummary(
        relative=float(power**0.5),
        noise=quiet,
        shares=ordered,
        terms=terms,
        size=likely[terms[0]] if terms else 0.0,
        shows=bool(terms or beyond),
    )


def rms(values: Samples) -> float:
    """Return the root mean square of (n,) values; 0 of none."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def orthonormal(columns: Samples) -> Samples:
    """Return (m, j) orthonormal columns that span those of (m, k) that are felt at all."""
    sizes = np.linalg.norm(columns, axis=0)
    felt = sizes > INDEPENDENT * columns.shape[0] ** 0.5
    left, singular, _ = np.linalg.svd(columns[:, felt] / sizes[felt], full_matrices=False)
    return np.asarray(left[:, singular > INDEPENDENT * singular.max(initial=0.0)])


def less(directions: Sequence[Samples], errors: Samples) -> Samples:
    """Take from (m, k) errors the orthonormal directions of stretches, one after the other."""
    ends = np.cumsum([each.shape[0] for each in directions])[:-1]
    pairs = zip(directions, np.split(errors, ends), strict=True)
    return np.concatenate([part - each @ (each.T @ part) for each, part in pairs])
