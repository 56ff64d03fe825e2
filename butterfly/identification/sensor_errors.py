"""Errors of sensors' readings, and their correlations, as a perfect model would leave them.

A reading is the angle with white noise, rounded to a step of the encoder. Where the noise is half a
step or more, its error is white (Widrow & Kollar, Quantization Noise, 2008, chapter 19). Where it
is less, the error depends on the angle, and is correlated the longer the slower this moves.

Whether an encoder is off its centre: errors of free runs that repeat with the angle.

A disc beside its axis reads a sine of the angle too much, once a turn: e = a sin th + b cos th. Of
small swings a is a scale of the angle, which moves p4 and friction and which no log bounds; what it
does at larger ones, and b, do not look like any term. Both are fitted to the errors together with
all values, which are then those of a centred disc.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.optimize import brentq
from scipy.special import fdtrc, ndtr, ndtri

from butterfly.arrays import ROUNDING, Samples, blocks, standard_error
from butterfly.compiled import compiled
from butterfly.identification.limits import (
    Rival,
    cluster_covariance,
    half_widths,
    independent_cells_of,
)
from butterfly.identification.linearisation import Linearisation
from butterfly.identification.scatter import submodels_of
from butterfly.identification.trust import Finding, FindingKind
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import lower_bounds
from butterfly.signals.frequency_response import roughness
from butterfly.verdict import CONFIDENCE

_WHOLE = 0.1  # of a step, within which gaps of readings are whole steps

Places: TypeAlias = NDArray[np.int16]
Counts: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class SensorErrors:
    """The errors of one log's readings."""

    step: float  # of the encoder in rad; 0 if the readings lie on no grid
    noise: float  # standard deviation in rad of the noise before rounding
    places: ClassVar[int] = 1024  # in a step, a power of two, at which errors are computed

    @property
    def spread(self) -> float:
        """Standard deviation in rad of a reading: of the noise, and of rounding to a step."""
        return math.hypot(self.noise, self.step / math.sqrt(12))

    @property
    def white(self) -> bool:
        """Whether the errors do not depend on the angle."""
        return self.noise >= self.step / 2

    @classmethod
    def of(cls, measured: Samples, angle: Samples) -> SensorErrors:
        """Estimate step and noise from (n,) readings and a model's angles in rad.

        Errors of the model are smooth, and hardly enter the second differences of the errors.
        """
        step, rough = encoder_step(measured), roughness(measured - angle)
        white = cls(step=step, noise=math.sqrt(max(rough / 6 - step**2 / 12, 0.0)))
        if white.white:
            return white
        places = _places(angle, step)
        share = np.bincount(places, minlength=cls.places) / places.size

        @cache
        def excess(noise: float) -> float:
            mean, variance = _by_place(noise, step)
            return roughness(mean[places]) + 6 * float(share @ variance) - rough

        largest = math.sqrt(rough / 6)
        if excess(0.0) >= 0 or excess(largest) <= 0:
            return cls(step=step, noise=0.0 if excess(0.0) >= 0 else largest)
        return cls(step=step, noise=float(brentq(excess, 0.0, largest, xtol=1e-3 * step)))

    def draw(
        self, angle: Samples, shifts: Samples, counts: Counts, random: np.random.Generator
    ) -> Samples:
        """Return (m, k) means of errors in rad that readings of (n,) angles in rad may have.

        Each is over ``counts`` of the angles in turn, all off by one of (k,) ``shifts`` in rad.
        """
        moved = np.rint(shifts / self.step * self.places).astype(np.int64)
        places = _places(angle, self.step)
        by_place = _by_place(self.noise, self.step)
        drawn = np.empty((moved.size, counts.size))
        for draw, shift in zip(drawn, moved, strict=True):
            sums, variances = _sums(places, shift, counts, by_place)
            draw[:] = (sums + np.sqrt(variances) * random.standard_normal(counts.size)) / counts
        return drawn.T


def encoder_step(readings: Samples) -> float:
    """Return the step in rad of the grid on which (n,) readings in rad lie; 0 if on none."""
    gaps = np.diff(np.unique(readings))
    gaps = gaps[gaps > 1e-9]  # noqa: PLR2004 - rad, what rounding of numbers leaves
    if gaps.size < 3:  # noqa: PLR2004 - too few to estimate a step
        return 0.0
    step = float(np.median(gaps[gaps < 1.5 * np.percentile(gaps, 5)]))
    return step if np.median(np.abs(gaps / step - np.rint(gaps / step))) < _WHOLE else 0.0


def _places(angle: Samples, step: float) -> Places:
    """Return the (n,) places of angles in rad within a step of the encoder, from its beginning."""
    count, places = SensorErrors.places, np.empty(angle.size, dtype=np.int16)
    for part in blocks(angle.size):
        places[part] = np.floor((angle[part] / step + 0.5) * count).astype(np.int64) & (count - 1)
    return places


def _by_place(noise: float, step: float) -> Samples:
    """(2, p) mean in rad and variance of a reading's error, by where its angle is in a step."""
    place = (np.arange(SensorErrors.places) + 0.5) / SensorErrors.places - 0.5
    further = np.arange(1, 4)[:, None]  # steps by which noise of half a step moves a reading
    scale = step / max(noise, ROUNDING * step)
    over, under = (ndtr((offset - further + 0.5) * scale) for offset in (place, -place))
    read = np.sum(over - under, axis=0)
    variance = np.sum((2 * further - 1) * (over + under), axis=0) - read**2
    return np.array([step * (read - place), step**2 * np.maximum(variance, 0.0)])


