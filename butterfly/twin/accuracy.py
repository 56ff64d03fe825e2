"""How far a twin moves as our own simulation does, with the inputs of its own logs.

A simulator takes one command for each of its steps: here the mean of what the log's input, as the
drive delivers it, was during that step. Our own simulation has the input as it was recorded.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.free_run import Setting
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import Intersample, Log
from butterfly.model.linear import LinearJoint, resonance_frequency
from butterfly.progress import in_threads, out_of_time, untracked
from butterfly.signals import hold
from butterfly.twin.twin import Accuracy, Twin

_MINUTE = 60.0  # s
_SWING = 0.15  # rad, of each of the sines that stand for logs where there are none
_TONES = (0.7, 1.3)  # their frequencies, over that of the resonance,
_PACE = 3.0  # or in its place, in rad/s, where there is none
_SOME = 3  # logs by which the form of a twin is chosen,
_TRIED = 20.0  # and how much of each, in s
_FINE = 1e-3  # s, longest step of our own simulation here: what is left of it is 1e-6 rad
_EARLIER = 2  # steps more than the delay before a log, whose commands are told


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A log cut in steps: (n,) commands, the start, and (n + 1,) angles of our own simulation."""

    name: str
    twin: Twin
    past: Samples  # commands of some earlier steps, which a delay lets act later
    commands: Samples
    angle: float
    velocity: float
    simulated: Samples

    @classmethod
    def of(cls, twin: Twin, log: Log, setting: Setting, step: float) -> Case:
        """Simulate a log as the twin that carries its added mass, and cut its input in steps."""
        log = log.opened
        carrying = replace(twin, added=log.added_mass)
        p = carrying.parameters
        simulation = Simulation(log, p, longest=_FINE)
        angle, velocity = simulation.given_start(setting.velocity)
        motion = simulation.run(p, setting.zero, setting.velocity)
        length = min(log.time[-1] - log.time[0], setting.horizon)
        instants = log.time[0] + step * np.arange(max(int(length / step + 1e-9), 1) + 1)
        earlier = math.ceil(max(p.delay, 0.0) / step) + _EARLIER
        edges = np.concatenate([instants[0] - step * np.arange(earlier, 0, -1), instants])
        stamps, commands = log.command
        means = hold.mean(stamps, p.drive.delivered(commands), edges, log.between_samples)
        return cls(
            name=log.name,
            twin=carrying,
            past=means[:earlier],
            commands=means[earlier:],
            angle=angle - setting.zero,
            velocity=velocity,
            simulated=motion.at(instants) - setting.zero,
        )

    def error(self, move: Mover, most: int | None = None) -> float:
        """Return the largest difference of a motion over so many steps."""
        moved = move(replace(self, commands=self.commands[:most]))
        with np.errstate(invalid="ignore"):
            error = float(np.abs(moved - self.simulated[: moved.size]).max())
        return error if np.isfinite(error) else np.inf


Mover: TypeAlias = Callable[[Case], Samples]
"""Moves a case's twin by its commands: (n + 1,) angles."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Yardstick:
    """Our own simulations of a twin's logs at a step in s, to compare its motion with."""

    cases: Sequence[Case]
    step: float
    besides: int

    @classmethod
    def of(cls, twin: Twin, step: float) -> Yardstick:
        """Simulate a twin's logs; where there are none, a minute of two sines."""
        recorded = twin.recorded() or [_minute(twin)]
        cases: list[Case] = []
        for log, setting in recorded:
            if cases and out_of_time("the comparison with some logs"):
                break
            cases.append(Case.of(twin, log, setting, step))
        return cls(cases=cases, step=step, besides=len(recorded) - len(cases))

    def worst_of_some(self, move: Mover) -> float:
        """Return the largest error over some of the logs."""
        numbers = np.linspace(0, len(self.cases) - 1, min(_SOME, len(self.cases)))
        some = [self.cases[int(number)] for number in numbers]
        most = int(_TRIED / self.step)
        return max(in_threads(partial(Case.error, move=move, most=most), some, untracked, ""))

    def accuracy(self, move: Mover) -> Accuracy:
        """Return the errors of all logs."""
        errors = in_threads(partial(Case.error, move=move), self.cases, untracked, "")
        names = [case.name or f"log {k}" for k, case in enumerate(self.cases, 1)]
        named, unit = dict(zip(names, errors, strict=True)), self.cases[0].twin.joint.way
        return Accuracy(errors=named, unit=unit, besides=self.besides)


def _minute(twin: Twin) -> tuple[Log, Setting]:
    """Return a minute of two sines that move the joint; of one without a drive, a free decay."""
    time = 1e-3 * np.arange(int(1e3 * _MINUTE) + 1, dtype=np.float64)
    loaded = twin.loaded
    pace = resonance_frequency(loaded) or _PACE
    inputs, start = np.zeros(time.size), 0.0 if loaded.p4 else _SWING
    for tone in _TONES if loaded.p4 else ():
        omega = tone * pace
        gain = abs(complex(LinearJoint.of(loaded).response(omega)))
        inputs += (_SWING / gain + loaded.holding / loaded.p4) * np.sin(omega * time)
    log = Log(
        time,
        input=inputs,
        angle=np.full(time.size, start),
        added_mass=twin.added,
        intersample=Intersample.FIRST_ORDER_HOLD,
        name="a minute of two sines",
    )
    return log, Setting(parameters=twin.parameters, zero=0.0, velocity=0.0)
