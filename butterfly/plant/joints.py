"""The two simulated joints: in MuJoCo, and with the grey-box equation."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import mujoco
import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.compiled import compiled
from butterfly.errors import InputError
from butterfly.model.greybox import constants_of
from butterfly.model.kernel.equation import MOST_STEPS, Constants, State, friction_at, least_steps
from butterfly.model.kernel.integrate import after_steps, count_steps
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, VoltageDrive
from butterfly.plant.mjcf import compile_model, hinge_of
from butterfly.plant.motor import LARGEST_ANGLE
from butterfly.plant.robot import Assistance, Robot

LONGEST_STEP = 1e-3
"""Longest step in s: RK4's error is then 1.5e-11 rad over 70 s of small swings."""

_FINER = 10  # steps for one of a fine joint
_WHOLE = 0  # mj_forwardSkip: no stage of the dynamics is skipped,
_NO_SENSORS = 1  # but sensors are


def steps_of(duration: float) -> int:
    """Return the number of equal steps of at most `LONGEST_STEP` in ``duration`` s."""
    if duration <= LONGEST_STEP:  # the usual cycle, in a loop that must be fast
        return 1
    return math.ceil(duration / LONGEST_STEP * (1 - 1e-9))


def counts_of(durations: Samples) -> NDArray[np.intp]:
    """Return the `steps_of` (n,) durations in s."""
    return np.ceil(durations / LONGEST_STEP * (1 - 1e-9)).astype(np.intp)


def held_between(stamps: Samples, commands: Samples, arrivals: Samples) -> tuple[Samples, Samples]:
    """Return (m + 1,) instants in s, timestamps and arrivals, and (m,) commands between them.

    Each of (n,) commands is held from its arrival in s to the next, with none before.
    """
    edges = np.union1d(stamps, arrivals[arrivals < stamps[-1]])
    latest = np.searchsorted(arrivals, edges[:-1], side="right")
    return edges, np.concatenate([[0.0], commands])[latest]


class Joint(ABC):
    """A simulated joint: a robot with an added mass, first at ``angle`` rad, usually at rest."""

    def __init__(
        self,
        robot: Robot,
        added: AddedMass = NO_ADDED_MASS,
        *,
        angle: float = 0.0,
        velocity: float = 0.0,
    ) -> None:
        drive = self._drive = robot.drive if isinstance(robot.drive, VoltageDrive) else None
        self._back_emf_constant = drive.back_emf_constant if drive else math.nan
        self._resistance = drive.resistance if drive else math.nan
        self._lags = drive is not None and drive.time_constant > 0
        self.input_kind = robot.input_kind
        self._loaded = robot.loaded(added)
        self._constants = constants_of(self._loaded)
        self._moving = True if robot.base else None
        self._initial = float(angle), float(velocity)

    @property
    @abstractmethod
    def angle(self) -> float:
        """True angle in rad."""

    @property
    @abstractmethod
    def velocity(self) -> float:
        """True velocity in rad/s."""

    @abstractmethod
    def reset(self) -> None:
        """Go back to the initial state, at time 0."""

    @abstractmethod
    def advance(self, command: float, duration: float) -> None:
        """Simulate ``duration`` s with ``command`` held."""

    @abstractmethod
    def angles_under(self, stamps: Samples, commands: Samples, arrivals: Samples) -> Samples:
        """Return the (n,) true angles in rad at timestamps in s of a whole run.

        Each of the (n,) commands is held from its ``arrivals`` in s to the next, with none before:
        the arithmetic of `butterfly.plant.rig.SimulatedMotor`, in the same order.
        """

    def open_circuit(self, is_open: bool) -> None:
        """Open the motor's circuit, which removes the back EMF, or close it."""
        back_emf = 0.0 if is_open else self._loaded.back_emf
        self._constants = self._constants._replace(back_emf=back_emf)

    def follow(self, commands: Samples, durations: Samples) -> Samples:
        """Hold (n,) commands for their durations in s; return the (n + 1,) angles between."""
        reached = [self.angle]
        for command, duration in zip(commands.tolist(), durations.tolist(), strict=True):
            self.advance(command, duration)
            reached.append(self.angle)
        return np.array(reached)

    @property
    @abstractmethod
    def _armature_current(self) -> float:
        """Current in A of an armature with inductance, a state of the simulation."""

    def current(self, command: float) -> float:
        """Armature current in A (4) under ``command``; NaN for a torque drive."""
        if self._lags:
            return self._armature_current
        return (command - self._back_emf_constant * self.velocity) / self._resistance


