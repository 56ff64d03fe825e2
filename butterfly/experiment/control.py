"""What an experiment file may say under ``control:``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from butterfly.model.energy import Orbit
from butterfly.model.parameters import LumpedParameters
from butterfly.orbit.controller import Observer, VelocityEstimator
from butterfly.orbit.loop import OrbitSchedule
from butterfly.orbit.recalibration import RecalibrationOptions
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

    def __call__(self, parameters: LumpedParameters) -> Orbit:
        """Return the orbit that a hand of these parameters has."""
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

    def __call__(self, parameters: LumpedParameters, zero: float) -> VelocityEstimator:
        """Return a fresh estimator for a hand of these parameters."""
        if self.observer is not None:
            return Observer(parameters, zero, self.observer.bandwidth)
        assert self.filtered_difference is not None  # noqa: S101 - one of the two is
        return FilteredDifference(self.filtered_difference.time_constant)


_DIFFERENCE = VelocitySpec(filtered_difference=DifferenceSpec())


@dataclass(frozen=True, kw_only=True)
class ControlSpec(OrbitSchedule):
    """An orbit to hold, what each round does, and what is compared at the end."""

    target: TargetSpec
    velocity: VelocitySpec = _DIFFERENCE
    believed: LumpedParameters | None = None  # of the bare hand; identified if not given
    recalibration: RecalibrationOptions = RecalibrationOptions()
    cross_check: tuple[float, ...] = ()  # amplitudes in rad (see `study_orbit`)
