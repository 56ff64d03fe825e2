"""What the free run of a whole model leaves over of each log, and whether sensors explain it.

Measured less simulated angle is averaged over the steps of the simulation. From these errors is
taken what a small change of the parameters that all logs share, or of one log's start and zero,
would take from them, to first order and jointly: a value that is off within its interval is no
misfit of the model. What stays is compared with errors drawn as each log's own encoder and noise
make them, averaged and reduced alike (a parametric bootstrap: Efron & Tibshirani, An Introduction
to the Bootstrap, 1993, section 6.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from butterfly.identify.free_run import Trajectory
from butterfly.identify.judgement.findings import Finding, FindingKind
from butterfly.identify.judgement.sensor_errors import SensorErrors
from butterfly.identify.judgement.whiteness import Curve, autocorrelation, cross_correlation
from butterfly.identify.predict import Predictor
from butterfly.signals.window import first_counted

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.identify.data import DataSet
    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.identify.predict import Setting
    from butterfly.logs.log import Log
    from butterfly.model.parameters import AddedMass

    Samples = NDArray[np.float64]
    Key = tuple[str, AddedMass | str | None]  # what may change, and whose it is

ALLOWED = 5e-4
"""Misfit over rms motion that counts for nothing: a free run is hardly more exact than that."""

LONGEST_LAG = 2.0
"""Of the correlations, in s; a quarter of the errors at most."""

_DRAWN = 24  # sets of sensor errors
_BY_CHANCE = 0.25  # share of logs that may be outside
_INDEPENDENT = 1e-6  # singular value over the largest, below which a direction is none


@dataclass(frozen=True, kw_only=True, eq=False)
class LogMisfit:
    """What the free run leaves over of one log, where its errors count (see `first_counted`).

    Parameters
    ----------
    name, label
        Of the log.
    motion
        Rms of the measured angle about its mean, in rad.
    error
        Rms of measured less simulated angle in rad, averaged over steps of the simulation.
    left
        The same, less what a small change of parameters would take from it.
    explained
        The same of errors drawn as the log's sensor makes them.
    sensor
        That sensor.
    autocorrelation, cross_correlation
        Of what is left with itself, and with the input before it; None where a simulation failed.
    """

    name: str
    label: str
    motion: float
    error: float
    left: float
    explained: float
    sensor: SensorErrors
    autocorrelation: Curve | None
    cross_correlation: Curve | None

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Misfit:
    """What the free runs of all logs leave over.

    Parameters
    ----------
    logs
        One for each log of the data set.
    """

    logs: tuple[LogMisfit, ...]

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
    def finding(self) -> Finding:
        """The judgement: how many times the sensors' errors the misfit is, and whose."""
        kind = FindingKind.MISFIT if self.beyond_sensors else FindingKind.NO_MISFIT
        return Finding(kind=kind, number=self.times)

    @property
    def beyond_sensors(self) -> bool:
        """Whether more logs are outside than chance explains in those of one robot and one clock.

        One log in twenty is by chance; those of one robot are hardly independent of each other.
        """
        return self.outside > _BY_CHANCE * len(self.logs)


class _Linear(NamedTuple):
    """One log's errors, and what parameters would change of them, both less what is its own.

    errors (m,), shared (m, n), own (m, k) orthonormal, weight, and the (m,) errors as they are.
    """

    errors: Samples
    shared: Samples
    own: Samples
    weight: float
    whole: Samples


class _Prepared(NamedTuple):
    log: Log
    trajectory: Trajectory
    setting: Setting
    first: int
    motion: float


def judge_misfit(data: DataSet, estimate: ParameterEstimate) -> Misfit:
    """Compare what the free runs of an estimate leave over with what the sensors explain.

    Parameters
    ----------
    data
        The logs.
    estimate
        Of any method; its parameters are those that may change.
    """
    predictor = Predictor(data)
    prepared = [_prepared(log, predictor.setting(k, estimate)) for k, log in enumerate(data.logs)]
    owners = estimate.owners(data.masses)
    linear = [_linearised(each, estimate.names, owners) for each in prepared]
    sound = [k for k, each in enumerate(linear) if each is not None]
    parts = [each for each in linear if each is not None]
    left = _less_shared(parts, [part.errors[:, None] for part in parts])
    random = np.random.default_rng(0)
    drawn, sensors = [], []
    for k, part, rest in zip(sound, parts, left, strict=True):
        sensor, errors = _drawn(prepared[k], part.whole - rest[:, 0], random)
        sensors.append(sensor)
        drawn.append(errors - part.own @ (part.own.T @ errors))
    reduced = _less_shared(parts, drawn)
    judged = {
        k: _judged(prepared[k], part, np.column_stack([rest, noise]), sensor)
        for k, part, rest, noise, sensor in zip(sound, parts, left, reduced, sensors, strict=True)
    }
    return Misfit(
        logs=tuple(judged.get(k) or _failed(each) for k, each in enumerate(prepared))
    )


def _prepared(log: Log, setting: Setting) -> _Prepared:
    first = first_counted(log)
    trajectory = Trajectory(log, setting.parameters, first)
    return _Prepared(log, trajectory, setting, first, float(np.std(log.angle[first:])))