@compiled
def _sums(places: Places, moved: int, counts: Counts, by_place: Samples) -> Samples:
    """(2, m) sums of mean and variance over (m,) counts of consecutive places, all shifted."""
    result = np.zeros((2, counts.size))
    begin = 0
    for cell in range(counts.size):
        mean = variance = 0.0
        for k in range(begin, begin + counts[cell]):
            place = (places[k] + moved) & (by_place.shape[1] - 1)
            mean, variance = mean + by_place[0, place], variance + by_place[1, place]
        begin += counts[cell]
        result[0, cell], result[1, cell] = mean, variance
    return result


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A correlation over lags, with the band of that of sensor errors."""

    lag: Samples  # (l,) in s
    value: Samples  # (l,) correlation, between -1 and 1
    centre: Samples  # (l,) mean correlation of a sensor's errors
    half_width: Samples  # (l,) of the simultaneous band about it

    @property
    def excess(self) -> float:
        """Largest distance from the centre over the band's half-width."""
        return float((np.abs(self.value - self.centre) / self.half_width).max())

    @classmethod
    def of(cls, lag: Samples, curves: Samples, count: int, allowance: float) -> Curve:
        """Return a curve with its band; both curves of a good log are inside at `CONFIDENCE`.

        ``curves``: (l, 1 + k) it, and those of a sensor's errors if these are not white; ``count``:
        number of errors; ``allowance``: effect of a negligible misfit on the curve.
        """
        value, drawn, variance, centre = curves[:, 0], curves[:, 1:], 0.0, np.zeros(lag.size)
        if drawn.size:
            centre = drawn.mean(axis=1)
            variance = float(drawn.var(axis=1, ddof=1).mean()) * (1 + 1 / drawn.shape[1])
        factor = -float(ndtri((1 - CONFIDENCE) / (4 * lag.size)))
        half = factor * math.sqrt(max(variance, 1 / count)) + allowance
        return cls(lag=lag, value=value, centre=centre, half_width=np.full(lag.size, half))


def correlations(errors: Sequence[Samples], inputs: Samples, lags: int) -> tuple[Samples, Samples]:
    """Return (lags, k) correlations of k (m,) errors, (lags + 1, k) with inputs before them."""
    size = fft.next_fast_len(inputs.size + lags, real=True)
    moving = inputs - inputs.mean()
    driven = np.conj(fft.rfft(moving, size))
    auto, crossed = np.empty((2, lags + 1, len(errors)))
    for k, series in enumerate(errors):
        spectrum = fft.rfft(series, size)
        auto[:, k] = fft.irfft(np.abs(spectrum) ** 2, size)[: lags + 1]
        crossed[:, k] = fft.irfft(spectrum * driven, size)[: lags + 1]
    powers = np.where(auto[0] > 0, auto[0], 1.0)
    crossed /= np.sqrt(powers * (float(np.sum(moving**2)) or 1.0))
    return np.asarray(auto[1:] / powers), crossed


_CHANCE = 0.01  # below which waves of the angle are none

_WAVES = ("encoder sine", "encoder cosine")


@dataclass(frozen=True, kw_only=True, eq=False)
class OffCentre:
    """An encoder that reads a sine of the angle too much."""

    amplitude: float  # of the error, in rad
    rival: Rival  # (n,) values that a centred one gives, with half-widths

    @property
    def finding(self) -> Finding:
        """Its amplitude."""
        return Finding(FindingKind.OFF_CENTRE, ("p4",), number=self.amplitude)


def off_centre(
    at: Linearisation, names: Sequence[str], waves: Iterable[Samples], masses: Sequence[AddedMass]
) -> OffCentre | None:
    """Return the eccentricity that errors of free runs show, by the first n unknowns; or none.

    ``waves``: (m, 2) effects of both waves on the m equations of each log. Like a term that many
    joints have, it must have a chance below 1 %, and predict the logs of other masses better.
    """
    count, every = len(names), (*names, *_WAVES)
    cells = replace(
        at,
        names=every,
        values=np.append(at.values[:count], np.zeros(len(_WAVES))),
        lower=lower_bounds(every),
        rows=np.column_stack([at.rows[:, :count], np.concatenate([*waves])]),
    ).cells(independent_cells_of(at.ends.size, len(every)))
    nested = submodels_of(cells, masses, 0.0)
    without, whole = np.arange(len(every)) < count, np.ones(len(every), dtype=bool)
    masks = np.array([without, whole])
    before, after = np.sqrt(nested.held_out(masks))
    gain, values = before - after, nested.fitted(masks)[1]
    if not (np.isfinite(values).all() and gain.mean() > standard_error(gain)):
        return None
    about = nested.about(values).equations
    covariance, freedom = cluster_covariance(*about.stack)
    waved, degrees = covariance[count:, count:], max(float(freedom[count:].min()), 2.0)
    # Hotelling's square of two values, as an F
    square = float(values[count:] @ np.linalg.solve(waved, values[count:])) / len(_WAVES)
    if not fdtrc(len(_WAVES), degrees - 1, square * (degrees - 1) / degrees) < _CHANCE:
        return None
    half = half_widths(covariance, freedom)[:count]
    rival = Rival(values[:count], half, predicts=False)
    return OffCentre(amplitude=float(np.hypot(*values[count:])), rival=rival)
