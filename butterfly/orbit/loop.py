"""Control, log, re-calibrate, control again, until the hand swings as wanted."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from butterfly.errors import InputError, require_number
from butterfly.logs.log import Log
from butterfly.model.energy import Orbit
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.orbit.analysis import swing
from butterfly.orbit.controller import Dithered, EnergyShaping, Target, VelocityEstimator, gain_for
from butterfly.orbit.recalibration import Recalibration, recalibrate
from butterfly.orbit.recalibration_options import RecalibrationOptions
from butterfly.plant.control_loop import ControlLaw
from butterfly.plant.sensors import FilteredDifference
from butterfly.progress import Track, untracked

_SETTLED = 0.5  # share of a run after which its amplitude is measured


class RunLaw(Protocol):
    """Runs a control law on a robot; `butterfly.plant.rig.Rig.run` does, its ``rng`` given."""

    def __call__(self, law: ControlLaw, start: float, duration: float, added: AddedMass) -> Log:
        """Return the log of ``duration`` s from rest at the angle ``start``, carrying ``added``.

        A robot that cannot be held at an angle may start from where it hangs.
        """


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """What each round does, whatever orbit it holds.

    Parameters
    ----------
    multiplier
        Wanted Floquet multiplier, the share of a perturbation that is left after one period; sets
        gamma.
    duration
        Of each run in s.
    starts
        Angles in rad from which a run of each round starts; the amplitude is measured in the
        first.
    orbits
        Amplitudes in rad of further orbits, held in a run each.
    dither
        Share of the control's rms added to all runs but the first, at random.
    added_masses
        Which of them each run is made with; with two different ones the scale becomes known. The
        first is the one that the controller is for.
    kick
        See `EnergyShaping`.
    rounds
        At most so many.
    amplitude_tolerance
        In rad; the loop ends when the amplitude is off by less.
    parameter_tolerance
        The loop ends, too, when no parameter changes by more than this share.
    """

    multiplier: float = 0.5
    duration: float = 20.0
    starts: tuple[float, ...]
    orbits: tuple[float, ...] = ()
    dither: float = 0.0
    added_masses: tuple[AddedMass, ...] = (NO_ADDED_MASS,)
    kick: float = 0.0
    rounds: int = 4
    amplitude_tolerance: float = 3.5e-3
    parameter_tolerance: float = 1e-3

    def __post_init__(self) -> None:
        require_number(
            "Schedule",
            dither=self.dither,
            kick=self.kick,
            amplitude_tolerance=self.amplitude_tolerance,
            parameter_tolerance=self.parameter_tolerance,
        )
        require_number(
            "Schedule",
            positive=True,
            duration=self.duration,
            rounds=self.rounds,
            starts=len(self.starts),
            added_masses=len(self.added_masses),
        )
        if not 0 < self.multiplier < 1:
            raise InputError("Schedule", "multiplier", self.multiplier, "between 0 and 1")


@dataclass(frozen=True, kw_only=True)
class Plan(Schedule):
    """A schedule for an orbit.

    Parameters
    ----------
    target
        From parameters to the orbit that is to be held.
    velocity
        From parameters to an estimator.
    """

    target: Target
    velocity: Callable[[LumpedParameters], VelocityEstimator] = lambda _: FilteredDifference()

    def law(self, orbit: Orbit, zero: float) -> EnergyShaping:
        """Return a fresh controller for an orbit, its encoder reading ``zero`` rad at angle 0."""
        return EnergyShaping(
            orbit,
            gain_for(orbit, self.multiplier),
            zero=zero,
            velocity=self.velocity(orbit.parameters),
            kick=self.kick,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Round:
    """One turn of the loop.

    Parameters
    ----------
    believed
        Parameters of the hand with what it carries, that the controller went by.
    orbit, gamma
        Its target and gain.
    logs
        What it recorded, the nominal run first.
    starts
        How many of them, from the first on, hold the target's orbit.
    amplitude
        That the nominal run came to, in rad; NaN if it turned over.
    recalibration
        From the logs.
    """

    believed: LumpedParameters
    orbit: Orbit
    gamma: float
    logs: tuple[Log, ...]
    starts: int
    amplitude: float
    recalibration: Recalibration

    @property
    def wanted(self) -> float:
        """Amplitude of the target, in rad."""
        return 0.5 * (self.orbit.upper - self.orbit.lower)

    @property
    def amplitude_error(self) -> float:
        """Amplitude less that of the target, in rad."""
        return self.amplitude - self.wanted


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """What the loop came to.

    Parameters
    ----------
    rounds
        In order.
    ending
        Why it ended, in words.
    """

    rounds: tuple[Round, ...]
    ending: str

    @property
    def parameters(self) -> LumpedParameters:
        """What the last round's logs say of the hand with what it carries."""
        last = self.rounds[-1]
        return last.recalibration.loaded(last.logs[0].added_mass, last.believed.p1)


