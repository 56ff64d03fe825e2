"""Hold an orbit, notice that the robot changes, and retune to what it has become."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from butterfly.logs.log import Log
from butterfly.model.energy import Orbit
from butterfly.orbit.change_detection import ChangeDetector
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Watched:
    """A run that was watched."""

    log: Log
    orbit: Orbit  # that was to be held at first
    detector: ChangeDetector  # with what it noticed
    change: RobotChange | None  # what was to be noticed


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
    every, width = plan.false_alarms_every, options.half_width
    detector = ChangeDetector(false_alarms_every=every, half_width=width)
    tuned = SelfTuning(
        law,
        OnlineRecalibration(zero, memory=plan.memory, options=options, detector=detector),
        target,
        multiplier=multiplier,
        inertia=orbit.parameters.p1,
        every=plan.every,
        commands=Dithered(law, plan.dither, 2 * math.pi / orbit.period, rng),
        path=path,
    )
    return Watched(log=run(tuned), orbit=orbit, detector=detector, change=plan.change)
