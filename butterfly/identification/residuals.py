"""Residuals of free runs, and whether sensors or missing terms explain them.

From the errors of the free runs the effects of small changes of the parameters, of zeros and of
each log's start are projected out, to first order and jointly: a value that is off within its
interval is no misfit. The remainder is compared with errors drawn from the model of each log's
encoder and noise (a parametric bootstrap: Efron & Tibshirani, An Introduction to the Bootstrap,
1993, section 6.5). Missing terms are those that the choice of terms left out, though they help.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.fit import MissingTerms
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.identification.linearisation import Linearisation
from butterfly.identification.predict import covariance_root, honest_covariance
from butterfly.identification.problem import Key, columns_of, labels_of, relative
from butterfly.identification.sensor_errors import (
    Curve,
    OffCentre,
    SensorErrors,
    correlations,
    off_centre,
)
from butterfly.identification.simulation import Averages, StartEffects
from butterfly.identification.trust import DRAWS, SHOWS, Finding, FindingKind
from butterfly.logs.log import Log
from butterfly.model.parameters import JointKind
from butterfly.signals.frequency_response import first_counted
from butterfly.verdict import SPREADS

_LONGEST_LAG = 2.0  # of the correlations, in s; a quarter of the errors at most
_BY_CHANCE = 0.25  # share of logs that may be outside

_NO_ERRORS = SensorErrors(step=0.0, noise=0.0)
_LENGTHS = ("motion", "error", "after_small_changes", "by_sensors", "encoder_step", "noise")


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorBand:
    """Band about the simulation, by the uncertainty of the parameters and the sensor."""

    time: Samples  # (m,) instants in s
    half_width: Samples  # (m,) in rad, at `CONFIDENCE`


@dataclass(frozen=True, kw_only=True, eq=False)
class LogResiduals:
    """Residuals of one log's free run, from `first_counted` on.

    The defaults are those of a log that cannot be simulated or does not move.
    """

    name: str  # of the log
    label: str
    motion: float  # rms of the measured angle about its mean, in rad
    # rms of measured less simulated angle in rad, averaged over steps of the simulation
    error: float = np.inf
    remaining: float = np.inf  # the same after small changes of the parameters
    explained: float = 0.0  # the same of errors drawn from the sensor's model
    share: float = 0.0  # of the squared residuals that the missing terms explain
    sensor: SensorErrors = _NO_ERRORS
    # of the residuals with themselves, and with the input before them
    autocorrelation: Curve | None = None
    cross_correlation: Curve | None = None
    band: ErrorBand | None = None  # about the simulated angle, within which a reading is expected
    counted: bool = True  # false where no free run can stay near: it passes the upright

    @cached_property
    def excess(self) -> float:
        """Largest distance of the curves from their centres, over the half-width of the band."""
        curves = (self.autocorrelation, self.cross_correlation)
        return max((curve.excess for curve in curves if curve), default=np.inf)

    @property
    def outside(self) -> bool:
        """Whether residuals exceed the sensor's errors, as those of 5 % of good logs do."""
        return self.counted and self.excess > 1

    @property
    def relative(self) -> float:
        """Rms error over rms motion."""
        return self.error / self.motion if self.motion else np.inf

    @property
    def times(self) -> float:
        """Rms residual over that of the sensor's errors."""
        return self.remaining / self.explained if self.explained else np.inf

    def numbers(self) -> dict[str, Any]:
        """Return all numbers, for programs."""
        sensor = self.sensor
        lengths = (
            self.motion,
            self.error,
            self.remaining,
            self.explained,
            sensor.step,
            sensor.noise,
        )
        return {
            "log": self.name,
            **dict(zip(_LENGTHS, lengths, strict=True)),
            "over_band": self.excess,
            "missing_terms_share": self.share,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Residuals:
    """Residuals of the free runs of all logs."""

    logs: tuple[LogResiduals, ...]  # one for each log of the data set
    # where sensors do not explain the residuals
    missing: MissingTerms = field(default_factory=MissingTerms)
    encoder: OffCentre | None = None  # where errors repeat with the angle

    @property
    def counted(self) -> tuple[LogResiduals, ...]:
        """The logs that judge the model."""
        return tuple(filter(attrgetter("counted"), self.logs))

    @property
    def outside(self) -> int:
        """Number of logs whose residuals exceed the sensor's errors."""
        return sum(log.outside for log in self.logs)

    @property
    def relative(self) -> float:
        """Rms over the logs of error over motion."""
        return self._over_motion("error")

    @property
    def explained(self) -> float:
        """Rms over the logs of the sensor's errors over motion."""
        return self._over_motion("explained")

    @property
    def remaining(self) -> float:
        """Rms over the logs of the residuals after small changes of the parameters, over motion."""
        return self._over_motion("remaining")

    def _over_motion(self, length: str) -> float:
        """Return the rms over the logs that move, and count, of a length over the motion."""
        shares = [
            getattr(log, length) / log.motion for log in self.logs if log.motion and log.counted
        ]
        return float(np.sqrt(np.mean(np.square(shares)))) if shares else np.inf

    @property
    def times(self) -> float:
        """Rms residual over that of the sensors' errors."""
        return self.remaining / self.explained if self.explained else np.inf

    @property
    def beyond_sensors(self) -> bool:
        """Whether more logs are outside than by chance, logs of one robot being correlated."""
        return self.outside > _BY_CHANCE * len(self.counted)

    @property
    def findings(self) -> list[Finding]:
        """Findings: relative residual, its ratio to the sensors' errors, and missing terms."""
        kind = FindingKind.MISFIT if self.beyond_sensors else FindingKind.NO_MISFIT
        followed = Finding(FindingKind.FOLLOWED, number=self.remaining)
        off = [self.encoder.finding] if self.encoder else []
        return [followed, Finding(kind, number=self.times), *off, *self.missing.findings]

    def numbers(self) -> dict[str, Any]:
        """Return all numbers but the findings, for programs: shares of the rms motion of logs."""
        return {
            "relative": self.relative,
            "after_small_changes": self.remaining,
            "by_sensors": self.explained,
            "times_sensors": self.times,
            "beyond_sensors": self.beyond_sensors,
            "logs_outside": self.outside,
            "missing_terms": list(self.missing.terms),
            "missing_terms_or": [list(terms) for terms in self.missing.others],
            "missing_terms_share": self.missing.share,
            "logs": [log.numbers() for log in self.logs],
        }


def residual_units(joint: JointKind) -> dict[str, str]:
    """Return the units of `Residuals.numbers` in the ``residuals`` of a document."""
    return {f"residuals.logs.{name}": joint.way for name in _LENGTHS}


def residuals_of(data: DataSet, estimate: Estimate, runs: Sequence[FreeRun] = ()) -> Residuals:
    """Return the residuals of an estimate's free runs, compared with sensors and missing terms."""
    unknowns, counted = _Unknowns.of(data, estimate), {*data.simulations.judging(estimate)}
    every, parts = list[_RunErrors | None](), list[tuple[Samples, Samples]]()
    bare = list[LogResiduals]()  # of logs that are not judged
    for k in range(len(data.logs)):
        run = runs[k] if runs else data.simulations.run(k, estimate)
        bare.append(_bare(data.logs[k]))
        if k not in counted:
            every.append(None)
            bare[k] = replace(bare[k], error=run.rms, counted=False)
            continue
        expanded = unknowns.expanded(run, data.simulations.setting(k, estimate))
        every.append(expanded and expanded[0])
        parts += [expanded[1]] if expanded else []
    run_errors = [errors for errors in every if errors is not None]
    if not run_errors:
        return Residuals(logs=tuple(bare))
    at, random = unknowns.equations(parts), np.random.default_rng(0)
    parts.clear()  # they are as large as the equations that they make
    directions = at.directions(len(unknowns.keys))
    residuals = at.moved(-directions @ (directions.T @ at.gradient))
    pairs = list(zip(run_errors, residuals.by_log, strict=True))
    draws = [errors.drawn(rest, random) for errors, rest in pairs]
    _reduce([errors for _, errors in draws], at, directions)
    judged = [
        errors.judged(rest, *drawn) for (errors, rest), drawn in zip(pairs, draws, strict=True)
    ]
    del residuals, pairs, draws
    following = iter(judged)
    places = zip(bare, every, strict=True)
    whole = (log if errors is None else next(following) for log, errors in places)
    result = Residuals(logs=tuple(whole), encoder=unknowns.off_centre(at, run_errors))
    if not result.beyond_sensors:
        return result
    shares = estimate.missing.shares
    logs = (replace(log, share=shares.get(log.name, 0.0)) for log in result.logs)
    return replace(result, logs=tuple(logs), missing=estimate.missing)


def _bare(log: Log) -> LogResiduals:
    """Return the residuals of a log that cannot be simulated or does not move."""
    motion = float(np.std(log.measured[first_counted(log) :]))
    return LogResiduals(name=log.name, label=log.label, motion=motion)


@dataclass(frozen=True, kw_only=True, eq=False)
class _RunErrors:
    """The m errors of one log's free run where they count, with their derivatives."""

    run: FreeRun
    first: int  # number of the first sample that counts
    step: float  # of the simulation in s
    averages: Averages
    blank: LogResiduals  # name and motion of the log
    errors: Samples  # (m,) simulated less measured angle in rad, weighted by roots of `averages`
    starts: StartEffects  # how the starts of segments move errors
    # (m,) standard deviations in rad of the simulated angle by the parameters, to first order
    deviation: Samples

    @cached_property
    def negligible(self) -> float:
        """Negligible error in rad: a share of the rms motion about its linear trend."""
        log = self.run.log
        time, angle = (
            series[self.first :] - series[self.first :].mean()
            for series in (log.time, log.measured)
        )
        return SHOWS * float(np.std(angle - time * ((time @ angle) / (time @ time))))

    @property
    def waves(self) -> Samples:
        """(m, 2) relative effects on the errors of a sine and cosine that the encoder adds."""
        middles, roots = self.averages.middles, self.averages.roots
        angle = np.interp(middles, self.run.log.time, self.run.simulated)
        read = np.column_stack([-np.sin(angle) * roots, -np.cos(angle) * roots])
        self.starts.take_away(read)
        return np.asarray(read / (self.blank.motion * middles.size**0.5))

    def drawn(
        self, residuals: Samples, random: np.random.Generator
    ) -> tuple[SensorErrors, Samples]:
        """Return the sensor by (m,) residuals, and (m, k) draws of its errors; k is 0 if white."""
        counts, roots, middles, _ = self.averages
        unit, counted = self.blank.motion * residuals.size**0.5, slice(self.first, None)  # rad
        angle = self.run.simulated[counted] - np.interp(
            self.run.log.time[counted], middles, (self.errors - unit * residuals) / roots
        )
        sensor = SensorErrors.of(self.run.log.measured[counted], angle)
        if sensor.white:
            return sensor, np.empty((residuals.size, 0))
        shifts = self.negligible * random.standard_normal(DRAWS)
        drawn = sensor.draw(angle, shifts, counts, random)
        drawn *= roots[:, np.newaxis] / unit
        self.starts.take_away(drawn)
        return sensor, drawn

    def judged(self, residuals: Samples, sensor: SensorErrors, drawn: Samples) -> LogResiduals:
        """Return the log's residuals by (m,) relative ones, compared with (m, k) drawn ones."""
        count, motion = residuals.size, self.blank.motion
        size = motion * float(np.linalg.norm(residuals))
        lags = max(1, min(round(_LONGEST_LAG / self.step), count // 4))
        lag = np.asarray(self.step * np.arange(lags + 1), dtype=np.float64)
        allowed = self.negligible / size if size else 0.0
        auto, crossed = correlations([residuals, *drawn.T], self.averages.inputs, lags)
        white = sensor.spread * (count / (self.run.log.time.size - self.first)) ** 0.5
        by_draws = motion * float(np.linalg.norm(drawn)) / DRAWS**0.5
        # of the parameters, to first order, and of the readings
        half_width = SPREADS * np.hypot(self.deviation, sensor.spread)
        return replace(
            self.blank,
            error=float(np.linalg.norm(self.errors)) / count**0.5,
            remaining=size,
            explained=white if sensor.white else by_draws,
            sensor=sensor,
            autocorrelation=Curve.of(lag[1:], auto, count, allowed**2),
            cross_correlation=Curve.of(lag, crossed, count, allowed),
            band=ErrorBand(time=self.averages.middles, half_width=half_width),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Unknowns:
    """The unknowns by which errors are differentiated."""

    estimate: Estimate
    keys: tuple[Key, ...]  # of its n unknowns: the parameters, then zeros and biases
    root: Samples  # (p, p) root of the covariance of p parameters; zeros where there is none

    @classmethod
    def of(cls, data: DataSet, estimate: Estimate) -> _Unknowns:
        """Return the unknowns of an estimate."""
        try:
            root = covariance_root(honest_covariance(estimate))
        except IdentifiabilityError:
            root = np.zeros((len(estimate.names),) * 2)
        owners = estimate.owners(data.unread)
        keys = (*((name, None) for name in estimate.names), *owners)
        return cls(estimate=estimate, keys=keys, root=root)

    def expanded(
        self, run: FreeRun, setting: Setting
    ) -> tuple[_RunErrors, tuple[Samples, Samples]] | None:
        """Return the errors of a log's free run, and (m,) relative ones with (m, n) derivatives.

        The latter have the effects of starts projected out. None if the run fails or nothing moves.
        """
        log, first, blank = run.log, first_counted(run.log), _bare(run.log)
        columns = columns_of(self.keys, log)
        simulation = setting.simulation(log, first)
        about = (setting.parameters, setting.zero, setting.velocity)
        with np.errstate(all="ignore"):
            errors, rows, starts = simulation.with_starts([*columns], *about)
            squares = [run.fit, float(errors @ errors), float(np.vdot(rows, rows))]
        if not (blank.motion > 0 and np.isfinite(squares).all()):
            return None
        averages = simulation.averages(setting.parameters)
        deviation = np.linalg.norm(rows[:, : len(self.root)] @ self.root.T, axis=1)
        residuals = errors.copy()
        # else `with_starts` has done it
        for array in () if simulation.fitted else (residuals, rows):
            starts.take_away(array)
        run_errors = _RunErrors(
            run=run,
            first=first,
            step=simulation.step,
            averages=averages,
            blank=blank,
            errors=errors,
            starts=starts,
            deviation=deviation / averages.roots,
        )
        numbers = [*columns.values()]
        return run_errors, relative(residuals, rows, numbers, len(self.keys), blank.motion)

    def equations(self, parts: Sequence[tuple[Samples, Samples]]) -> Linearisation:
        """Return the equations of free runs in the n unknowns."""
        more = np.zeros(len(self.keys) - self.estimate.values.size)
        values = np.append(self.estimate.values, more)
        return Linearisation.of_logs(parts, labels_of(self.keys), values)

    def off_centre(self, at: Linearisation, runs: Sequence[_RunErrors]) -> OffCentre | None:
        """Return the eccentricity of the encoder that errors show, if any, with (p,) values."""
        logs = [errors.run.log for errors in runs]
        if self.estimate.joint is not JointKind.HINGE or any(log.integrated for log in logs):
            return None
        masses, size = [log.added_mass for log in logs], self.estimate.values.size
        encoder = off_centre(at, labels_of(self.keys), (errors.waves for errors in runs), masses)
        return encoder and replace(encoder, rival=encoder.rival.within(slice(size)))


def _reduce(errors: Sequence[Samples], at: Linearisation, directions: Samples) -> None:
    """Subtract from each log's (m, k) errors, in place, the effect of the best common steps.

    These are along (n, d) directions; logs with k = 0 are not changed.
    """
    logs = np.split(at.rows, at.ends[:-1])
    pairs = [(rows, draws) for rows, draws in zip(logs, errors, strict=True) if draws.size]
    pulls = [draws.T @ rows for rows, draws in pairs]
    steps = -np.sum(pulls, axis=0) @ directions @ directions.T if pulls else np.empty(0)
    for rows, draws in pairs:
        for draw, step in enumerate(steps):
            draws[:, draw] += rows @ step
