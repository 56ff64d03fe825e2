"""Hold an orbit, notice that the robot changes, and retune to what it has become."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from butterfly.errors import require_number
from butterfly.logs.log import Log
from butterfly.model.energy import Orbit
from butterfly.orbit.change_detection import Alarm, ChangeDetector
from butterfly.orbit.controller import Dithered, EnergyShaping, Target
from butterfly.orbit.online import OnlineRecalibration, SelfTuning
from butterfly.orbit.recalibration import RecalibrationOptions
from butterfly.plant.motor import CommandPath, ControlLaw
from butterfly.plant.robot import RobotChange


@dataclass(frozen=True, kw_only=True)
class WatchPlan:
    """How a self-tuning loop is watched; the dither tells p2, p4 and friction apart."""

    duration: float  # in s
    dither: float = 0.3  # share of the control's rms
    memory: float = 20.0  # of the estimates, in s
    every: float = 1.0  # s between retunings
    false_alarms_every: float = 3600.0  # s
    change: RobotChange | None = None  # of a simulated robot, to be noticed

    def __post_init__(self) -> None:
        require_number("watch", dither=self.dither)
        require_number(
            "watch", positive=True, duration=self.duration, memory=self.memory, every=self.every
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Watched:
    """A run that was watched, and what was noticed."""

    log: Log
    orbit: Orbit  # that was to be held at first
    alarms: tuple[Alarm, ...]
    history: tuple[tuple[float, float], ...]  # instants in s and statistics
    threshold: float
    change: RobotChange | None  # what is to be noticed

    def delay(self, alarm: Alarm) -> float:
        """Periods from the robot's change to an alarm; NaN if it did not change before."""
        late = math.nan if self.change is None else alarm.time - self.change.at
        return late / self.orbit.period if late >= 0 else math.nan


def watch(
    run: Callable[[ControlLaw], Log],
    law: EnergyShaping,
    target: Target,
    orbit: Orbit,
    plan: WatchPlan,
    *,
    zero: float,
    multiplier: float,
    options: RecalibrationOptions,
    path: CommandPath = CommandPath(),
    rng: np.random.Generator,
) -> Watched:
    """Run a law about its ``orbit``, self-tuning and dithered, and watch its innovations."""
    detector = ChangeDetector(
        false_alarms_every=plan.false_alarms_every, half_width=options.half_width
    )
    online = OnlineRecalibration(zero, memory=plan.memory, options=options, detector=detector)
    tuned = SelfTuning(
        law,
        online,
        target,
        multiplier=multiplier,
        inertia=orbit.parameters.p1,
        every=plan.every,
        commands=Dithered(law, plan.dither, 2 * math.pi / orbit.period, rng),
        path=path,
    )
    log = run(tuned)
    return Watched(
        log=log,
        orbit=orbit,
        alarms=tuple(detector.alarms),
        history=tuple(detector.history),
        threshold=detector.threshold,
        change=plan.change,
    )
