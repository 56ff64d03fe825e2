"""What an experiment file may say under ``control:``, and how it becomes a plan."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from butterfly.experiment.oneof import OneOf
from butterfly.model.energy import Orbit
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.orbit.loop import Plan
from butterfly.orbit.options import RecalibrationOptions
from butterfly.orbit.velocity import FilteredDifference, Observer, VelocityEstimator
from butterfly.yaml_input import StrictModel


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


class ControlSpec(StrictModel):
    """An orbit to hold, and the rounds of re-calibration next to it.

    Parameters
    ----------
    target
        The orbit.
    believed
        Parameters of the bare hand to begin with; if not given they are identified from the
        experiment's excitations.
    multiplier
        Share of a perturbation that is left after one period; sets gamma.
    duration
        Of each run in s.
    starts
        Angles in rad at which a run of each round starts. The amplitude is measured in the first.
    orbits
        Amplitudes in rad of further orbits, held in a run each.
    dither
        Share of the control's rms added to all runs but the first.
    added_masses
        Each of the runs is made with each; two different ones make p1..p4 absolute.
    kick
        Command that starts a hand at rest.
    velocity
        From the encoder.
    rounds, amplitude_tolerance, parameter_tolerance
        When to end: after so many rounds, at an amplitude so near in rad, or when parameters change
        by so small a share.
    recalibration
        Balance, candidate terms and the rest.
    cross_check
        Amplitudes in rad of orbits at which models are re-calibrated and tried on each other.
    """

    target: TargetSpec
    believed: LumpedParameters | None = None
    multiplier: Annotated[float, Field(gt=0, lt=1)] = 0.5
    duration: Annotated[float, Field(gt=0)] = 20.0
    starts: Annotated[tuple[float, ...], Field(min_length=1)]
    orbits: tuple[float, ...] = ()
    dither: Annotated[float, Field(ge=0)] = 0.0
    added_masses: Annotated[tuple[AddedMass, ...], Field(min_length=1)] = (NO_ADDED_MASS,)
    kick: Annotated[float, Field(ge=0)] = 0.0
    velocity: VelocitySpec = VelocitySpec(filtered_difference=DifferenceSpec())
    rounds: Annotated[int, Field(ge=1)] = 4
    amplitude_tolerance: Annotated[float, Field(ge=0)] = 3.5e-3
    parameter_tolerance: Annotated[float, Field(ge=0)] = 1e-3
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
            target=self.target.orbit,
            multiplier=self.multiplier,
            duration=self.duration,
            starts=self.starts,
            orbits=self.orbits,
            dither=self.dither,
            added_masses=self.added_masses,
            kick=self.kick,
            velocity=lambda parameters: self.velocity.estimator(parameters, zero),
            rounds=self.rounds,
            amplitude_tolerance=self.amplitude_tolerance,
            parameter_tolerance=self.parameter_tolerance,
        )
