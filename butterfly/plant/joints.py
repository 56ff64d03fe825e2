"""The two simulated joints: in MuJoCo, and by the grey-box equation."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from enum import StrEnum
from typing import TYPE_CHECKING

import mujoco

from butterfly.errors import InputError
from butterfly.logs.log import InputKind
from butterfly.model.greybox import Constants, least_steps, step
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, Drive, VoltageDrive
from butterfly.plant.mjcf import compile_model, mount

if TYPE_CHECKING:
    from butterfly.plant.mjcf import Robot

LONGEST_STEP = 1e-3
"""Longest step in s: RK4's error is then 1.5e-11 rad over 70 s of small swings."""


def kind_of(drive: Drive) -> InputKind:
    """Tell what a drive's command means."""
    return InputKind.VOLTAGE if isinstance(drive, VoltageDrive) else InputKind.TORQUE


class _DrivenJoint(ABC):
    """What both simulated joints have in common.

    Parameters
    ----------
    robot, added
        The robot and what it carries.
    angle
        In rad, at which it starts, at rest.
    """

    def __init__(
        self, robot: Robot, added: AddedMass = NO_ADDED_MASS, *, angle: float = 0.0
    ) -> None:
        self._drive = robot.drive
        self._loaded = robot.lumped.with_added_mass(added)
        self._constants = Constants.of(self._loaded)
        self._initial = angle

    @property
    def input_kind(self) -> InputKind:
        """What the command means."""
        return kind_of(self._drive)

    def current(self, command: float) -> float:
        """Armature current in A (4) under ``command``; NaN for a torque drive, which hides it."""
        if not isinstance(self._drive, VoltageDrive):
            return math.nan
        back_emf = self._drive.back_emf_constant * self.velocity
        return (command - back_emf) / self._drive.resistance

    @property
    @abstractmethod
    def velocity(self) -> float:
        """True velocity in rad/s."""


class MujocoJoint(_DrivenJoint):
    """The robot in MuJoCo."""

    def __init__(
        self, robot: Robot, added: AddedMass = NO_ADDED_MASS, *, angle: float = 0.0
    ) -> None:
        super().__init__(robot, added, angle=angle)
        self._model = compile_model(robot)
        mount(self._model, robot, added)
        self._data = mujoco.MjData(self._model)
        self._options = self._model.opt
        self._has_current = robot.drive.time_constant > 0
        self._is_stiff = self._has_current or self._loaded.bristle_stiffness > 0
        self._sticks_harder = self._loaded.sticks_harder

    @property
    def angle(self) -> float:
        """True angle in rad."""
        return float(self._data.qpos[0])

    @property
    def velocity(self) -> float:
        """True velocity in rad/s."""
        return float(self._data.qvel[0])

    def reset(self) -> None:
        """Go back to rest."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[0] = self._initial

    def advance(self, command: float, duration: float) -> None:
        """Step MuJoCo through ``duration`` s in equal steps that lag and bristles allow."""
        count = steps_of(duration)
        if self._is_stiff:
            count = max(count, least_steps(self._constants, self.velocity, duration))
        self._data.ctrl[0] = command
        self._options.timestep = duration / count
        if not self._has_current:
            self._step(count)
            return
        # The callback is process-wide, and must not be there while another model is compiled.
        mujoco.set_mjcb_act_dyn(_current_rate)
        try:
            self._step(count)
        finally:
            mujoco.set_mjcb_act_dyn(None)

    def _step(self, count: int) -> None:
        """Take equal steps; friction that weakens is set anew for the middle of each."""
        if not self._sticks_harder:
            mujoco.mj_step(self._model, self._data, nstep=count)
            return
        for _ in range(count):
            halfway = 0.5 * self._options.timestep * self._data.qacc[0]
            self._model.dof_frictionloss[0] = self._loaded.level(self._data.qvel[0] + halfway)
            mujoco.mj_step(self._model, self._data)

    def current(self, command: float) -> float:
        """Armature current in A (4); a state of the simulation if there is an inductance."""
        return float(self._data.act[0]) if self._has_current else super().current(command)


class GreyBoxJoint(_DrivenJoint):
    """The same robot by the grey-box equation, with set-valued friction.

    Raises
    ------
    InputError
        If the robot has a clutch with play, which the equation has not.
    """

    def __init__(
        self, robot: Robot, added: AddedMass = NO_ADDED_MASS, *, angle: float = 0.0
    ) -> None:
        super().__init__(robot, added, angle=angle)
        if robot.clutch:
            raise InputError("GreyBoxJoint", "clutch", robot.clutch, "none: MuJoCo alone has play")
        self.reset()

    @property
    def angle(self) -> float:
        """True angle in rad."""
        return self._state[0]

    @property
    def velocity(self) -> float:
        """True velocity in rad/s."""
        return self._state[1]

    def reset(self) -> None:
        """Go back to rest."""
        self._state = (self._initial, 0.0, 0.0, 0.0)

    def advance(self, command: float, duration: float) -> None:
        """Integrate through ``duration`` s in equal steps of at most `LONGEST_STEP`."""
        count = steps_of(duration)
        torque = self._loaded.p4 * command
        for _ in range(count):
            self._state = step(self._constants, self._state, torque, duration / count)

    def current(self, command: float) -> float:
        """Armature current in A (4); a state of the simulation if there is an inductance."""
        drive = self._drive
        if isinstance(drive, VoltageDrive) and drive.time_constant > 0:
            return self._state[2] / drive.torque_constant
        return super().current(command)


class Simulator(StrEnum):
    """What simulates the joint."""

    MUJOCO = "mujoco"
    GREY_BOX = "grey-box"

    def joint(self, robot: Robot, added: AddedMass, angle: float) -> MujocoJoint | GreyBoxJoint:
        """Return the joint of a robot that carries a mass and starts at an angle in rad."""
        kind = MujocoJoint if self is Simulator.MUJOCO else GreyBoxJoint
        return kind(robot, added, angle=angle)


def _current_rate(model: mujoco.MjModel, data: mujoco.MjData, index: int) -> float:
    """Return di/dt = (v - R i - k_emf thd)/L (4)."""
    resistance, back_emf_constant, inductance = model.actuator_dynprm[index, :3].tolist()
    voltage, velocity, current = data.ctrl[index], data.actuator_velocity[index], data.act[index]
    return float((voltage - resistance * current - back_emf_constant * velocity) / inductance)


def steps_of(duration: float) -> int:
    """Count the equal steps of at most `LONGEST_STEP` that make up ``duration`` s."""
    return max(math.ceil(duration / LONGEST_STEP * (1 - 1e-9)), 1)