def _linearised(each: _Prepared, names: tuple[str, ...], owners: list[Key]) -> _Linear | None:
    """Return the linearised errors, simulated less measured; None where the simulation fails.

    A log's own are the velocity and the true angle at its start, which the encoder has rounded: a
    change of it moves the readings by 1 less what one of the zero does.
    """
    local = list(dict.fromkeys(["zero", *(name for name, _ in owners), "velocity"]))
    setting, log = each.setting, each.log
    with np.errstate(all="ignore"):
        errors, rows, mixture = each.trajectory.linearised(
            [*names, *local], setting.parameters, setting.zero, setting.velocity
        )
        slopes = rows @ mixture
    if not (np.isfinite(errors).all() and np.isfinite(slopes).all() and each.motion > 0):
        return None
    found = dict(zip(local, slopes[:, len(names) :].T, strict=True))
    own = _orthonormal(np.column_stack([1 - found["zero"], found["velocity"]]))
    mine = {None, log.added_mass, log.name}
    owned = [found[name] * (whose in mine) for name, whose in owners]
    shared = np.column_stack([slopes[:, : len(names)], *owned])
    return _Linear(
        errors=errors - own @ (own.T @ errors),
        shared=shared - own @ (own.T @ shared),
        own=own,
        weight=1 / (each.motion * errors.size**0.5),
        whole=errors,
    )


def _orthonormal(columns: Samples) -> Samples:
    """(m, k) orthonormal columns that span the given ones."""
    sizes = np.linalg.norm(columns, axis=0)
    felt = sizes > _INDEPENDENT * columns.shape[0] ** 0.5  # more than that of what moved the start
    left, singular, _ = np.linalg.svd(columns[:, felt] / sizes[felt], full_matrices=False)
    return np.asarray(left[:, singular > _INDEPENDENT * singular.max(initial=0.0)])


def _less_shared(parts: list[_Linear], errors: list[Samples]) -> list[Samples]:
    """Take from each log's (m, k) errors what a change of the shared parameters explains jointly.

    Each log counts as it does in output error, by its errors over its motion.
    """
    if not parts:
        return []
    rows = np.concatenate([part.weight * part.shared for part in parts])
    sizes = np.linalg.norm(rows, axis=0)
    sizes[sizes == 0] = 1.0
    wanted = np.concatenate(
        [part.weight * each for part, each in zip(parts, errors, strict=True)]
    )
    change = np.linalg.lstsq(rows / sizes, wanted, rcond=_INDEPENDENT)[0] / sizes[:, None]
    return [each - part.shared @ change for part, each in zip(parts, errors, strict=True)]


def _drawn(
    each: _Prepared, misses: Samples, random: np.random.Generator
) -> tuple[SensorErrors, Samples]:
    """Return a log's sensor, and (m, k) sets of its errors about the corrected free run.

    ``misses`` is (m,), what a change of parameters would take from simulated less measured angle.
    """
    setting, counted = each.setting, slice(each.first, None)
    simulated = each.trajectory.at_stamps(setting.parameters, setting.zero, setting.velocity)
    instants = each.log.time[counted]
    angle = simulated[counted] - np.interp(instants, each.trajectory.middles(), misses)
    sensor = SensorErrors.of(each.log.angle[counted], angle)
    at_stamps = np.zeros(simulated.size)
    sets = []
    for _ in range(_DRAWN):
        at_stamps[counted] = sensor.draw(angle, random, unsure=ALLOWED * each.motion)
        sets.append(each.trajectory.averaged(at_stamps))
    return sensor, np.column_stack(sets)


def _judged(
    each: _Prepared, part: _Linear, errors: Samples, sensor: SensorErrors
) -> LogMisfit:
    """Judge a log by its (m, 1 + k) errors: what is left of its own, and of those drawn."""
    left, explained = _rms(errors[:, 0]), _rms(errors[:, 1:])
    step = float(each.trajectory.grid[1] - each.trajectory.grid[0])
    lags = max(1, min(round(LONGEST_LAG / step), errors.shape[0] // 4))
    allowed = ALLOWED * each.motion / left if left else 0.0
    inputs = each.trajectory.mean_inputs(each.setting.parameters)
    lag = step * np.arange(lags + 1)
    own = autocorrelation(errors, lags)
    crossed = cross_correlation(errors, inputs, lags)
    count = errors.shape[0]
    return LogMisfit(
        name=each.log.name,
        label=each.log.label,
        motion=each.motion,
        error=_rms(part.whole),
        left=left,
        explained=explained,
        sensor=sensor,
        autocorrelation=Curve.of(lag[1:], own, count, allowed**2),
        cross_correlation=Curve.of(lag, crossed, count, allowed),
    )


def _failed(each: _Prepared) -> LogMisfit:
    """Return the misfit of a log that could not be simulated, or in which nothing moves."""
    return LogMisfit(
        name=each.log.name,
        label=each.log.label,
        motion=each.motion,
        error=np.inf,
        left=np.inf,
        explained=0.0,
        sensor=SensorErrors(step=0.0, noise=0.0),
        autocorrelation=None,
        cross_correlation=None,
    )


def _rms(values: Samples) -> float:
    return float(np.sqrt(np.mean(values**2)))
