"""What an experiment file may say under ``control:``, and how it becomes a plan."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated

from pydantic import Field

from butterfly.model.energy import Orbit
from butterfly.model.parameters import LumpedParameters
from butterfly.orbit.controller import Observer, VelocityEstimator
from butterfly.orbit.loop import Plan, Schedule
from butterfly.orbit.recalibration_options import RecalibrationOptions
from butterfly.plant.sensors import FilteredDifference
from butterfly.yaml_input import OneOf, StrictModel


class StateSpec(StrictModel):
    """A state of the hand in rad and rad/s."""

    angle: float
    velocity: float


class TargetSpec(OneOf):
    """The orbit to hold: by its amplitude in rad, its energy in J, or a state on it."""

    amplitude: float | None = None
    energy: float | None = None
    state: StateSpec | None = None

    def orbit(self, parameters: LumpedParameters) -> Orbit:
        """Return the orbit that a hand of these parameters has.

        Raises
        ------
        InputError
            If it has none.
        """
        if self.amplitude is not None:
            return Orbit.of_amplitude(parameters, self.amplitude)
        if self.energy is not None:
            return Orbit.of_energy(parameters, self.energy)
        assert self.state is not None  # noqa: S101 - one of the three is
        return Orbit.of_state(parameters, self.state.angle, self.state.velocity)


class DifferenceSpec(StrictModel):
    """A filtered difference; its low pass in s."""

    time_constant: Annotated[float, Field(gt=0)] = 0.003


class ObserverSpec(StrictModel):
    """Luenberger's observer; its bandwidth in rad/s."""

    bandwidth: Annotated[float, Field(gt=0)] = 60.0


class VelocitySpec(OneOf):
    """How the controller knows the velocity."""

    filtered_difference: DifferenceSpec | None = None
    observer: ObserverSpec | None = None

    def estimator(self, parameters: LumpedParameters, zero: float) -> VelocityEstimator:
        """Return a fresh estimator for a hand of these parameters."""
        if self.observer is not None:
            return Observer(parameters, zero, self.observer.bandwidth)
        assert self.filtered_difference is not None  # noqa: S101 - one of the two is
        return FilteredDifference(self.filtered_difference.time_constant)


_DIFFERENCE = VelocitySpec(filtered_difference=DifferenceSpec())


@dataclass(frozen=True, kw_only=True)
class ControlSpec(Schedule):
    """An orbit to hold, and the rounds of re-calibration next to it.

    Parameters
    ----------
    target
        The orbit.
    velocity
        From the encoder.
    believed
        Parameters of the bare hand to begin with; if not given they are identified from the
        experiment's excitations.
    recalibration
        Balance, candidate terms and the rest.
    cross_check
        Amplitudes in rad of orbits at which models are re-calibrated and tried on each other.
    """

    target: TargetSpec
    velocity: VelocitySpec = _DIFFERENCE
    believed: LumpedParameters | None = None
    recalibration: RecalibrationOptions = RecalibrationOptions()
    cross_check: tuple[float, ...] = ()

    def plan(self, zero: float) -> Plan:
        """Return the plan of `butterfly.orbit.loop` that this describes.

        Parameters
        ----------
        zero
            Encoder reading in rad of the hanging hand.
        """
        return Plan(
            **{each.name: getattr(self, each.name) for each in fields(Schedule)},
            target=self.target.orbit,
            velocity=lambda parameters: self.velocity.estimator(parameters, zero),
        )
