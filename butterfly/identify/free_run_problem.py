"""The residuals of output error: all logs simulated freely, their parameters of several owners."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from butterfly.errors import InputError, nearest
from butterfly.identify.estimate import PARAMETERS, TERMS, lower_bounds
from butterfly.identify.trajectory import Trajectory
from butterfly.signals.window import STEADY_SECONDS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.model.parameters import AddedMass, LumpedParameters

    Key = tuple[str, AddedMass | str | None]  # a parameter, and whose it is: all logs', if None

LOCAL = ("zero", "bias", "velocity")
"""What may differ from mass to mass or from log to log."""

_DIFFERENCE = 1e-4  # step of the differences, as a share of a parameter's scale


class Loss(StrEnum):
    """How residuals, in robust standard deviations, count (see `scipy.optimize.least_squares`)."""

    LINEAR = "linear"
    SOFT_L1 = "soft_l1"
    HUBER = "huber"
    CAUCHY = "cauchy"


@dataclass(frozen=True, kw_only=True)
class OutputErrorOptions:
    """What is fitted, and how.

    Parameters
    ----------
    terms
        Of `TERMS`, fitted besides `PARAMETERS`; the others keep the values of the start.
    fixed
        Of all parameters, those that keep the values of the start.
    per_mass, per_log
        Which of `LOCAL` are fitted for each added mass, or each log. The encoder's zero is shared
        by all logs if it is in neither.
    window
        Length in s, at the end of a sine's log, whose errors count: how a joint starts from rest
        depends on how it came to rest. Logs of other inputs count from their start.
    loss
        How residuals count.
    check
        Whether to fit again without each added mass.
    workers
        Threads; one per core if not given.
    """

    terms: tuple[str, ...] = ("drag", "load", "bias", "p3_offset", "stribeck")
    fixed: tuple[str, ...] = ()
    per_mass: tuple[str, ...] = ()
    per_log: tuple[str, ...] = ()
    window: float = STEADY_SECONDS
    loss: Loss = Loss.LINEAR
    check: bool = True
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)

    def __post_init__(self) -> None:
        fields = {"terms": TERMS, "fixed": (*PARAMETERS, *TERMS)}
        for field_name, valid in (fields | {"per_mass": LOCAL, "per_log": LOCAL}).items():
            for name in getattr(self, field_name):
                if name not in valid:
                    raise InputError("output error", field_name, name, nearest(name, valid))


@dataclass(frozen=True, eq=False)
class LogResiduals:
    """One log's (m,) residuals and their (m, n) derivatives by the n scaled parameters."""

    residuals: NDArray[np.float64]
    jacobian: NDArray[np.float64]


