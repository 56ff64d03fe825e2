"""One division of logs into blocks of time, and the conditions of each.

Errors are correlated within a log, so that logs count as independent, or where there are few of
them blocks. A parameter may follow a condition, though it should be constant.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.identification.levels import CLEARLY, FEW
from butterfly.logs.log import MIN_SAMPLES, Log, slow_interval
from butterfly.model.parameters import AddedMass
from butterfly.signals.spectrum import white_variance

CELLS = 10
"""Blocks into which a log is cut: enough to estimate their scatter within a quarter."""


def cells_of(logs: int, parameters: int) -> int:
    """Return the number of cells of each log: all cells are twice the parameters at least."""
    return max(CELLS, -(-2 * parameters // logs))


def independent_cells_of(logs: int, parameters: int) -> int:
    """Return the number of cells of each log whose errors count as independent: 1 of many logs."""
    return cells_of(logs, parameters) if logs <= FEW else 1


def cut(
    jacobian: Samples, residuals: Samples, cluster: NDArray[np.intp], cells: int
) -> Iterable[tuple[Samples, Samples]]:
    """Yield the (m, n) and (m,) equations of each cell, one cluster after the other."""
    order = np.argsort(cluster, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(cluster[order])) + 1):
        for part in np.array_split(rows, cells):
            yield jacobian[part], residuals[part]


def edges_of(time: Samples, count: int) -> list[int]:
    """Return the samples at which blocks of a log begin; fewer than ``count`` if too short."""
    if time.size < MIN_SAMPLES:
        return []
    edges = [0]
    for k in np.searchsorted(time, np.linspace(time[0], time[-1], count + 1)[1:-1]).tolist():
        if min(k - edges[-1], time.size - k) >= MIN_SAMPLES:
            edges.append(k)
    return edges


def length_of(log: Log) -> float:
    """Return the length in s of the blocks of a log: whole periods of its drive."""
    length = float(log.time[-1] - log.time[0]) / CELLS
    if log.excitation is None:
        return length
    period = 2 * math.pi / log.excitation.omega
    return math.ceil(length / period) * period


class Condition(StrEnum):
    """A condition that a parameter may follow."""

    MASS = "added mass"
    COMMAND = "command"
    SWING = "swing"
    FREQUENCY = "frequency"
    SPEED = "speed"
    TIME = "time"
    DIRECTION = "direction"
    REGIME = "regime"
    WEIGHED = "weighed"
    LOG = "log"
    ALL = "all"


@dataclass(frozen=True, kw_only=True, eq=False)
class Conditions:
    """Conditions of k cells, and added masses of their logs."""

    # by condition: (k,) inertia of the added mass in kg m^2, 1/rms input, mean squared swing in
    # rad^2, omega^2 in rad^2/s^2 (the others' mean in logs without a full period), 1/speed, time
    # since the start in s, sign of the input, share in which the clock is slow
    values: Mapping[Condition, Samples]
    masses: tuple[AddedMass, ...]  # of the n logs

    @classmethod
    def of(cls, logs: Sequence[Log], cells: int) -> Conditions:
        """Compute them from logs, each cut into some cells."""
        angles = (part for log in logs for part in np.array_split(log.angle, cells))
        times = (part - log.time[0] for log in logs for part in np.array_split(log.time, cells))
        of_logs = [_of_log(log) for log in logs]
        values = {
            **{n: np.repeat([each[n] for each in of_logs], cells) for n in of_logs[0]},
            Condition.SWING: np.array([np.var(part) for part in angles]),
            Condition.TIME: np.array([part.mean() for part in times]),
        }
        if limit := slow_interval(logs):
            slow = (log.is_slow(limit)[-log.time.size :] for log in logs)
            parts = (part.mean() for each in slow for part in np.array_split(each, cells))
            values[Condition.REGIME] = np.fromiter(parts, np.float64)
        if cells == 1:
            del values[Condition.TIME]
        whole = ~np.isnan(squares := values[Condition.FREQUENCY])
        if whole.any():
            squares[~whole] = squares[whole].mean()
        else:
            del values[Condition.FREQUENCY]
        # of fewer logs of either sign, differences are not significant
        signs = values[Condition.DIRECTION][::cells]
        if min(np.sum(signs > 0), np.sum(signs < 0)) < 2 * FEW:
            del values[Condition.DIRECTION]
        return cls(values=values, masses=tuple(log.added_mass for log in logs))


def pace_of(log: Log) -> float:
    """Return the angular frequency in rad/s at which a log moves: of its drive, or rms."""
    if log.excitation is not None:
        return log.excitation.omega
    return log.rms_speed / (log.rms_motion or np.inf)


def _repeats(log: Log) -> bool:
    """Whether a log holds a full period: its angle is on one side, the other, the first again.

    Each time by half the amplitude of a sine as large, and what noise adds to it.
    """
    if log.excitation is not None:
        return True
    off = log.angle - log.angle.mean()
    noise = math.sqrt(white_variance(log.angle))
    sides = np.sign(off[abs(off) > log.rms_motion / math.sqrt(2) + CLEARLY * noise])
    return bool(np.count_nonzero(np.diff(sides)) > 1)


def _of_log(log: Log) -> dict[Condition, float]:
    """Return conditions that are constant in a log: 0 without input, motion or one direction.

    A log without a full period has no frequency: NaN.
    """
    size, mean = float(np.sqrt(np.mean(log.input**2))), float(np.mean(log.input))
    return {
        Condition.MASS: log.added_mass.inertia,
        Condition.COMMAND: 1 / size if size else 0.0,
        Condition.FREQUENCY: pace_of(log) ** 2 if _repeats(log) else np.nan,
        Condition.SPEED: log.lag_per_play,
        Condition.DIRECTION: float(np.sign(mean)) if abs(mean) > size / 2 else 0.0,
    }
