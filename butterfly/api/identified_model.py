"""The identified robot as a control engineer uses it."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from butterfly.files import write_file
from butterfly.logs.log import Log
from butterfly.model.linear import Linearisation, resonance_frequency
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, JointKind, LumpedParameters
from butterfly.twin.forms import DEFAULTS, Options

if TYPE_CHECKING:
    import control
    import mujoco

    from butterfly.twin.twin import Twin, Written


@dataclass(frozen=True)
class IdentifiedModel:
    """p1 thdd + p2 thd + p3 sin th = p4 u and the terms beside, with what the hand carries (78)."""

    parameters: LumpedParameters
    """Of the bare hand, SI units."""

    joint: JointKind = JointKind.HINGE
    """How it moves."""

    identified: Callable[[AddedMass, float | None], Twin] | None = field(
        default=None, repr=False, compare=False
    )
    """Returns its twin with a load and a mass, as the data say; None of bare parameters."""

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

    def discretised(
        self, step: float, added_mass: AddedMass = NO_ADDED_MASS, *, angle: float = 0.0
    ) -> control.StateSpace:
        """Return the linearisation for commands that are held during steps, with the exact delay.

        Earlier commands are states, no approximation of the delay is needed (see
        `butterfly.model.control_bridge.discretised`).

        Parameters
        ----------
        step
            In s, between two commands.
        added_mass
            What the hand carries.
        angle
            Of rest, in rad.

        Raises
        ------
        InputError
            If the step is not a positive number.
        """
        from butterfly.model.control_bridge import discretised  # noqa: PLC0415 - slow to import

        return discretised(self.parameters, step, added_mass, angle=angle)

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

    def twin(self, added_mass: AddedMass = NO_ADDED_MASS, *, mass: float | None = None) -> Twin:
        """Return the joint as it is exported, with the logs by which that is measured."""
        from butterfly.twin.twin import Twin  # noqa: PLC0415 - slow to import

        if self.identified is not None:
            return self.identified(added_mass, mass)
        return Twin(parameters=self.parameters, added=added_mass, joint=self.joint, mass=mass)

    def export(
        self,
        path: str | PathLike[str],
        added_mass: AddedMass = NO_ADDED_MASS,
        *,
        to: str = "mjcf",
        mass: float | None = None,
        timestep: float = DEFAULTS.timestep,
        integrator: Literal["RK4", "implicitfast"] = DEFAULTS.integrator,
    ) -> Written:
        """Write the joint as a file for another program, as ``butterfly export`` does.

        What the form cannot hold is warned of, and written in the file.

        Parameters
        ----------
        path
            The file.
        added_mass
            What the joint carries.
        to
            One of `butterfly.twin.forms.FORMS`.
        mass
            Of what swings, in kg, on which the motion does not depend; a possible one if not given.
        timestep
            Step in s of the simulator for which it is written.
        integrator
            Of MuJoCo.

        Returns
        -------
        Written
            The text, what it leaves out, and how far its motion is from our own simulation.

        Raises
        ------
        InputError
            If no joint of that mass moves so, the form cannot hold it, or the file cannot be
            written.
        """
        from butterfly.twin.forms import write_as  # noqa: PLC0415 - slow to import

        options = Options(timestep=timestep, integrator=integrator)
        written = write_as(to, self.twin(added_mass, mass=mass), options)
        write_file(Path(path), written.text)
        for sentence in written.left_out:
            warnings.warn(sentence, stacklevel=2)
        return written

    def mjspec(
        self,
        added_mass: AddedMass = NO_ADDED_MASS,
        *,
        mass: float | None = None,
        timestep: float = DEFAULTS.timestep,
        integrator: Literal["RK4", "implicitfast"] = DEFAULTS.integrator,
    ) -> mujoco.MjSpec:
        """Return the joint as an MjSpec, to attach to a robot of one's own.

        As in ``robot.attach(result.model.mjspec(), frame=frame, prefix="wrist_")``. It has body,
        joint, actuators and sensors, no light, floor or camera.

        Parameters
        ----------
        added_mass, mass, timestep, integrator
            As of `export`; step and integrator should be those of the robot that it is attached to.
        """
        import mujoco  # noqa: PLC0415 - slow to import

        from butterfly.plant.mjcf import text_of  # noqa: PLC0415
        from butterfly.twin.stand_alone import stand_alone  # noqa: PLC0415

        options = Options(timestep=timestep, integrator=integrator)
        root = stand_alone(self.twin(added_mass, mass=mass), options).root
        return mujoco.MjSpec.from_string(text_of(root))
