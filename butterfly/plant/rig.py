"""A simulated rig: robot, simulator, firmware of its servo, and the path to the log."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.logs.log import InputKind, Log, Sine
from butterfly.model.greybox import simulate
from butterfly.model.kernel.servo_loop import MEMORY, Loop, slewed, torque
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.servo import LawStructure, ServoLoop
from butterfly.model.terms import DRIVE, IDEAL
from butterfly.plant.joints import GreyBoxJoint, Joint, MujocoJoint
from butterfly.plant.motor import (
    LARGEST_COMMAND,
    CommandPath,
    ControlLaw,
    ControlLoop,
    Reading,
    recorded,
)
from butterfly.plant.robot import Robot, RobotChange
from butterfly.plant.sensors import FINEST, Clock, Encoder, Faults
from butterfly.signals.excitations import Excitation, Table, initial_angle

Spans = tuple[tuple[float, float], ...]
"""Pairs of start and end times in s between which a servo is off."""

_ROUNDING = 1e-9  # of a period, by which sums of durations miss an update


class Firmware:
    """Drives a joint, in MuJoCo or not, by a servo loop; its output is held between updates."""

    def __init__(self, loop: Loop) -> None:
        self._loop = loop
        self.start()

    def start(self) -> None:
        """Get ready at time 0."""
        self._memory, self._torque, self._is_on = np.zeros(MEMORY), 0.0, math.nan

    @property
    def command(self) -> float:
        """Present command of the drive."""
        return self._torque / self._loop.p4

    def update(self, joint: Joint, k: int = 0) -> None:
        """Sample a joint at the start of interval k."""
        loop = self._loop
        if loop.on[k] != self._is_on:
            self._is_on = loop.on[k]
            joint.open_circuit(not self._is_on)
        state = (joint.angle, joint.velocity, 0.0, 0.0)
        self._torque = torque(k, state, loop, self._memory, self._torque, None)


class Servo(Firmware):
    """A servo that follows a setpoint at the clock of its firmware, unless it is off.

    It measures the true state of its joint, without an encoder.
    """

    def __init__(
        self,
        servo: ServoLoop,
        parameters: LumpedParameters,
        torque_off: Spans,
        supply: Table | None,
    ) -> None:
        self._servo, self._torque_off, self._supply = servo, torque_off, supply
        columns = (np.zeros(1), np.zeros(1), None, np.ones(1))
        super().__init__(Loop.of(servo, parameters, period=servo.period, columns=columns))

    def start(self) -> None:
        """Get ready at time 0."""
        super().start()
        self._updates, self._goal = 0, math.nan

    def advance(self, joint: Joint, setpoint: float, begin: float, end: float) -> None:
        """Simulate a joint between two instants in s with a setpoint."""
        self._loop.on[0] = is_on(self._torque_off, np.array(begin))
        if self._supply is not None:
            self._loop.supply[0] = self._supply.sample(np.array(begin))
        margin = _ROUNDING * self._servo.period
        while (due := self._updates * self._servo.period) < end - margin:
            if due > begin + margin:
                joint.advance(self.command, due - begin)
                begin = due
            self._loop.setpoint[0] = self._goal = self._slewed(setpoint)
            self.update(joint)
            self._updates += 1
        joint.advance(self.command, end - begin)

    def _slewed(self, setpoint: float) -> float:
        servo = self._servo
        if servo.rule.structure is not LawStructure.PID or math.isnan(self._goal):
            return setpoint
        both = np.array([self._goal, setpoint])
        return float(slewed(both, both, servo.speed_limit * servo.period)[0][1])


def is_on(torque_off: Spans, time: Samples) -> Samples:
    """Return (n,) numbers: 1.0 at instants in s at which a servo is on, else 0.0."""
    off = [(time >= begin) & (time < end) for begin, end in torque_off]
    return np.asarray(1.0 - np.any(off, axis=0))


_RUN_IN_STEP, _RUN_IN_PHASE = 5e-3, 0.25  # s and rad of the sine, at most


class SimulatedMotor:
    """A motor with a simulated joint, a command path and an encoder, its noise from ``rng``.

    A delayed command takes effect at its own instant, not at the next cycle; regimes of the
    ``clock`` delay it further. The command of a ``servo`` is its setpoint. The joint may become
    another ``later``, at an instant in s, made from the angle and velocity then.
    """

    def __init__(
        self,
        joint: Joint,
        *,
        path: CommandPath = CommandPath(),
        encoder: Encoder = Encoder(),
        clock: Clock = Clock(),
        rng: np.random.Generator | None = None,
        servo: Servo | None = None,
        later: tuple[float, Callable[[float, float], Joint]] | None = None,
    ) -> None:
        self._joint, self._servo, self._clock, self._later = joint, servo, clock, later
        self._path, self._is_open = path, path == CommandPath() and not clock.regimes
        self._encoder = encoder
        self._rng = rng or np.random.default_rng(0)
        self._pending: deque[tuple[float, float]] = deque()
        self._time = self._applied = 0.0

    @property
    def input_kind(self) -> InputKind:
        """Kind of the command."""
        return self._joint.input_kind if self._servo is None else InputKind.SETPOINT

    def mount(self, joint: Joint) -> None:
        """Put another joint, such as one that carries a mass, in place of the present one."""
        self._joint = joint

    def start(self) -> None:
        """Put the joint to rest at time 0."""
        self._joint.reset()
        if self._servo is not None:
            self._servo.start()
        self._pending.clear()
        self._time = self._applied = 0.0

    def stop(self) -> None:
        """Set the terminals to 0."""
        self._pending.clear()
        self._applied = 0.0

    def command(self, value: float) -> float:
        """Set the command; see `Motor`."""
        if self._is_open and abs(value) < LARGEST_COMMAND:
            self._applied = value
            return value
        path = self._path
        value = path.shape(value)
        delivered = path.delivered(value)
        held = self._servo is not None and self._time == 0  # from before the first
        late = path.delay
        if self._clock.regimes:
            late += float(self._clock.late(np.array([self._time]))[0])
        if (late > 0 or self._pending) and not held:
            last = self._pending[-1][0] if self._pending else 0.0
            self._pending.append((max(self._time + late, last), delivered))
        else:
            self._applied = delivered
        return value

    def read(self) -> Reading:
        """Read the encoder; see `Motor`."""
        time, joint = self._time, self._joint
        angle = self._encoder.read_one(time, joint.angle, self._rng)
        command = self._applied if self._servo is None else self._servo.command
        fields = time, angle, joint.current(command)
        return tuple.__new__(Reading, fields)  # as `Reading` does, in half the time

    def wait(self, duration: float) -> None:
        """Simulate ``duration`` s, switching to each delayed command at its own instant."""
        end = self._time + duration
        while self._pending and self._pending[0][0] < end:
            instant, value = self._pending.popleft()
            if instant > self._time:
                self._advance(instant)
            self._applied = value
        if self._later is not None and self._time >= self._later[0]:
            self._joint = self._later[1](self._joint.angle, self._joint.velocity)
            self._later = None
        self._advance(end)

    def _advance(self, end: float) -> None:
        if self._servo is None:
            self._joint.advance(self._applied, end - self._time)
        else:
            self._servo.advance(self._joint, self._applied, self._time, end)
        self._time = end


class Simulator(StrEnum):
    """Simulator of the joint."""

    MUJOCO = "mujoco"
    GREY_BOX = "grey-box"


_SOURCES = {Simulator.MUJOCO: "MuJoCo", Simulator.GREY_BOX: "grey box"}


@dataclass(frozen=True, kw_only=True)
class Rig:
    """A robot and how it is run; creates joint, motor and control loop."""

    robot: Robot
    simulator: Simulator = Simulator.MUJOCO
    clock: Clock = Clock()
    encoder: Encoder = Encoder()
    path: CommandPath = CommandPath()
    faults: Faults = Faults()
    servo: ServoLoop | None = None
    """Its loop: the commands are setpoints, and the command path applies to the drive."""
    torque_off: Spans = ()
    """Pairs of start and end times in s between which the servo is off."""
    supply: Table | None = None
    """Supply in V over time, if not that of the loop."""
    run_in: float = 0.0
    """Time in s for which each sine drives the joint before its log begins; not that of a servo."""
    fine: bool = False
    """Whether MuJoCo takes a tenth of the step (see `MujocoJoint`)."""

    @property
    def runs_in_mujoco(self) -> bool:
        """Whether MuJoCo simulates whole runs: without a servo, and without `Assistance`."""
        mujoco = self.simulator is Simulator.MUJOCO
        return mujoco and self.servo is None and not self.robot.assistance and not self.fine

    def start(self, added: AddedMass, excitation: Excitation) -> tuple[float, float]:
        """Return the angle in rad and the velocity in rad/s at which a run begins.

        It begins at rest, or where `run_in` s of its sine have taken the grey-box model from there.
        """
        at_rest = initial_angle(excitation), 0.0
        if not (self.run_in and isinstance(excitation, Sine)) or self.servo is not None:
            return at_rest
        step = max(min(_RUN_IN_STEP, _RUN_IN_PHASE / excitation.omega), self.clock.step)
        time = np.linspace(-self.run_in, 0.0, math.ceil(self.run_in / step) + 1)
        late = self.path.delay + self.clock.step / 2  # a command is held for a cycle
        sampled = excitation.sample(time[:-1, None] + np.outer(np.diff(time), [0, 0.5, 1]) - late)
        inputs = self.path.delivered(self.path.shape_all(sampled))
        angle, velocity = simulate(self.robot.loaded(added), time, inputs, *at_rest)
        return float(angle[-1]), float(velocity[-1])

    def joint(
        self, added: AddedMass, angle: float = 0.0, velocity: float = 0.0, *, scene: bool = False
    ) -> MujocoJoint | GreyBoxJoint:
        """Return the joint in a state in rad and rad/s; in MuJoCo with a scene for a viewer."""
        if self.simulator is Simulator.MUJOCO:
            about = {"angle": angle, "velocity": velocity}
            return MujocoJoint(self.robot, added, scene=scene, fine=self.fine, **about)
        return GreyBoxJoint(self.robot, added, angle=angle, velocity=velocity)

    def loop(
        self,
        joint: Joint,
        rng: np.random.Generator,
        later: tuple[float, Callable[[float, float], Joint]] | None = None,
    ) -> ControlLoop:
        """Return a control loop around a joint, which may become another (see `SimulatedMotor`)."""
        path, servo = self.path, None
        if self.servo is not None:  # behind whose firmware are the flaws of the drive
            parameters = replace(self.robot.lumped, **{name: getattr(path, name) for name in DRIVE})
            off = tuple((a + path.delay, b + path.delay) for a, b in self.torque_off)
            servo = Servo(self.servo, parameters, off, self.supply)
            path = replace(path, **vars(IDEAL))
        motor = SimulatedMotor(
            joint,
            path=path,
            encoder=self.encoder,
            clock=self.clock,
            rng=rng,
            servo=servo,
            later=later,
        )
        return ControlLoop(motor, clock=self.clock, rng=rng)

    def rough_and_fine(
        self, seed: int | np.random.SeedSequence
    ) -> tuple[Callable[..., Log], Callable[..., Log]] | None:
        """Return `run` with exact readings, at usual and at finer steps; None for the grey box.

        The logs of the two differ by MuJoCo's error. The grey box is exact.
        """
        if self.simulator is not Simulator.MUJOCO:
            return None
        rough = replace(self, encoder=Encoder(steps=FINEST), faults=Faults())
        fine = replace(rough, fine=True)
        rngs = np.random.default_rng(seed), np.random.default_rng(seed)
        return partial(rough.run, rng=rngs[0]), partial(fine.run, rng=rngs[1])

    def run(
        self,
        law: ControlLaw,
        start: float,
        duration: float,
        added: AddedMass,
        *,
        rng: np.random.Generator,
        change: RobotChange | None = None,
    ) -> Log:
        """Record ``duration`` s under a control law, from rest at the angle ``start`` in rad.

        The robot may ``change`` meanwhile.
        """
        later = None
        if change is not None:
            later = change.at, partial(replace(self, robot=change.of(self.robot)).joint, added)
        with self.loop(self.joint(added, start), rng, later) as loop:
            return self._kept(loop.run(law, duration, **self._about(added)), rng)

    def play(
        self,
        added: AddedMass,
        excitation: Excitation,
        duration: float,
        rng: np.random.Generator,
        joint: Joint | None = None,
    ) -> Log:
        """Record ``duration`` s of an excitation, cycle by cycle, with a fresh joint if given."""
        joint = joint or self.joint(added, *self.start(added, excitation))
        with self.loop(joint, rng) as loop:
            log = loop.play(excitation.sample, duration, **self._about(added, excitation))
        return self._kept(log, rng)

    def record(
        self,
        run: tuple[AddedMass, Excitation],
        time: Samples,
        commands: Samples,
        true: Samples,
        rng: np.random.Generator,
    ) -> Log:
        """Return the log of `play` from (n,) timestamps, commands and true angles of a run."""
        angle = self.encoder.read(time, true, rng)
        log = recorded(time, commands, angle, input_kind=self.robot.input_kind, **self._about(*run))
        return self._kept(log, rng)

    def _kept(self, log: Log, rng: np.random.Generator) -> Log:
        """Return the log of a run as written, with faults."""
        if self.torque_off:
            log = replace(log, enabled=is_on(self.torque_off, log.time))
        if self.supply is not None:
            log = replace(log, supply=self.supply.sample(log.time))
        return self.faults.apply(log, rng)

    def _about(self, added: AddedMass, excitation: Excitation | None = None) -> dict[str, Any]:
        sine = excitation if isinstance(excitation, Sine) else None
        about = {"added_mass": added, "excitation": sine, "servo": self.servo}
        return about | {"source": _SOURCES[self.simulator]}
