"""One log as a page simulates it: on a uniform grid, rounded and packed."""

from __future__ import annotations

import gzip
import math
from base64 import b64encode
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.identification.free_run import Setting, fit_of
from butterfly.identification.simulation import Simulation
from butterfly.model.parameters import LumpedParameters
from butterfly.signals import hold, polynomials
from butterfly.twin.c import added_numbers, held_motion

LONGEST = 0.01
"""Longest step of a grid in s; it is finer for a log that is simulated in finer steps."""

_MOST = 20_000  # samples of a log
_LEVELS = 20_000  # to which a column is rounded
_SPARE, _MOST_SPARE = 4, 100  # steps before and after a log, for a delay that moves
_PERIODS, _SECONDS = 5, 10.0  # shown first, of a sine and of any other log
_ROUNDING = 1e-9  # of a step


class Column(NamedTuple):
    """Numbers in levels: begin + level * quantum."""

    begin: float
    quantum: float
    levels: NDArray[np.int64]  # (n,)

    @classmethod
    def of(cls, values: Samples) -> Column:
        """Round (n,) numbers."""
        quantum = float(np.ptp(values)) / _LEVELS or 1.0
        levels = np.rint((values - values[0]) / quantum).astype(np.int64)
        return cls(float(values[0]), quantum, levels)

    @property
    def values(self) -> Samples:
        """(n,) numbers."""
        return np.asarray(self.begin + self.levels * self.quantum)

    @property
    def packed(self) -> dict[str, Any]:
        """For the page: differences of the order that packs best, in three planes of bytes."""
        differences, tried = self.levels, []
        for order in (1, 2, 3):
            differences = np.diff(differences, prepend=0)
            # d is 2 d there, and -2 d - 1 if it is negative
            folded = np.where(differences < 0, -2 * differences - 1, 2 * differences)
            planes = b"".join((folded >> k & 255).astype(np.uint8).tobytes() for k in (0, 8, 16))
            tried.append((b64encode(gzip.compress(planes, 9, mtime=0)).decode("ascii"), order))
        data, order = min(tried, key=lambda trial: len(trial[0]))
        return {"begin": self.begin, "quantum": self.quantum, "order": order, "data": data}


@dataclass(frozen=True, kw_only=True, eq=False)
class LiveLog:
    """One log on its grid, and what it is simulated with."""

    simulation: Simulation
    setting: Setting
    raw: float
    """FIT in per cent of the free run."""
    step: float
    """Of the grid in s."""
    commands: Column
    """Means over steps, late by the estimated delay, some before and after the log."""
    spare: int
    """Number of those."""
    measured: Column
    """(n,) at the ends of steps."""

    @classmethod
    def of(cls, simulation: Simulation, setting: Setting, raw: float, reach: float) -> LiveLog:
        """Put a log on a grid; its delay can move by a ``reach`` in s either way."""
        log = simulation.log
        span = float(log.time[-1] - log.time[0])
        step = max(min(LONGEST, simulation.step), span / _MOST)
        count = max(int(span / step + _ROUNDING), 1) + 1
        spare = min(math.ceil(reach / step), _MOST_SPARE) + _SPARE
        edges = log.time[0] + step * np.arange(-spare, count + spare)
        means = hold.mean(*log.command, edges - setting.parameters.delay, log.between_samples)
        instants = log.time[0] + step * np.arange(count)
        return cls(
            simulation=simulation,
            setting=setting,
            raw=raw,
            step=step,
            commands=Column.of(means),
            spare=spare,
            measured=Column.of(np.interp(instants, log.time, log.measured)),
        )

    @property
    def label(self) -> str:
        """Its name on the page."""
        return self.simulation.log.label

    @cached_property
    def packed(self) -> dict[str, Any]:
        """Its columns for the page."""
        return {"commands": self.commands.packed, "measured": self.measured.packed}

    @property
    def size(self) -> int:
        """Characters that it needs."""
        return sum(len(column["data"]) for column in self.packed.values())

    @cached_property
    def starts(self) -> tuple[tuple[int, float, float], ...]:
        """Numbers of samples, and angle and velocity from which the free run goes on there."""
        log, setting = self.simulation.log, self.setting
        motion = self.simulation.run(setting.parameters, setting.zero, setting.velocity)
        starts = []
        for grid, angle, velocity in motion.pieces:
            number = math.ceil((grid[0] - log.time[0]) / self.step - _ROUNDING)
            at = np.array([log.time[0] + number * self.step])
            x, v = (polynomials.interpolate(grid, angle, velocity, at, k) for k in (False, True))
            starts.append((number, float(x[0]) - setting.zero, float(v[0])))
        return tuple(start for start in starts if start[0] < self.measured.levels.size - 1)

    def simulated(self, moved: LumpedParameters) -> Samples:
        """(n,) what is measured at the ends of steps, with parameters of the bare joint."""
        log, setting = self.simulation.log, self.setting
        late = (moved.delay - setting.parameters.delay) / self.step
        whole = math.floor(late + _ROUNDING)
        loaded = replace(moved, delay=(late - whole) * self.step).with_added_mass(log.added_mass)
        delivered = np.asarray(moved.drive.delivered(self.commands.values))
        result = np.empty(self.measured.levels.size)
        ends = [*(number for number, *_ in self.starts[1:]), result.size]
        for (begin, x, v), end in zip(self.starts, ends, strict=True):
            steps = np.arange(begin - 2, end - 1) + self.spare - whole
            commands = delivered[np.clip(steps, 0, delivered.size - 1)]
            motion = held_motion(loaded, commands[:2], commands[2:], (x, v), self.step)
            result[begin:end] = motion[log.integrated]
        return result if log.integrated else result + setting.zero

    def fit(self, moved: LumpedParameters) -> float:
        """FIT in per cent on the grid, with parameters of the bare joint."""
        measured = self.measured.values
        with np.errstate(over="ignore", invalid="ignore"):
            error = self.simulated(moved) - measured
            return fit_of(float(np.sqrt(np.mean(error**2))), float(np.std(measured)))

    def document(self) -> dict[str, Any]:
        """Return it for the page."""
        log, setting = self.simulation.log, self.setting
        sine = log.excitation
        span = self.step * (self.measured.levels.size - 1)
        return self.packed | {
            "label": self.label,
            "step": self.step,
            "spare": self.spare,
            "shown": min(2 * math.pi * _PERIODS / sine.omega if sine else _SECONDS, span),
            "periods": _PERIODS if sine else 0,
            "starts": self.starts,
            "zero": 0.0 if log.integrated else setting.zero,
            "integrated": log.integrated,
            "unit": log.unit,
            "parameters": asdict(setting.parameters),
            "added": added_numbers(log.added_mass),
            "raw": self.raw,
        }