def calibrate(
    rig: RunLaw,
    believed: LumpedParameters,
    zero: float,
    plan: Plan,
    options: RecalibrationOptions = RecalibrationOptions(),
    *,
    rng: np.random.Generator,
    track: Track = untracked,
) -> Calibration:
    """Hold the orbit, re-calibrate next to it, and hold it better.

    Parameters
    ----------
    rig
        The robot.
    believed
        Parameters of the bare hand to begin with, from small swings say.
    zero
        Encoder reading in rad of the hanging hand.
    plan, options
        What each round does, and how it re-calibrates.
    rng
        Source of the dither.
    track
        Shows progress.

    Raises
    ------
    IdentifiabilityError
        If a round's logs cannot tell the parameters apart.
    InputError
        If no controller can be built on ``believed``.
    """
    require_number("believed parameters", positive=True, p1=believed.p1, p4=believed.p4)
    loaded = {mass: believed.with_added_mass(mass) for mass in plan.added_masses}
    rounds: list[Round] = []
    ending = f"{plan.rounds} rounds were made"
    for _ in track(range(plan.rounds), "Calibrating"):
        last = _round(rig, loaded, zero, plan, options, rng=rng)
        rounds.append(last)
        before, found = last.believed, last.recalibration
        loaded = {mass: found.loaded(mass, before.p1) for mass in plan.added_masses}
        if abs(last.amplitude_error) <= plan.amplitude_tolerance:
            ending = "the amplitude is within its bound"
            break
        if _largest_change(before, loaded[plan.added_masses[0]]) <= plan.parameter_tolerance:
            ending = "the parameters no longer change"
            break
    return Calibration(rounds=tuple(rounds), ending=ending)


def _round(
    rig: RunLaw,
    loaded: dict[AddedMass, LumpedParameters],
    zero: float,
    plan: Plan,
    options: RecalibrationOptions,
    *,
    rng: np.random.Generator,
) -> Round:
    """Run the controller from every start, on every orbit, with every added mass; re-calibrate."""
    logs: list[Log] = []
    for added, model in loaded.items():
        runs = [(start, plan.target(model)) for start in plan.starts]
        runs += [(each, Orbit.of_amplitude(model, each)) for each in plan.orbits]
        for start, orbit in runs:
            law: ControlLaw = plan.law(orbit, zero)
            if plan.dither > 0 and logs:
                law = Dithered(law, plan.dither, 2 * math.pi / orbit.period, rng)
            logs.append(rig(law, start, plan.duration, added))
    believed = loaded[plan.added_masses[0]]
    nominal, first = plan.target(believed), logs[0]
    since = first.time[0] + _SETTLED * (first.time[-1] - first.time[0])
    return Round(
        believed=believed,
        orbit=nominal,
        gamma=gain_for(nominal, plan.multiplier),
        logs=tuple(logs),
        starts=len(plan.starts),
        amplitude=swing(first, zero, since),
        recalibration=recalibrate(logs, zero, options),
    )


def _largest_change(before: LumpedParameters, after: LumpedParameters) -> float:
    """Largest relative change of p2, p3, p4 over p1, and of Coulomb torque over p1."""
    pairs: list[tuple[float, float]] = [
        (getattr(before, name) / before.p1, getattr(after, name) / after.p1)
        for name in ("p2", "p3", "p4", "coulomb")
    ]
    return max(abs(new - old) / max(abs(new), abs(old), 1e-12) for old, new in pairs)