class MujocoJoint(Joint):
    """The robot in MuJoCo; with a ``scene`` its ``model`` and ``data`` can be viewed.

    MuJoCo's dry friction reverses before the joint does, by half its time constant, which is raised
    to two steps. A ``fine`` joint takes a tenth of the step, and this lead is a tenth too.
    """

    def __init__(
        self,
        robot: Robot,
        added: AddedMass = NO_ADDED_MASS,
        *,
        scene: bool = False,
        fine: bool = False,
        **start: float,
    ) -> None:
        super().__init__(robot, added, **start)
        self.model = compile_model(robot, added, scene=scene)
        self._finer = _FINER if fine else 1
        self.data = data = mujoco.MjData(self.model)
        self._options, self._length = self.model.opt, 0.0
        self._hinge = hinge_of(self.model)
        # looking up a column costs as much as reading it, and an array element twice a view's
        self._position: memoryview[float] = memoryview(data.qpos)
        self._velocity: memoryview[float] = memoryview(data.qvel)
        self._acceleration: memoryview[float] = memoryview(data.qacc)
        self._command: memoryview[float] = memoryview(data.ctrl)
        self._friction: memoryview[float] = memoryview(self.model.dof_frictionloss)
        self._armature = None
        if self._drive and self._lags:
            self._armature = _Armature(self.model, data, self._drive)
        self._is_stiff = not robot.assistance.isdisjoint({Assistance.CURRENT, Assistance.BRISTLES})
        self._sticks_harder = Assistance.STICKING in robot.assistance

    @property
    def angle(self) -> float:
        """True angle in rad."""
        return self._position[self._hinge]

    @property
    def velocity(self) -> float:
        """True velocity in rad/s."""
        return self._velocity[self._hinge]

    def reset(self) -> None:
        """Go back to the initial state."""
        mujoco.mj_resetData(self.model, self.data)
        hinge = self._hinge
        self.data.qpos[hinge], self.data.qvel[hinge] = self._initial
        if self._armature is not None:
            self._armature.current = 0.0

    def open_circuit(self, is_open: bool) -> None:
        """Open the motor's circuit or close it; see `Joint`."""
        super().open_circuit(is_open)
        if self._armature is not None:
            self._armature.back_emf_constant = 0.0 if is_open else self._back_emf_constant
        else:
            self.model.actuator_gear[0, 0] = 0.0 if is_open else 1.0

    def advance(self, command: float, duration: float) -> None:
        """Step MuJoCo through ``duration`` s, in steps short enough for lag and bristles."""
        count = self._finer * steps_of(duration)
        if self._is_stiff:
            count = max(count, least_steps(self._constants, self.velocity, duration))
        step = duration / count
        if step != self._length:  # setting it costs as much as reading all columns
            self._options.timestep = self._length = step
        if self._armature is None and not self._sticks_harder:
            self._command[0] = command
            mujoco.mj_step(self.model, self.data, count)
            return
        if not self._sticks_harder:
            self._step(command, count)
            return
        half, hinge = 0.5 * step, self._hinge
        for _ in range(count):  # friction is set for the middle of each step
            speed = self._velocity[hinge] + half * self._acceleration[hinge]
            if self._armature and self._drive:
                motor = self._armature.current * self._drive.torque_constant
            else:
                motor = self._loaded.p4 * command - self._constants.back_emf * speed
            angle = self._position[hinge] + half * self._velocity[hinge]
            self._friction[hinge] = friction_at(angle, speed, motor, self._constants)
            self._step(command, 1)

    def angles_under(self, stamps: Samples, commands: Samples, arrivals: Samples) -> Samples:
        """Return the angles of a whole run; see `Joint`."""
        self.reset()
        edges, held = held_between(stamps, commands, arrivals)
        return self.follow(held, np.diff(edges))[np.searchsorted(edges, stamps)]

    def follow(self, commands: Samples, durations: Samples) -> Samples:
        """Hold commands in turn; see `Joint`."""
        if self._is_stiff or self._sticks_harder:
            return super().follow(commands, durations)
        counts = self._finer * counts_of(durations)
        steps = durations / counts
        model, data, step, position = self.model, self.data, mujoco.mj_step, self._position
        hinge = self._hinge
        reached = [self.angle]  # this loop runs a million times
        for command, length, count in zip(
            commands.tolist(), steps.tolist(), counts.tolist(), strict=True
        ):
            self._options.timestep = self._length = length
            self._command[0] = command
            step(model, data, count)
            reached.append(position[hinge])
        return np.array(reached)

    def _step(self, command: float, count: int) -> None:
        if self._armature is not None:
            self._armature.advance(command, count)
            return
        self._command[0] = command
        mujoco.mj_step(self.model, self.data, count)

    @property
    def _armature_current(self) -> float:
        return self._armature.current if self._armature else math.nan