class FreeRunProblem:
    """Residuals and Jacobian of a set of logs, in parameters scaled to be of order 1.

    Parameters
    ----------
    logs
        The logs.
    start
        First guess of the parameters, and the values of those that are not fitted.
    zeros
        First guess of the encoder's reading in rad of the hand at rest, per added mass.
    options
        What is fitted.
    """

    def __init__(
        self,
        logs: Sequence[Log],
        start: LumpedParameters,
        zeros: Mapping[AddedMass, float],
        options: OutputErrorOptions,
    ) -> None:
        self.logs, self._start, self._zeros = logs, start, zeros
        self._workers = options.workers
        self.names = tuple(
            name
            for name in (*PARAMETERS, *options.terms)
            if name not in {*options.fixed, *options.per_mass, *options.per_log}
        )
        self.keys = [*((name, None) for name in self.names), *_local_keys(logs, options)]
        scales = _scales(logs, start)
        self.scale = np.array([scales[name] for name, _ in self.keys])
        self.initial = np.array([self._first_guess(*key) for key in self.keys]) / self.scale
        first = [_first_sample(log, options.window) for log in logs]
        self._trajectories = [Trajectory(log, start, k) for log, k in zip(logs, first, strict=True)]
        self._motion = [float(np.std(log.angle[k:])) for log, k in zip(logs, first, strict=True)]

    def residuals(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Errors of all logs relative to their rms motion; a log's squares sum to their mean."""
        values = scaled * self.scale
        with ThreadPoolExecutor(self._workers) as pool:
            return np.concatenate(
                list(pool.map(lambda k: self._errors(k, values), range(len(self.logs))))
            )

    def by_log(self, scaled: NDArray[np.float64]) -> list[LogResiduals]:
        """Return residuals and Jacobian of each log."""
        values = scaled * self.scale
        with ThreadPoolExecutor(self._workers) as pool:
            return list(pool.map(lambda k: self._differentiate(k, values), range(len(self.logs))))

    def jacobian(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """All logs' Jacobians, one below another."""
        return np.concatenate([log.jacobian for log in self.by_log(scaled)])

    def lower(self) -> NDArray[np.float64]:
        """Lower bounds of the scaled parameters: friction takes energy out."""
        return np.asarray(lower_bounds([name for name, _ in self.keys]) / self.scale)

    def _first_guess(self, name: str, whose: AddedMass | str | None) -> float:
        if name != "zero":
            return float(getattr(self._start, name, 0.0))
        masses = {
            log.added_mass for log in self.logs if whose in {None, log.added_mass, log.source}
        }
        return float(np.median([self._zeros[mass] for mass in masses]))

    def _errors(self, index: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
        log = self.logs[index]
        own = {self.keys[k][0]: float(values[k]) for k in self._columns(log)}
        errors = self._trajectories[index].errors(
            zero=own.pop("zero"),
            velocity=own.pop("velocity", 0.0),
            parameters=replace(self._start, **own),
        )
        return np.asarray(errors / (self._motion[index] * errors.size**0.5))

    def _differentiate(self, index: int, values: NDArray[np.float64]) -> LogResiduals:
        residuals = self._errors(index, values)
        jacobian = np.zeros((residuals.size, len(self.keys)))
        for k in self._columns(self.logs[index]):
            moved = values.copy()
            moved[k] += _DIFFERENCE * self.scale[k]
            jacobian[:, k] = (self._errors(index, moved) - residuals) / _DIFFERENCE
        return LogResiduals(residuals, jacobian)

    def _columns(self, log: Log) -> list[int]:
        """Numbers of the parameters that concern one log."""
        owners = {None, log.added_mass, log.source}
        return [k for k, (_, whose) in enumerate(self.keys) if whose in owners]


def _local_keys(logs: Sequence[Log], options: OutputErrorOptions) -> list[Key]:
    masses = sorted({log.added_mass for log in logs})
    keys: list[Key] = [(name, mass) for name in options.per_mass for mass in masses]
    keys += [(name, log.source) for name in options.per_log for log in logs]
    if "zero" not in {*options.per_mass, *options.per_log}:
        keys.append(("zero", None))
    return keys


def _first_sample(log: Log, window: float) -> int:
    if log.excitation is None:
        return 0
    return int(np.searchsorted(log.time, log.time[-1] - window))


def _scales(logs: Sequence[Log], start: LumpedParameters) -> dict[str, float]:
    """Size of each parameter whose torque would be as large as the motor's, or a tenth of it."""
    swing = float(np.median([np.std(log.angle) for log in logs]))
    command = float(np.median([1.0, *(np.std(log.input) for log in logs)]))
    weight = max([1e-3, *(log.added_mass.weight for log in logs)])
    rate = float(np.median([log.excitation.omega for log in logs if log.excitation] or [5.0]))
    inertia = abs(start.p1) + max(log.added_mass.inertia for log in logs)
    torque = inertia * swing * rate**2
    speed = swing * rate
    return {
        "p1": inertia,
        "p2": 0.1 * torque / speed,
        "p3": torque / swing,
        "p4": abs(start.p4) or torque / command,
        "coulomb": 0.1 * torque,
        "delay": 0.1 / rate,
        "drag": 0.1 * torque / speed**2,
        "load": 0.1 * torque / weight,
        "bias": 0.1 * torque,
        "p3_offset": 0.1 * torque,
        "stribeck": 0.1 * torque,
        "stribeck_velocity": 0.1 * speed,
        "tilt": 0.1,
        "cogging": 0.1 * torque,
        "cogging_cosine": 0.1 * torque,
        "zero": swing,
        "velocity": speed,
    }
