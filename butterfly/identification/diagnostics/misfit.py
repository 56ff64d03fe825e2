"""What the free run of a whole model leaves over of each log, and whether sensors explain it.

From the errors of the free runs is taken what a small change of the parameters, of zeros and of
each log's start would take from them, to first order and jointly: a value that is off within its
interval is no misfit of the model. What stays is compared with errors drawn as each log's own
encoder and noise make them, averaged and reduced alike (a parametric bootstrap: Efron & Tibshirani,
An Introduction to the Bootstrap, 1993, section 6.5). A term that the model lacks is named by how
much of it a small value of that term would explain, as in a score test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.residuals import (
    INDEPENDENT,
    LEVELS,
    Curve,
    ErrorBand,
    ResidualEquations,
    ResidualSummary,
    SensorErrors,
    absent_terms,
    autocorrelation,
    cross_correlation,
    less,
    orthonormal,
    rms,
    slow_velocity,
    summarise_residuals,
)
from butterfly.identification.draws import covariance_root, honest_covariance
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import Setting
from butterfly.identification.inference.covariance import SPREADS
from butterfly.identification.segments import Segments
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.signals.frequency_response import first_counted

Samples = NDArray[np.float64]

_ALLOWED = 7e-4  # misfit over rms motion that counts for nothing: no free run is more exact
_LONGEST_LAG = 2.0  # of the correlations, in s; a quarter of the errors at most
_DRAWN = 24  # sets of sensor errors
_LEAST = 1e-3  # share of the motion for which a missing term must count, to be named
_BY_CHANCE = 0.25  # share of logs that may be outside
_NO_ERRORS = SensorErrors(step=0.0, noise=0.0)
_NOTHING = ResidualSummary(relative=0.0, noise=1.0, shares={})

_LENGTHS = ("motion", "error", "after_small_changes", "by_sensors", "encoder_step", "noise")


@dataclass(frozen=True, kw_only=True, eq=False)
class LogMisfit:
    """What the free run leaves over of one log, where its errors count (see `first_counted`).

    The defaults are those of a log that could not be simulated, or in which nothing moves.
    """

    name: str  # of the log
    label: str
    motion: float  # rms of the measured angle about its mean, in rad
    # rms of measured less simulated angle in rad, averaged over steps of the simulation
    error: float = np.inf
    left: float = np.inf  # less what a small change of parameters would take from it
    explained: float = 0.0  # the same of errors drawn as the log's sensor makes them
    sensor: SensorErrors = _NO_ERRORS
    # of what is left with itself, and with the input before it
    autocorrelation: Curve | None = None
    cross_correlation: Curve | None = None
    left_over: ResidualSummary = _NOTHING  # what it looks like, of the terms that the model lacks
    band: ErrorBand | None = None  # about the simulated angle, within which a reading is expected

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
        """How near the model follows, how far beyond the sensors, and what it looks like."""
        found = [
            Finding(FindingKind.FOLLOWED, number=self.left),
            Finding(FindingKind.TIMES_SENSORS, number=self.times),
        ]
        if terms := self.left_over.terms:
            share = self.left_over.shares[terms[0]]
            found.append(Finding(FindingKind.MISSED, terms, number=share))
        elif self.beyond_sensors:
            found.append(Finding(FindingKind.MISSED))
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
    left_over, judged = _judged(logs) if logs else (_NOTHING, [])
    rest = iter(judged)
    return Misfit(
        logs=tuple(
            next(rest)
            if isinstance(each, Errors)
            else LogMisfit(name=each.log.name, label=each.log.label, motion=each.motion)
            for each in found
        ),
        left_over=left_over,
    )


def _judged(logs: Sequence[Errors]) -> tuple[ResidualSummary, list[LogMisfit]]:
    """Judge the errors of all logs together, and of each."""
    left = less_shared(logs, [less(log.own, log.whole[:, None]) for log in logs])
    random = np.random.default_rng(0)
    sensors, drawn = zip(
        *(_drawn(log, rest[:, 0], random) for log, rest in zip(logs, left, strict=True)),
        strict=True,
    )
    errors = [np.column_stack(pair) for pair in zip(left, less_shared(logs, drawn), strict=True)]
    equations = [
        ResidualEquations(
            left=own[:, 0],
            known=log.shared,
            candidates=log.missing,
            whole=log.run.motion,
            noise=rms(own[:, 1:]),
        )
        for log, own in zip(logs, errors, strict=True)
    ]
    overall, named = summarise_residuals(equations, _LEAST)
    return overall, list(map(_log_misfit, logs, errors, sensors, named))


def _drawn(log: Errors, left: Samples, random: np.random.Generator) -> tuple[SensorErrors, Samples]:
    """Return a log's sensor, and (m, k) sets of its errors, less what its own start explains.

    They are errors about the free run as changed parameters would have it, ``left`` being the (m,)
    errors that stay.
    """
    run, setting, counted = log.run, log.run.setting, slice(log.run.first, None)
    motion = run.trajectory.run(setting.parameters, setting.zero, setting.velocity)
    angle = motion.at(run.log.time)
    instants = run.log.time[counted]
    angle[counted] -= np.interp(instants, run.trajectory.middles(), log.whole - left)
    sensor = SensorErrors.of(run.log.angle[counted], angle[counted])
    readings, sets = np.zeros(angle.size), []
    for _ in range(_DRAWN):
        readings[counted] = sensor.draw(angle[counted], random, unsure=_ALLOWED * run.motion)
        sets.append(run.trajectory.averaged(readings))
    return sensor, less(log.own, np.column_stack(sets))


def _log_misfit(
    log: Errors, errors: Samples, sensor: SensorErrors, left_over: ResidualSummary
) -> LogMisfit:
    """Judge a log by its (m, 1 + k) errors: what is left of its own, and of those drawn."""
    run, left, count = log.run, rms(errors[:, 0]), errors.shape[0]
    step = run.trajectory.step
    lags = max(1, min(round(_LONGEST_LAG / step), count // 4))
    lag = step * np.arange(lags + 1)
    allowed = _ALLOWED * run.motion / left if left else 0.0
    own = autocorrelation(errors, lags)
    crossed = cross_correlation(errors, run.trajectory.mean_inputs(run.setting.parameters), lags)
    # the spread of the parameters, to first order, beside that of the readings
    reach = SPREADS * np.hypot(log.reach, sensor.spread)
    return LogMisfit(
        name=run.log.name,
        label=run.log.label,
        motion=run.motion,
        error=rms(log.whole),
        left=left,
        explained=rms(errors[:, 1:]),
        sensor=sensor,
        autocorrelation=Curve.of(lag[1:], own, count, allowed**2),
        cross_correlation=Curve.of(lag, crossed, count, allowed),
        left_over=left_over,
        band=ErrorBand(time=run.trajectory.middles(), reach=reach),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class CountedRun:
    """One log and its free run, where its errors count (see `first_counted`)."""

    log: Log
    setting: Setting  # what it is simulated with
    first: int  # number of the first sample that counts
    trajectory: Simulation | Segments
    motion: float  # rms of the measured angle about its mean, in rad

    @classmethod
    def of(cls, log: Log, setting: Setting) -> CountedRun:
        """Make a log ready to be simulated."""
        first = first_counted(log)
        return cls(
            log=log,
            setting=setting,
            first=first,
            trajectory=setting.simulation(log, first),
            motion=float(np.std(log.angle[first:])),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Simulated less measured angle of one log, and its derivatives."""

    run: CountedRun
    whole: Samples  # (m,) errors in rad
    # (k, j) orthonormal directions in which the log's own start moves them, k of m after k where
    # the log is simulated in segments, each from a start of its own
    own: tuple[Samples, ...]
    shared: Samples  # (m, n) derivatives by what logs share, less those directions
    # by term that the model lacks: (m,) derivatives by it, less those directions
    missing: dict[str, Samples]
    # (m,) standard deviations in rad that the parameters' own errors give the simulated angle, to
    # first order; zeros where the estimate says nothing of them
    reach: Samples


