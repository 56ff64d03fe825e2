"""The two simulated joints: in MuJoCo, and by the grey-box equation."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from enum import StrEnum

import mujoco
import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError
from butterfly.logs.log import InputKind
from butterfly.model.greybox import step
from butterfly.model.kernel import Constants, least_steps
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, Drive, VoltageDrive
from butterfly.plant.armature import Armature
from butterfly.plant.held_commands import angles_under, steps_of
from butterfly.plant.mjcf import compile_model
from butterfly.plant.robot import Assistance, Robot


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

    Raises
    ------
    InputError
        If friction is negative (see `Robot.loaded`).
    """

    def __init__(
        self, robot: Robot, added: AddedMass = NO_ADDED_MASS, *, angle: float = 0.0
    ) -> None:
        self._drive = robot.drive
        self._loaded = robot.loaded(added)
        self._constants = Constants.of(self._loaded)
        self._initial = float(angle)

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
    """The robot in MuJoCo.

    Parameters
    ----------
    robot, added
        The robot and what it carries.
    angle
        In rad, at which it starts, at rest.
    scene
        Whether the model has looks, light and camera, for a viewer.
    """

    def __init__(
        self,
        robot: Robot,
        added: AddedMass = NO_ADDED_MASS,
        *,
        angle: float = 0.0,
        scene: bool = False,
    ) -> None:
        super().__init__(robot, added, angle=angle)
        self._model = compile_model(robot, added, scene=scene)
        self._data = mujoco.MjData(self._model)
        self._options = self._model.opt
        data = self._data  # looking a column up costs as much as reading it
        self._position, self._velocity, self._command = data.qpos, data.qvel, data.ctrl
        self._armature = None
        if isinstance(robot.drive, VoltageDrive) and Assistance.CURRENT in robot.assistance:
            self._armature = Armature(self._model, self._data, robot.drive)
        stiff = {Assistance.CURRENT, Assistance.BRISTLES}
        self._is_stiff = not robot.assistance.isdisjoint(stiff)
        self._sticks_harder = Assistance.STICKING in robot.assistance

    @property
    def model(self) -> mujoco.MjModel:
        """The model, for a viewer."""
        return self._model

    @property
    def data(self) -> mujoco.MjData:
        """The state, for a viewer."""
        return self._data

    @property
    def angle(self) -> float:
        """True angle in rad."""
        return float(self._position.item(0))

    @property
    def velocity(self) -> float:
        """True velocity in rad/s."""
        return float(self._velocity.item(0))

    def reset(self) -> None:
        """Go back to rest."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[0] = self._initial
        if self._armature is not None:
            self._armature.current = 0.0

    def advance(self, command: float, duration: float) -> None:
        """Step MuJoCo through ``duration`` s in equal steps that lag and bristles allow."""
        count = steps_of(duration)
        if self._is_stiff:
            count = max(count, least_steps(self._constants, self.velocity, duration))
        self._options.timestep = duration / count
        if not self._sticks_harder:
            self._step(command, count)
            return
        for _ in range(count):  # friction that weakens is set anew for the middle of each step
            halfway = 0.5 * self._options.timestep * self._data.qacc[0]
            self._model.dof_frictionloss[0] = self._loaded.level(self._data.qvel[0] + halfway)
            self._step(command, 1)

    def _step(self, command: float, count: int) -> None:
        if self._armature is not None:
            self._armature.advance(command, count)
            return
        self._command[0] = command
        mujoco.mj_step(self._model, self._data, count)

    def current(self, command: float) -> float:
        """Armature current in A (4); a state of the simulation if there is an inductance."""
        return super().current(command) if self._armature is None else self._armature.current


class GreyBoxJoint(_DrivenJoint):
    """The same robot by the grey-box equation, with set-valued friction (see `MujocoJoint`).

    Raises
    ------
    InputError
        If friction is negative (see `Robot.loaded`), or the robot has a clutch with play, which
        the equation has not.
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
        """Integrate through ``duration`` s in the equal steps of `steps_of`."""
        count = steps_of(duration)
        torque = self._loaded.p4 * command
        for _ in range(count):
            self._state = step(self._constants, self._state, torque, duration / count)

    def angles_under(
        self, stamps: NDArray[np.float64], commands: NDArray[np.float64], delay: float
    ) -> NDArray[np.float64]:
        """Return the (n,) angles of a whole run from here on; the joint itself stays as it is.

        Parameters
        ----------
        stamps, commands
            (n,) instants in s, and what is commanded at them.
        delay
            In s, from a command to its effect.
        """
        torques = self._loaded.p4 * commands
        return angles_under(self._constants, self._state, stamps, torques, delay)

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

    def joint(
        self, robot: Robot, added: AddedMass, angle: float, *, scene: bool = False
    ) -> MujocoJoint | GreyBoxJoint:
        """Return the joint of a robot that carries a mass and starts at an angle in rad.

        MuJoCo's has light and camera, for a viewer, if a ``scene`` is wanted.
        """
        if self is Simulator.MUJOCO:
            return MujocoJoint(robot, added, angle=angle, scene=scene)
        return GreyBoxJoint(robot, added, angle=angle)
