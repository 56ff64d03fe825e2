"""Free runs about an estimate, to first order: what stays of their errors if all follows.

A log's own are the velocity and the true angle at its start; logs share the parameters, zeros and
biases. What a small change of these would take from the errors is no misfit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples, take_away, unit_diagonal
from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.sensor_errors import SensorErrors
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.identification.inference.linear_terms import candidates, stribeck_velocities
from butterfly.identification.levels import DRAWS, ROUNDING, SHOWS
from butterfly.identification.predict import covariance_root, honest_covariance
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import TERMS
from butterfly.signals.frequency_response import first_counted


class Derivatives(NamedTuple):
    """What the errors are differentiated by."""

    names: tuple[str, ...]  # parameters that logs share
    owners: list[tuple[str, AddedMass | str | None]]  # whose each zero and bias is
    lacking: tuple[str, ...]  # terms of the table that the model lacks and the logs may tell
    slow: float  # velocity in rad/s below which Stribeck friction is looked for
    root: Samples  # (n, n) root of the covariance; zeros where there is none

    @classmethod
    def of(cls, data: DataSet, estimate: Estimate) -> Derivatives:
        """Take all that an estimate has, and the terms that it lacks."""
        owners = estimate.owners(data.unread)
        has = {*estimate.names, *(name for name, _ in owners)}
        named = [row.name for row in TERMS.values() if row.looks_like and row.name not in has]
        lacking = candidates(named, data.masses, estimate.known)
        fastest = math.sqrt(2) * max(log.rms_speed for log in data.logs)
        speeds = stribeck_velocities(fastest, estimate.known) or [1.0]
        try:
            root = covariance_root(honest_covariance(estimate))
        except IdentifiabilityError:
            root = np.zeros((len(estimate.names),) * 2)
        return cls(
            names=estimate.names,
            owners=owners,
            lacking=tuple(name for name in lacking if not getattr(estimate.parameters, name)),
            slow=speeds[len(speeds) // 2],
            root=root,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearisedRun:
    """One log's free run, where its errors count, and what it changes by."""

    run: FreeRun
    step: float  # of the simulation in s
    counts: NDArray[np.int64]  # (m,) samples that each error is averaged over
    middles: Samples  # (m,) instants in s, middles of steps
    inputs: Samples  # (m,) means of the delivered input
    counted: slice  # the samples whose errors count
    motion: float  # rms of the measured angle about its mean, in rad
    whole: Samples  # (m,) simulated less measured angle in rad
    # (k, j) orthonormal directions in which the log's own start moves it, k of m after k where the
    # log is simulated in segments, each from a start of its own
    own: tuple[Samples, ...]
    errors: Samples  # (m,) errors less those directions
    known: Samples  # (m, n) derivatives by what the model has, less those directions
    lacking: Samples  # (m, j) derivatives by the terms that it lacks, less those directions
    # (m,) standard deviations in rad that the parameters' own errors give the simulated angle, to
    # first order; zeros where the estimate says nothing of them
    reach: Samples

    @classmethod
    def of(cls, run: FreeRun, setting: Setting, model: Derivatives) -> LinearisedRun | None:
        """Differentiate a log's free run; None if it fails or nothing moves."""
        log, parameters = run.log, setting.parameters
        first = first_counted(log)
        motion = float(np.std(log.measured[first:]))
        if "stribeck" in model.lacking:
            parameters = replace(parameters, stribeck_velocity=model.slow)
        local = dict.fromkeys(["zero", "velocity", *(name for name, _ in model.owners)])
        asked = [*model.names, *local, *model.lacking]
        simulation = setting.simulation(log, first)
        with np.errstate(all="ignore"):
            whole, slopes = simulation.linearised(asked, parameters, setting.zero, setting.velocity)
            squares = [run.fit, float(whole @ whole), float(np.vdot(slopes, slopes))]
        if not (motion > 0 and np.isfinite(squares).all()):
            return None
        of = dict(zip(asked, slopes.T, strict=True))
        own = simulation.directions(parameters, setting.zero, setting.velocity)
        counts, middles, inputs = simulation.averages(setting.parameters)
        mine, n = {None, log.added_mass, log.name}, len(model.names)
        known = [*slopes[:, :n].T, *(of[name] * (whose in mine) for name, whose in model.owners)]
        rest = np.column_stack([whole, *known, *(of[name] for name in model.lacking)])
        _take_away(own, rest)
        split = 1 + len(known)
        return cls(
            run=run,
            step=simulation.step,
            counts=counts,
            middles=middles,
            inputs=inputs,
            counted=slice(first, None),
            motion=motion,
            whole=whole,
            own=own,
            errors=rest[:, 0],
            known=rest[:, 1:split],
            lacking=rest[:, split:],
            reach=np.linalg.norm(slopes[:, :n] @ model.root.T, axis=1),
        )

    @property
    def unit(self) -> float:
        """What makes squared errors add up to their mean over that of the motion."""
        return float(1 / (self.motion * self.errors.size**0.5))

    @cached_property
    def unsure(self) -> float:
        """What counts for nothing, in rad: a share of the motion about its straight line."""
        log = self.run.log
        time, angle = (
            each[self.counted] - each[self.counted].mean() for each in (log.time, log.measured)
        )
        time *= (time @ angle) / (time @ time)
        angle -= time
        return SHOWS * rms(angle)

    def drawn(self, left: Samples, random: np.random.Generator) -> tuple[SensorErrors, Samples]:
        """Return the log's sensor, and (m, k) draws of its errors if (m,) stay; none if white."""
        log = self.run.log
        time, measured = log.time[self.counted], log.measured[self.counted]
        angle = self.run.simulated[self.counted] - np.interp(time, self.middles, self.whole - left)
        sensor = SensorErrors.of(measured, angle)
        if sensor.white:
            return sensor, np.empty((self.whole.size, 0))
        drawn = sensor.draw(angle, self.unsure * random.standard_normal(DRAWS), self.counts, random)
        _take_away(self.own, drawn)
        return sensor, drawn


def directions_of(logs: Sequence[LinearisedRun]) -> Samples:
    """(n, d) changes of the model's values that move all logs' errors by 1, each its own way."""
    normal = np.sum([each.unit**2 * each.known.T @ each.known for each in logs], axis=0)
    scaled, size = unit_diagonal(normal)
    powers, axes = np.linalg.eigh(scaled)
    told = powers > ROUNDING * powers.max(initial=0.0)
    return np.asarray(axes[:, told] / np.sqrt(powers[told]) / size[:, None])


def reduce(logs: Sequence[LinearisedRun], directions: Samples, errors: Sequence[Samples]) -> None:
    """Take from each log's (m, k) errors, if any, what a joint change of values explains."""
    pairs = [(each, own) for each, own in zip(logs, errors, strict=True) if own.size]
    pulls = [each.unit**2 * each.known.T @ own for each, own in pairs]
    change = directions @ (directions.T @ sum(pulls)) if pulls else np.empty(0)
    for each, own in pairs:
        for k in range(own.shape[1]):
            own[:, k] -= each.known @ change[:, k]


def rms(values: Samples) -> float:
    """Return the root mean square of values; 0 of none."""
    flat = values.ravel(order="K")
    return float(np.sqrt(flat @ flat / flat.size)) if flat.size else 0.0


def _take_away(directions: Sequence[Samples], errors: Samples) -> None:
    """Take from (m, k) errors the orthonormal directions of stretches, one after the other."""
    ends = np.cumsum([each.shape[0] for each in directions])[:-1]
    for each, part in zip(directions, np.split(errors, ends), strict=True):
        take_away(each, part)