def free_run_errors(data: DataSet, estimate: Estimate) -> list[CountedRun | Errors]:
    """Return the errors of each log's simulation and their derivatives.

    It is the run alone where a simulation fails or nothing moves.
    """
    slow = slow_velocity(data.logs)
    owners, missing = estimate.owners(data.unread), absent_terms(estimate, data.logs[0].added_mass)
    try:
        root = covariance_root(honest_covariance(estimate))
    except IdentifiabilityError:
        root = np.zeros((len(estimate.names),) * 2)
    settings = (data.simulations.setting(k, estimate) for k in range(len(data.logs)))
    runs = [CountedRun.of(log, each) for log, each in zip(data.logs, settings, strict=True)]
    return [
        _differentiated(
            run, names=estimate.names, root=root, owners=owners, missing=missing, slow=slow
        )
        or run
        for run in runs
    ]


def less_shared(logs: Sequence[Errors], errors: Sequence[Samples]) -> list[Samples]:
    """Take from each log's (m, k) errors what a change of shared parameters explains, jointly.

    Each log counts as it does in output error, by the mean square of its errors over its motion.
    """
    weights = [1 / (log.run.motion * log.whole.size**0.5) for log in logs]
    rows = np.concatenate([w * log.shared for w, log in zip(weights, logs, strict=True)])
    wanted = np.concatenate([w * each for w, each in zip(weights, errors, strict=True)])
    sizes = np.linalg.norm(rows, axis=0)
    sizes[sizes == 0] = 1.0
    change = np.linalg.lstsq(rows / sizes, wanted, rcond=INDEPENDENT)[0] / sizes[:, None]
    return [each - log.shared @ change for log, each in zip(logs, errors, strict=True)]


