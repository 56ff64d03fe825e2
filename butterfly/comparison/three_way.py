"""MuJoCo, the grey-box model and the logged robot under the same input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FreeRun
from butterfly.identification.simulation import SimulatedMotion, Simulation
from butterfly.identification.test_functions import ResidualTorque
from butterfly.logs.log import Log
from butterfly.model.parameters import LumpedParameters
from butterfly.plant.joints import MujocoJoint
from butterfly.plant.robot import Robot
from butterfly.plant.rollout import replay_input, replay_loop
from butterfly.progress import Track, untracked
from butterfly.signals.frequency_response import response_point


@dataclass(frozen=True, kw_only=True, eq=False)
class ThreeWay:
    """One log, and both simulations of its input."""

    log: Log
    zero: float  # encoder reading in rad where the models' angle is 0
    parameters: LumpedParameters  # that both simulators had, of the bare hand
    mujoco: Samples  # (n,) angles in rad, from the encoder's zero
    greybox: Samples
    residual: ResidualTorque  # that no term of the model explains
    gains: dict[str, complex]  # for a sine, by simulator: its response over the log's

    @property
    def fits(self) -> dict[str, float]:
        """FIT in per cent of each simulator against the log."""
        runs = {"MuJoCo": self.mujoco, "grey box": self.greybox}
        return {name: FreeRun(log=self.log, simulated=run).fit for name, run in runs.items()}

    @property
    def difference(self) -> float:
        """Largest difference in rad between the simulators."""
        return float(np.abs(self.mujoco - self.greybox).max())


def compare_three(
    data: DataSet,
    estimate: Estimate,
    numbers: Sequence[int],
    *,
    mass: float | None = None,
    track: Track = untracked,
) -> list[ThreeWay]:
    """Simulate logs by number in MuJoCo, with a body of a mass in kg, and by the grey box."""
    data.require_angles("MuJoCo")
    predictor = data.simulations
    comparisons = []
    for number in track(numbers, "Simulating twice"):
        log = data.logs[number]
        setting = predictor.setting(number, estimate)
        parameters, zero = setting.parameters, setting.zero
        # of a joint that nothing drives any gain will do
        driven = replace(parameters, p4=parameters.p4 or 1.0)
        robot, added = Robot.of_loaded(driven, log.added_mass, mass)
        simulation = Simulation(log, parameters)
        angle, velocity = simulation.given_start(setting.velocity)
        joint = MujocoJoint(robot, added, angle=angle - zero, velocity=velocity)
        loop, grid = simulation.segments.loop(driven, zero), simulation.segments.grid
        if loop is None:
            slow = parameters.slow_delay, parameters.slow_interval
            mujoco = zero + replay_input(joint, log, parameters.delay, parameters.drive, slow)
        else:
            states = replay_loop(joint, log, grid, loop)
            mujoco = zero + SimulatedMotion(((grid, *states),)).at(log.time)
        greybox = predictor.run(number, estimate).simulated
        comparisons.append(
            ThreeWay(
                log=log,
                zero=zero,
                parameters=parameters,
                mujoco=mujoco,
                greybox=greybox,
                residual=ResidualTorque.of(log, parameters, zero),
                gains=_gains(log, {"MuJoCo": mujoco, "grey box": greybox}),
            )
        )
    return comparisons


def _gains(log: Log, simulated: dict[str, Samples]) -> dict[str, complex]:
    if log.excitation is None:
        return {}
    measured = response_point(log).gain
    return {
        name: complex(response_point(replace(log, angle=angle)).gain / measured)
        for name, angle in simulated.items()
    }
