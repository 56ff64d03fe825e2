"""Drive the MuJoCo robot with a sine and record it as a log."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from butterfly.errors import InputError
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, VoltageDrive
from butterfly.plant.mjcf import Robot, compile_model, mount

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.plant.sensors import Clock, Encoder

LONGEST_STEP = 1e-3
"""Longest MuJoCo step in s: RK4's error is then 1.5e-11 rad over 70 s of small swings."""


class MujocoPlant:
    """The robot in MuJoCo.

    Parameters
    ----------
    robot
        Its parameters.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._model = compile_model(robot)
        self._data = mujoco.MjData(self._model)

    def run(
        self,
        excitation: Sine,
        *,
        duration: float,
        clock: Clock,
        encoder: Encoder,
        rng: np.random.Generator,
        added_mass: AddedMass = NO_ADDED_MASS,
    ) -> Log:
        """Start at rest, hanging down, and apply a sine through a zero-order hold.

        Parameters
        ----------
        excitation
            The sine; sampled at the clock's stamps.
        duration
            In s.
        clock, encoder
            Of the controller.
        rng
            Source of everything random.
        added_mass
            What the hand carries.

        Raises
        ------
        InputError
            If ``duration`` is not positive, or the simulation diverges.
        """
        if not (math.isfinite(duration) and duration > 0):
            raise InputError("experiment", "duration", duration, "a finite positive number of s")
        mount(self._model, added_mass)
        time = clock.stamps(duration, rng)
        inputs = excitation.amplitude * np.sin(excitation.omega * time)
        angle, velocity = self._simulate(time, inputs)
        if not np.isfinite(angle).all():
            raise InputError("experiment", "plant", "a simulation that diverged", "smaller inputs")
        drive = self.robot.drive
        return Log(
            time=time,
            input=inputs,
            angle=encoder.read(angle, rng),
            velocity=velocity,
            input_kind=InputKind.VOLTAGE if isinstance(drive, VoltageDrive) else InputKind.TORQUE,
            intersample=Intersample.ZERO_ORDER_HOLD,
            added_mass=added_mass,
            excitation=excitation,
            source="MuJoCo",
        )

    def _simulate(
        self, time: NDArray[np.float64], inputs: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Angle and velocity at each stamp, the input held from each stamp to the next."""
        model, data = self._model, self._data
        mujoco.mj_resetData(model, data)
        angle, velocity = np.zeros_like(time), np.zeros_like(time)
        intervals = np.diff(time)
        substeps = np.ceil(intervals / LONGEST_STEP * (1 - 1e-9)).astype(int)
        steps = (intervals / substeps).tolist()
        for k, (command, step, count) in enumerate(
            zip(inputs.tolist(), steps, substeps.tolist(), strict=False), start=1
        ):
            data.ctrl[0] = command
            model.opt.timestep = step
            mujoco.mj_step(model, data, nstep=count)
            angle[k], velocity[k] = data.qpos[0], data.qvel[0]
        return angle, velocity
