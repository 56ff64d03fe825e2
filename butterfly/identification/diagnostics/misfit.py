"""What the free run of a whole model leaves over of each log, and whether sensors explain it.

From the errors of the free runs is taken what a small change of the parameters, of zeros and of
each log's start would take from them, to first order and jointly: a value that is off within its
interval is no misfit of the model. What stays is compared with errors drawn as each log's own
encoder and noise make them, averaged and reduced alike (a parametric bootstrap: Efron & Tibshirani,
An Introduction to the Bootstrap, 1993, section 6.5). A term that the model lacks is named by how
much of it a small value of that term would explain, as in a score test.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.residuals import (
    CountedRun,
    Errors,
    ResidualEquations,
    ResidualSummary,
    free_run_errors,
    less_shared,
    summarise_residuals,
)
from butterfly.identification.diagnostics.sensor_errors import SensorErrors
from butterfly.identification.estimate import Estimate
from butterfly.identification.inference.intervals import SPREADS
from butterfly.model.parameters import JointKind

Samples = NDArray[np.float64]

ALLOWED = 7e-4
"""Misfit over rms motion that counts for nothing: a free run is hardly more exact than that."""

LONGEST_LAG = 2.0
"""Of the correlations, in s; a quarter of the errors at most."""

_DRAWN = 24  # sets of sensor errors
_LEAST = 1e-3  # share of the motion for which a missing term must count, to be named
_BY_CHANCE = 0.25  # share of logs that may be outside
_NOTHING = ResidualSummary(relative=0.0, noise=1.0, shares={})

LEVELS = (0.95, 0.99)
"""Shares of logs without a misfit whose two curves both stay inside the inner and outer band."""

_LENGTHS = ("motion", "error", "after_small_changes", "by_sensors", "encoder_step", "noise")

_CURVES = 2  # autocorrelation and cross-correlation, which share the false alarms
_SMOOTHED = 10  # lags on either side over which the spread of drawn curves is averaged


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorBand:
    """How far a reading may be from the simulation, by the parameters and the sensor."""

    time: Samples  # (m,) instants in s
    reach: Samples  # (m,) half widths in rad, at `CONFIDENCE`

    @classmethod
    def of(cls, log: Errors, sensor: SensorErrors) -> ErrorBand:
        """Add the spread of the parameters, to first order, to that of the readings."""
        reach = SPREADS * np.hypot(log.reach, sensor.spread)
        return cls(time=log.run.trajectory.middles(), reach=reach)


@dataclass(frozen=True, kw_only=True, eq=False)
class LogMisfit:
    """What the free run leaves over of one log, where its errors count (see `first_counted`)."""

    name: str  # of the log
    label: str
    motion: float  # rms of the measured angle about its mean, in rad
    # rms of measured less simulated angle in rad, averaged over steps of the simulation
    error: float
    left: float  # the same, less what a small change of parameters would take from it
    explained: float  # the same of errors drawn as the log's sensor makes them
    sensor: SensorErrors
    # of what is left with itself, and with the input before it; None where a simulation failed
    autocorrelation: Curve | None
    cross_correlation: Curve | None
    left_over: ResidualSummary  # what it looks like, of the terms that the model lacks
    # about the simulated angle, within which a reading is expected; None where a simulation failed
    band: ErrorBand | None

    @cached_property
    def excess(self) -> tuple[float, float]:
        """How far the curves reach, over inner and outer band: above 1, one leaves it."""
        curves = [each for each in (self.autocorrelation, self.cross_correlation) if each]
        if not curves:
            return np.inf, np.inf
        inner, outer = np.max([curve.excess for curve in curves], axis=0).tolist()
        return inner, outer

    @property
    def outside(self) -> bool:
        """Whether it is more than sensors explain, of which 5 % of good logs are accused."""
        return self.excess[0] > 1

    @property
    def relative(self) -> float:
        """Rms error over rms motion."""
        return self.error / self.motion if self.motion else np.inf

    @property
    def times(self) -> float:
        """What is left over what the sensor explains."""
        return self.left / self.explained if self.explained else np.inf

    def numbers(self) -> dict[str, Any]:
        """Return it for programs."""
        sensor = self.sensor
        lengths = (self.motion, self.error, self.left, self.explained, sensor.step, sensor.noise)
        return {
            "log": self.name,
            **dict(zip(_LENGTHS, lengths, strict=True)),
            "over_band": dict(zip(map(str, LEVELS), self.excess, strict=True)),
            "left_over": self.left_over.numbers(),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Misfit:
    """What the free runs of all logs leave over."""

    logs: tuple[LogMisfit, ...]  # one for each log of the data set
    left_over: ResidualSummary  # what all of it looks like, of the terms that the model lacks

    @property
    def outside(self) -> int:
        """How many logs are more than sensors explain."""
        return sum(log.outside for log in self.logs)

    @property
    def relative(self) -> float:
        """Rms over the logs of error over motion."""
        return float(np.sqrt(np.mean([log.relative**2 for log in self.logs])))

    @property
    def explained(self) -> float:
        """Rms over the logs of what sensors explain over motion."""
        shares = [log.explained / log.motion for log in self.logs if log.motion]
        return float(np.sqrt(np.mean(np.square(shares)))) if shares else np.inf

    @property
    def left(self) -> float:
        """Rms over the logs of what no small change of the parameters explains, over motion."""
        shares = [log.left / log.motion if log.motion else np.inf for log in self.logs]
        return float(np.sqrt(np.mean(np.square(shares))))

    @property
    def times(self) -> float:
        """What is left over what sensors explain."""
        return self.left / self.explained if self.explained else np.inf

    @property
    def beyond_sensors(self) -> bool:
        """Whether more logs are outside than chance explains in those of one robot and one clock.

        One log in twenty is by chance; those of one robot are hardly independent of each other.
        """
        return self.outside > _BY_CHANCE * len(self.logs)

    @property
    def findings(self) -> list[Finding]:
        """Whether the misfit is beyond the sensors, how many times, and what it looks like."""
        kind = FindingKind.MISFIT if self.beyond_sensors else FindingKind.NO_MISFIT
        found = [Finding(kind=kind, number=self.times)]
        if self.left_over.terms:
            likeliest = self.left_over.terms[0]
            share = self.left_over.shares[likeliest]
            like = FindingKind.LEFT_OVER
            found.append(Finding(kind=like, parameters=self.left_over.terms, number=share))
        return found

    def numbers(self) -> dict[str, Any]:
        """Return it for programs but for its findings: shares of the rms motion, over all logs."""
        return {
            "relative": self.relative,
            "after_small_changes": self.left,
            "by_sensors": self.explained,
            "times_sensors": self.times,
            "beyond_sensors": self.beyond_sensors,
            "logs_outside": self.outside,
            "left_over": self.left_over.numbers(),
            "logs": [log.numbers() for log in self.logs],
        }


def misfit_units(joint: JointKind, place: str = "misfit.") -> dict[str, str]:
    """Return the units of `Misfit.numbers` that stand in some place of a document."""
    return {f"{place}logs.{name}": joint.way for name in _LENGTHS}


def judge_misfit(data: DataSet, estimate: Estimate) -> Misfit:
    """Compare what the free runs of an estimate leave over with what the sensors explain."""
    found = free_run_errors(data, estimate)
    logs = [each for each in found if isinstance(each, Errors)]
    if not logs:
        failed = (_failed(each) for each in found if isinstance(each, CountedRun))
        return Misfit(logs=tuple(failed), left_over=_NOTHING)
    left = less_shared(logs, [log.less_own(log.whole[:, None]) for log in logs])
    random = np.random.default_rng(0)
    sensors, drawn = zip(
        *(_drawn(log, rest[:, 0], random) for log, rest in zip(logs, left, strict=True)),
        strict=True,
    )
    errors = [np.column_stack(pair) for pair in zip(left, less_shared(logs, drawn), strict=True)]
    overall, named = summarise_residuals(
        [_balance(*pair) for pair in zip(logs, errors, strict=True)], _LEAST
    )
    logs_misfit = map(_log_misfit, logs, errors, sensors, named)
    return Misfit(
        logs=tuple(
            _failed(each) if isinstance(each, CountedRun) else next(logs_misfit) for each in found
        ),
        left_over=overall,
    )


def _drawn(log: Errors, left: Samples, random: np.random.Generator) -> tuple[SensorErrors, Samples]:
    """Return a log's sensor, and (m, k) sets of its errors, less what its own start explains.

    They are errors about the free run as changed parameters would have it, ``left`` being the (m,)
    errors that stay.
    """
    run, counted = log.run, slice(log.run.first, None)
    angle, instants = run.simulated(), run.log.time[counted]
    angle[counted] -= np.interp(instants, run.trajectory.middles(), log.whole - left)
    sensor = SensorErrors.of(run.log.angle[counted], angle[counted])
    readings, sets = np.zeros(angle.size), []
    for _ in range(_DRAWN):
        readings[counted] = sensor.draw(angle[counted], random, unsure=ALLOWED * run.motion)
        sets.append(run.trajectory.averaged(readings))
    return sensor, log.less_own(np.column_stack(sets))


def _balance(log: Errors, errors: Samples) -> ResidualEquations:
    """Return what a log says of missing terms: errors (m, 1 + k) left of its own, and drawn."""
    return ResidualEquations(
        left=errors[:, 0],
        known=log.shared,
        candidates=log.missing,
        whole=log.run.motion,
        noise=_rms(errors[:, 1:]),
    )


def _log_misfit(
    log: Errors, errors: Samples, sensor: SensorErrors, left_over: ResidualSummary
) -> LogMisfit:
    """Judge a log by its (m, 1 + k) errors: what is left of its own, and of those drawn."""
    run, left, count = log.run, _rms(errors[:, 0]), errors.shape[0]
    step = run.trajectory.step
    lags = max(1, min(round(LONGEST_LAG / step), count // 4))
    lag = step * np.arange(lags + 1)
    allowed = ALLOWED * run.motion / left if left else 0.0
    own = autocorrelation(errors, lags)
    crossed = cross_correlation(errors, run.trajectory.mean_inputs(run.setting.parameters), lags)
    return LogMisfit(
        name=run.log.name,
        label=run.log.label,
        motion=run.motion,
        error=_rms(log.whole),
        left=left,
        explained=_rms(errors[:, 1:]),
        sensor=sensor,
        autocorrelation=Curve.of(lag[1:], own, count, allowed**2),
        cross_correlation=Curve.of(lag, crossed, count, allowed),
        left_over=left_over,
        band=ErrorBand.of(log, sensor),
    )


def _failed(run: CountedRun) -> LogMisfit:
    """Return the misfit of a log that could not be simulated, or in which nothing moves."""
    return LogMisfit(
        name=run.log.name,
        label=run.log.label,
        motion=run.motion,
        error=np.inf,
        left=np.inf,
        explained=0.0,
        sensor=SensorErrors(step=0.0, noise=0.0),
        autocorrelation=None,
        cross_correlation=None,
        left_over=_NOTHING,
        band=None,
    )


def _rms(values: Samples) -> float:
    return float(np.sqrt(np.mean(values**2)))


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