class _Armature:
    """Steps MuJoCo and the motor current together with RK4 (2)-(4).

    MuJoCo integrates its own current to first order, and its alternative, a callback, is shared by
    all threads. So MuJoCo computes accelerations for the current of each stage. The first command
    of the model is the current, its first joint the driven one.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, drive: VoltageDrive) -> None:
        self.current, self.back_emf_constant = 0.0, drive.back_emf_constant
        self._model, self._data, self._drive = model, data, drive
        # The shaft and a body behind a clutch as one complex number, which is faster.
        self._position, self._velocity, self._acceleration = (
            column if column.size == 1 else column.view(np.complex128)
            for column in (data.qpos, data.qvel, data.qacc)
        )
        self._bends = model.na > 0

    def advance(self, voltage: float, count: int) -> None:
        """Take ``count`` steps of the model's length under a voltage in V."""
        h = self._model.opt.timestep
        half, sixth = 0.5 * h, h / 6.0
        x, v, i = self._position.item(), self._velocity.item(), self.current
        z = self._data.act.item() if self._bends else 0.0
        for _ in range(count):
            a1, i1, z1 = self._rates(x, v, i, z, voltage)
            v2 = v + half * a1
            a2, i2, z2 = self._rates(x + half * v, v2, i + half * i1, z + half * z1, voltage)
            v3 = v + half * a2
            a3, i3, z3 = self._rates(x + half * v2, v3, i + half * i2, z + half * z2, voltage)
            v4 = v + h * a3
            a4, i4, z4 = self._rates(x + h * v3, v4, i + h * i3, z + h * z3, voltage)
            x += sixth * (v + 2.0 * v2 + 2.0 * v3 + v4)
            v += sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            i += sixth * (i1 + 2.0 * i2 + 2.0 * i3 + i4)
            z += sixth * (z1 + 2.0 * z2 + 2.0 * z3 + z4)
        self._set(x, v, i, z)
        self.current = float(i)
        self._data.time += count * h

    def _set(self, x: complex, v: complex, i: float, z: float) -> None:
        self._position[0], self._velocity[0], self._data.ctrl[0] = x, v, i
        if self._bends:
            self._data.act[0] = z

    def _rates(
        self, x: complex, v: complex, i: float, z: float, voltage: float
    ) -> tuple[complex, float, float]:
        """Return accelerations, di/dt = (v - R i - k_emf thd)/L (4), and the bristles' rate."""
        self._set(x, v, i, z)
        mujoco.mj_forwardSkip(self._model, self._data, _WHOLE, _NO_SENSORS)
        drive = self._drive
        rate = (voltage - drive.resistance * i - self.back_emf_constant * v.real) / drive.inductance
        return self._acceleration.item(), rate, self._data.act_dot.item() if self._bends else 0.0


class GreyBoxJoint(Joint):
    """The robot with the grey-box equation: set-valued friction, no play."""

    def __init__(self, robot: Robot, added: AddedMass = NO_ADDED_MASS, **start: float) -> None:
        super().__init__(robot, added, **start)
        if robot.clutch:
            raise InputError(
                "GreyBoxJoint", "clutch", robot.clutch, "none: only MuJoCo simulates play"
            )
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
        """Go back to the initial state."""
        self._state = (*self._initial, 0.0, 0.0)

    def advance(self, command: float, duration: float) -> None:
        """Integrate through ``duration`` s in the equal steps of `steps_of`."""
        torque = self._loaded.p4 * command
        self._state = _hold(self._constants, self._state, torque, duration, self._moving)

    def angles_under(self, stamps: Samples, commands: Samples, arrivals: Samples) -> Samples:
        """Return the angles of a whole run; see `Joint`.

        NaN once the joint has turned beyond `LARGEST_ANGLE`.
        """
        inputs = (stamps, self._loaded.p4 * commands, arrivals, self._moving)
        angles = np.full(stamps.size, np.nan)
        _follow(self._constants, self._state, *inputs, angles)
        return angles

    @property
    def _armature_current(self) -> float:
        return self._state[2] / self._drive.torque_constant if self._drive else math.nan


_steps_of = compiled(steps_of)


@compiled
def _follow(  # noqa: PLR0917 - compiled functions take no names
    c: Constants,
    state: State,
    stamps: Samples,
    torques: Samples,
    arrivals: Samples,
    moving: bool | None,
    angles: Samples,
) -> None:
    torque = 0.0
    following = 0
    for k in range(stamps.size):
        if not abs(state[0]) < LARGEST_ANGLE:
            break
        angles[k] = state[0]
        if k + 1 == stamps.size:
            break
        now, end = stamps[k], stamps[k + 1]
        while following <= k and arrivals[following] < end:
            instant = arrivals[following]
            if instant > now:
                state = _hold(c, state, torque, instant - now, moving)
                now = instant
            torque = torques[following]
            following += 1
        state = _hold(c, state, torque, end - now, moving)


@compiled
def _hold(c: Constants, state: State, torque: float, duration: float, moving: bool | None) -> State:
    count = _steps_of(duration)
    h = duration / count
    for _ in range(count):
        finer = count_steps(state, h, c, moving, MOST_STEPS)
        state = after_steps(state, (torque, torque, torque), h, finer, c, moving)
    return state
