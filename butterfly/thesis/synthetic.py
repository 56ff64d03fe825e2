"""The synthetic robot of the thesis, simulated as its Simulink model was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.model.greybox import simulate
from butterfly.model.parameters import AddedMass
from butterfly.plant.rig import Rig

_START = 0.01  # rad, at which the Simulink model starts


@dataclass(frozen=True, kw_only=True)
class Synthetic:
    """What Tables 1 and 2 and Figures 3 to 8 rest on."""

    rig: Rig  # The robot, its clock and its encoder
    # added_masses, sines: Every sine is tried with every added mass
    added_masses: Sequence[AddedMass]
    sines: Sequence[Sine]
    duration: float  # Of a run in s


def synthetic_log(synthetic: Synthetic, added: AddedMass, sine: Sine, *, noise: bool) -> Log:
    """Simulate one response of the thesis's synthetic robot to a continuous sine."""
    clock = synthetic.rig.clock
    step = clock.step
    time = step * np.arange(clock.count(synthetic.duration) + 1, dtype=np.float64)
    instants = np.column_stack([time[:-1], time[:-1] + step / 2, time[1:]])
    loaded = synthetic.rig.robot.lumped.with_added_mass(added)
    angle, _ = simulate(loaded, time, sine.sample(instants), _START)
    source = synthetic.rig.encoder.band_limited
    if noise and source is not None:
        angle = angle + source.sample(time)
    return Log(
        time=time,
        input=sine.sample(time),
        angle=angle,
        input_kind=InputKind.TORQUE,
        intersample=Intersample.FIRST_ORDER_HOLD,
        added_mass=added,
        excitation=sine,
        source="synthetic",
    )
