"""The identified model for control and export."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from butterfly.logs.log import Log
from butterfly.model.linear import Linearisation, resonance_frequency
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, JointKind, LumpedParameters
from butterfly.outputs import call
from butterfly.twin.forms import DEFAULTS, Options

if TYPE_CHECKING:
    import control
    import mujoco

    from butterfly.twin.twin import Twin, Written


@dataclass(frozen=True)
class IdentifiedModel:
    """The identified joint: p1 thdd + p2 thd + p3 sin th = p4 u and further terms."""

    parameters: LumpedParameters
    """Parameters of the bare joint in SI units."""

    joint: JointKind = JointKind.HINGE
    """Hinge or slide."""

    identified: Callable[[AddedMass, float | None], Twin] | None = field(
        default=None, repr=False, compare=False
    )
    """Makes the twin with an added mass and a body mass; None for plain parameters."""

    def with_added_mass(self, added_mass: AddedMass) -> LumpedParameters:
        """Return the parameters with an added mass (78)."""
        return self.parameters.with_added_mass(added_mass)

    def linearised(
        self, added_mass: AddedMass = NO_ADDED_MASS, *, angle: float = 0.0, pade_order: int = 4
    ) -> control.StateSpace:
        """Return the linearisation at rest, from command to angle and velocity.

        Includes the armature's lag and a Padé approximation of the delay, without Coulomb friction
        (see `butterfly.model.control_bridge.linearised`).

        Parameters
        ----------
        added_mass
            Added mass.
        angle
            Rest angle in rad.
        pade_order
            Order of the approximation. With 0 or a negative delay the delay is omitted and the
            system is named ``hand_without_delay``.
        """
        from butterfly.model.control_bridge import linearised  # noqa: PLC0415 - slow to import

        return linearised(self.parameters, added_mass, angle=angle, pade_order=pade_order)

    def discretised(
        self, step: float, added_mass: AddedMass = NO_ADDED_MASS, *, angle: float = 0.0
    ) -> control.StateSpace:
        """Return the zero-order-hold discretisation, with the exact delay.

        Earlier commands are states (see `butterfly.model.control_bridge.discretised`).

        Parameters
        ----------
        step
            Sample time in s.
        added_mass
            Added mass.
        angle
            Rest angle in rad.

        Raises
        ------
        InputError
            If the step is not a positive number.
        """
        from butterfly.model.control_bridge import discretised  # noqa: PLC0415 - slow to import

        return discretised(self.parameters, step, added_mass, angle=angle)

    def nonlinear(self, added_mass: AddedMass = NO_ADDED_MASS) -> control.NonlinearIOSystem:
        """Return the nonlinear equation for python-control, without the delay."""
        from butterfly.model.control_bridge import nonlinear_system  # noqa: PLC0415 - slow to import

        return nonlinear_system(self.with_added_mass(added_mass))

    def frequency_response(
        self, omega: ArrayLike, added_mass: AddedMass = NO_ADDED_MASS
    ) -> NDArray[np.complex128]:
        """G(jw) of the linearisation (13) in rad per unit of input, at frequencies in rad/s."""
        return Linearisation.of(self.with_added_mass(added_mass)).response(omega)

    def resonance(self, added_mass: AddedMass = NO_ADDED_MASS) -> float:
        """Return the resonance frequency of the linearisation in rad/s; 0 without a peak."""
        return resonance_frequency(self.with_added_mass(added_mass))

    def simulate(self, log: Log, *, zero: float = 0.0, velocity: float | None = None) -> Log:
        """Simulate a log from its initial angle with its input (free run).

        Parameters
        ----------
        log
            Log whose input, added mass and initial angle are used.
        zero
            Encoder reading in rad with the joint hanging at rest.
        velocity
            Initial velocity in rad/s. Default: from the log's first samples.
        """
        from butterfly.identification.free_run import FreeRun, Setting  # noqa: PLC0415 - slow to import

        run = FreeRun.of(log, Setting(parameters=self.parameters, zero=zero, velocity=velocity))
        return replace(log.moving_so(run.simulated), source="grey-box model")

    def twin(
        self, added_mass: AddedMass = NO_ADDED_MASS, *, hand_mass: float | None = None
    ) -> Twin:
        """Return the twin: the joint to export, with logs to check its accuracy."""
        from butterfly.twin.twin import Twin  # noqa: PLC0415 - slow to import

        if self.identified is not None:
            return self.identified(added_mass, hand_mass)
        return Twin(parameters=self.parameters, added=added_mass, joint=self.joint, mass=hand_mass)

    def export(
        self,
        path: str | PathLike[str],
        added_mass: AddedMass = NO_ADDED_MASS,
        *,
        to: str = "mjcf",
        hand_mass: float | None = None,
        timestep: float = DEFAULTS.timestep,
        integrator: Literal["RK4", "implicitfast"] = DEFAULTS.integrator,
        overwrite: bool = False,
    ) -> Written:
        """Export the joint (its twin), as ``butterfly export`` does.

        Warns of everything that the format cannot represent; the file says so too.

        Parameters
        ----------
        path
            File to write.
        added_mass
            Added mass.
        to
            Format, one of `butterfly.twin.forms.FORMS`.
        hand_mass
            Mass of the moving body in kg; the motion does not depend on it. Default: chosen.
        timestep
            Time step of your simulator in s.
        integrator
            MuJoCo integrator.
        overwrite
            Whether to replace an existing file of a format that holds no mark: C, JSON.

        Returns
        -------
        Written
            The text, what the format cannot represent, and the error against our own simulation.

        Raises
        ------
        InputError
            If ``hand_mass`` is impossible, the format does not fit this joint, or the file cannot
            be written.
        """
        from butterfly.twin.forms import write_twin  # noqa: PLC0415 - slow to import

        options = Options(timestep=timestep, integrator=integrator)
        with call(overwrite=overwrite):
            twin = self.twin(added_mass, hand_mass=hand_mass)
            written = write_twin(to, twin, options, Path(path))
        for sentence in written.left_out:
            warnings.warn(sentence, stacklevel=2)
        return written

    def mjspec(
        self,
        added_mass: AddedMass = NO_ADDED_MASS,
        *,
        hand_mass: float | None = None,
        timestep: float = DEFAULTS.timestep,
        integrator: Literal["RK4", "implicitfast"] = DEFAULTS.integrator,
    ) -> mujoco.MjSpec:
        """Return the joint as an MjSpec, to attach to your robot.

        Example: ``robot.attach(result.model.mjspec(), frame=frame, prefix="wrist_")``. Includes
        body, joint, actuators and sensors, without light, floor and camera.

        Parameters
        ----------
        added_mass, hand_mass, timestep, integrator
            As in `export`. Use the robot's time step and integrator.
        """
        import mujoco  # noqa: PLC0415 - slow to import

        from butterfly.plant.mjcf import text_of  # noqa: PLC0415
        from butterfly.twin.stand_alone import stand_alone  # noqa: PLC0415

        options = Options(timestep=timestep, integrator=integrator)
        root = stand_alone(self.twin(added_mass, hand_mass=hand_mass), options).root
        return mujoco.MjSpec.from_string(text_of(root))
