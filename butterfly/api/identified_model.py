"""The identified robot as a control engineer uses it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from butterfly.errors import InputError
from butterfly.logs.log import Log
from butterfly.model.linear import Linearisation, resonance_frequency
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, JointKind, LumpedParameters

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class IdentifiedModel:
    """p1 thdd + p2 thd + p3 sin th = p4 u and the terms beside, with what the hand carries (78)."""

    parameters: LumpedParameters
    """Of the bare hand, SI units."""

    joint: JointKind = JointKind.HINGE
    """How it moves."""

    def with_added_mass(self, added_mass: AddedMass) -> LumpedParameters:
        """Return the parameters of the hand with an added mass (78)."""
        return self.parameters.with_added_mass(added_mass)

    def linearised(
        self, added_mass: AddedMass = NO_ADDED_MASS, *, angle: float = 0.0, pade_order: int = 4
    ) -> control.StateSpace:
        """Return the linearisation about rest, from command to angle and velocity.

        The armature's lag is a state, the delay a Padé approximation; friction that holds the joint
        at rest is left out (see `butterfly.model.control_bridge.linearised`).

        Parameters
        ----------
        added_mass
            What the hand carries.
        angle
            Of rest, in rad.
        pade_order
            Of the approximation; 0 leaves the delay out, as a negative estimate of it is: the
            system is then named ``hand_without_delay``.
        """
        from butterfly.model.control_bridge import linearised  # noqa: PLC0415 - slow to import

        return linearised(self.parameters, added_mass, angle=angle, pade_order=pade_order)

    def nonlinear(self, added_mass: AddedMass = NO_ADDED_MASS) -> control.NonlinearIOSystem:
        """Return the whole equation as python-control's object, the delay left out."""
        from butterfly.model.control_bridge import nonlinear_system  # noqa: PLC0415 - slow to import

        return nonlinear_system(self.with_added_mass(added_mass))

    def frequency_response(
        self, omega: ArrayLike, added_mass: AddedMass = NO_ADDED_MASS
    ) -> NDArray[np.complex128]:
        """G(jw) of the linearisation (13) in rad per unit of input, at frequencies in rad/s."""
        return Linearisation.of(self.with_added_mass(added_mass)).response(omega)

    def resonance(self, added_mass: AddedMass = NO_ADDED_MASS) -> float:
        """Return the frequency in rad/s at which the linearisation's gain peaks; 0 if nowhere."""
        return resonance_frequency(self.with_added_mass(added_mass))

    def simulate(self, log: Log, *, zero: float = 0.0, velocity: float | None = None) -> Log:
        """Return a log with its angle simulated from the first sample on, with its own input.

        Parameters
        ----------
        log
            Of any input; its added mass is put on.
        zero
            Reading of the encoder in rad where the hand hangs.
        velocity
            At the first sample, in rad/s; as the log's own first samples tell, if not given.
        """
        from butterfly.identification.free_run import FreeRun, Setting  # noqa: PLC0415 - slow to import

        setting = Setting(parameters=self.parameters, zero=zero, velocity=velocity)
        run = FreeRun.of(log, setting)
        return replace(log.moving_so(run.simulated), source="grey-box model")

    def export(
        self,
        path: str | PathLike[str],
        added_mass: AddedMass = NO_ADDED_MASS,
        *,
        mass: float | None = None,
    ) -> None:
        """Write an MJCF file of a robot that moves so by itself in plain MuJoCo, delay included.

        What MuJoCo cannot do is warned of, and written in the file.

        Parameters
        ----------
        path
            The file.
        added_mass
            What the hand carries.
        mass
            Of the hand in kg, on which the motion does not depend; a possible one if not given.

        Raises
        ------
        InputError
            If no hand of that mass moves so, as a slide does not, or the file cannot be written.
        """
        from butterfly.plant.robot import Robot  # noqa: PLC0415 - slow to import
        from butterfly.plant.stand_alone import command_of, stand_alone  # noqa: PLC0415

        if self.joint is JointKind.SLIDE:
            raise InputError("export", "joint", self.joint, "a hinge, which MuJoCo's model has")
        robot, carried = Robot.of_loaded(self.parameters, added_mass, mass)
        written = stand_alone(robot, carried, **command_of(self.parameters))
        written.write(Path(path))
        for sentence in written.left_out:
            warnings.warn(sentence, stacklevel=2)