def _differentiated(
    run: CountedRun,
    *,
    names: Sequence[str],
    root: Samples,
    owners: Sequence[tuple[str, AddedMass | str | None]],
    missing: Sequence[str],
    slow: float,
) -> Errors | None:
    """Return a log's errors; None if they are no numbers, or nothing moves.

    They are differentiated by ``names`` that logs share, of which ``root`` is the (n, n) root of
    the covariance, by what some logs share, each with its ``owners``, and by ``missing`` terms. A
    log's own are the velocity and the true angle at its start, which the encoder has rounded: a
    change of it moves the readings by 1 less what one of the zero does. Stribeck friction that is
    missing is looked for below the velocity ``slow``.
    """
    setting, log = run.setting, run.log
    parameters = setting.parameters
    if "stribeck" in missing:
        parameters = replace(parameters, stribeck_velocity=slow)
    local = dict.fromkeys(["zero", "velocity", *(name for name, _ in owners)])
    asked = [*names, *local, *missing]
    with np.errstate(all="ignore"):
        errors, rows, mixture = run.trajectory.linearised(
            asked, parameters, setting.zero, setting.velocity
        )
        slopes = dict(zip(asked, (rows @ mixture).T, strict=True))
    finite = np.isfinite(errors).all() and all(np.isfinite(each).all() for each in slopes.values())
    if not (finite and run.motion > 0):
        return None
    if isinstance(run.trajectory, Segments):
        own = run.trajectory.directions(parameters, setting.zero)
    else:
        own = (orthonormal(np.column_stack([1 - slopes["zero"], slopes["velocity"]])),)
    mine = {None, log.added_mass, log.name}
    shared = [slopes[name] for name in names]
    shared += [slopes[name] * (whose in mine) for name, whose in owners]
    return Errors(
        run=run,
        whole=errors,
        own=own,
        shared=less(own, np.column_stack(shared)),
        missing={name: less(own, slopes[name]) for name in missing},
        reach=np.linalg.norm(np.column_stack([slopes[name] for name in names]) @ root.T, axis=1),
    )
