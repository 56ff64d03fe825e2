"""A simulated bench: the robot, what simulates it, and what stands between it and the log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.logs.log import InputKind, Log, Sine
from butterfly.model.parameters import AddedMass
from butterfly.plant.bench import Bench, ControlLaw, recorded
from butterfly.plant.excitations import Excitation, initial_angle
from butterfly.plant.joints import GreyBoxJoint, MujocoJoint, Simulator, kind_of
from butterfly.plant.motor import CommandPath, SimulatedMotor
from butterfly.plant.robot import Robot
from butterfly.plant.sensors import Clock, Encoder, Faults

_SOURCES = {Simulator.MUJOCO: "MuJoCo", Simulator.GREY_BOX: "grey box"}


@dataclass(frozen=True, kw_only=True)
class Setup:
    """All that an experiment says about its simulated bench; joint, motor and bench are made here.

    Parameters
    ----------
    robot
        The robot.
    simulator
        MuJoCo, or the grey-box equation.
    clock, encoder, path, faults
        Of the controller.
    """

    robot: Robot
    simulator: Simulator = Simulator.MUJOCO
    clock: Clock = Clock()
    encoder: Encoder = Encoder()
    path: CommandPath = CommandPath()
    faults: Faults = Faults()

    @property
    def input_kind(self) -> InputKind:
        """What the commands mean."""
        return kind_of(self.robot.drive)

    @property
    def runs_open_loop(self) -> bool:
        """Whether a compiled loop can do its runs: the grey box's all, MuJoCo's only some.

        MuJoCo's has a regular clock, and does nothing between its steps.
        """
        if self.simulator is Simulator.GREY_BOX:
            return True
        return self.clock.jitter == 0 and self.path.delay == 0 and not self.robot.assistance

    def joint(
        self, added: AddedMass, angle: float = 0.0, *, scene: bool = False
    ) -> MujocoJoint | GreyBoxJoint:
        """Return the joint at rest.

        Parameters
        ----------
        added
            What the hand carries.
        angle
            In rad, at which it starts.
        scene
            Whether MuJoCo's model has light and camera, for a viewer.

        Raises
        ------
        InputError
            If the simulator cannot do what the robot has.
        """
        return self.simulator.joint(self.robot, added, angle, scene=scene)

    def bench(self, added: AddedMass, angle: float, rng: np.random.Generator) -> Bench:
        """Return a bench about the joint of `joint`; all that is random is drawn from ``rng``."""
        return self.bench_of(self.joint(added, angle), rng)

    def bench_of(self, joint: MujocoJoint | GreyBoxJoint, rng: np.random.Generator) -> Bench:
        """Return a bench about a joint that `joint` made."""
        motor = SimulatedMotor(joint, path=self.path, encoder=self.encoder, rng=rng)
        return Bench(motor, clock=self.clock, rng=rng)

    def run(
        self,
        law: ControlLaw,
        added: AddedMass,
        angle: float,
        duration: float,
        rng: np.random.Generator,
    ) -> Log:
        """Record a run under a control law.

        Parameters
        ----------
        law
            From a reading to a command.
        added
            What the hand carries.
        angle
            In rad, at which it starts, at rest.
        duration
            In s.
        rng
            Source of everything random.
        """
        with self.bench(added, angle, rng) as bench:
            log = bench.run(law, duration, **self.about(added))
        return self.faults.apply(log, rng)

    def play(
        self, added: AddedMass, excitation: Excitation, duration: float, rng: np.random.Generator
    ) -> Log:
        """Record a run with an excitation, cycle by cycle (see `run`)."""
        with self.bench(added, initial_angle(excitation), rng) as bench:
            log = bench.play(excitation.sample, duration, **self.about(added, excitation))
        return self.faults.apply(log, rng)

    def record(
        self,
        run: tuple[AddedMass, Excitation],
        time: NDArray[np.float64],
        commands: NDArray[np.float64],
        true: NDArray[np.float64],
        rng: np.random.Generator,
    ) -> Log:
        """Return the log of an open-loop run that was simulated elsewhere, as `play` makes it.

        Parameters
        ----------
        run
            What the hand carried, and the excitation.
        time, commands, true
            (n,) stamps in s, commands as they were set, and true angles in rad.
        rng
            Of encoder and faults.

        Raises
        ------
        InputError
            If the joint diverged.
        """
        angle = self.encoder.read(time, true, rng)
        about = self.about(*run)
        log = recorded(time, commands, angle, input_kind=self.input_kind, **about)
        return self.faults.apply(log, rng)

    def about(self, added: AddedMass, excitation: Excitation | None = None) -> dict[str, Any]:
        """Return what a log says about its run: mass, sine if it is one, and simulator."""
        sine = excitation if isinstance(excitation, Sine) else None
        return {"added_mass": added, "excitation": sine, "source": _SOURCES[self.simulator]}
