"""Runs that a campaign can play, and what the model makes of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from butterfly.campaigns.bench import Bench
from butterfly.campaigns.drive import DriveFault
from butterfly.campaigns.guard import SOFT, Expected, Limits
from butterfly.campaigns.laws import RESERVE, STILL, Law, Relay, Signal
from butterfly.identification.data import DataSet
from butterfly.identification.design import expected_log
from butterfly.identification.estimate import Estimate
from butterfly.logs.log import InputKind, Log, Sine
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import IDEAL
from butterfly.plant.joints import GreyBoxJoint
from butterfly.plant.motor import CommandPath
from butterfly.plant.rig import SimulatedMotor
from butterfly.plant.robot import Robot
from butterfly.plant.sensors import FINEST, Encoder
from butterfly.signals.excitations import Excitation, Multisine

PROBE = 12.5
"""Length in s of a run with a joint that is not known yet."""

_PERIODS = 8  # of the resonance, in a run
_SHORTEST, _LONGEST = 5.0, 30.0  # s of a run
_DRIVEN = 2 / 3  # share of a relay's run in which it drives
_REACHES = (0.3, 0.6, 1.0)  # of the allowed swing
_TONES = (0.6, 0.8, 1.25, 1.6, 2.5)  # of the resonance
_HOLDS = 0.25  # of the largest command, that holds a joint at the largest angle if gravity does not
_MOVES = 1.2  # times the command that moved the joint, that moves it for certain
_STEP = 0.004  # s, of the model's cycle


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """A run that can be played: on the robot, and on the model before."""

    what: str  # in words
    kind: str  # of the same, whatever the estimate: how far it reaches, at which tone
    added_mass: AddedMass
    duration: float  # s
    law: Callable[[float], Law]  # for a rest angle in rad
    reach: float | None = None  # rad, beyond which the run ends; None: at the limit
    signal: Excitation | None = None  # that the law follows


def probe(mass: AddedMass, size: float, limits: Limits, duration: float) -> Recipe:
    """Return a relay of little reach, for a joint that is not known yet."""
    reach = limits.angle * RESERVE * _REACHES[0]
    return replace(_relay(mass, reach, size, limits, duration), reach=RESERVE * limits.angle)


def _relay(mass: AddedMass, reach: float, size: float, limits: Limits, duration: float) -> Recipe:
    driven = _DRIVEN * duration
    return Recipe(
        what=f"relay of {reach:.2g} rad for {driven:.3g} s, then free",
        kind=f"relay of {reach:.2g} rad",
        added_mass=mass,
        duration=duration,
        law=lambda rest: Relay(rest, reach, size, RESERVE * limits.command, driven),
    )


def _signal(kind: str, what: str, mass: AddedMass, duration: float, signal: Excitation) -> Recipe:
    return Recipe(
        what=what,
        kind=kind,
        added_mass=mass,
        duration=duration,
        law=lambda _: Signal(lambda time: float(signal.sample(np.array([time]))[0])),
        signal=signal,
    )


def validation(
    estimate: Estimate,
    mass: AddedMass,
    limits: Limits,
    input_kind: InputKind,
    breakaway: float = 0.0,
) -> Recipe:
    """Return a sum of sines about the joint's pace, unlike all that is fitted.

    ``breakaway``: the command that moves the joint from rest, which its peak exceeds.
    """
    loaded = estimate.parameters.with_added_mass(mass)
    pace = _pace(loaded, limits)
    reach = RESERVE * limits.angle * _REACHES[0]
    peak = 2 * loaded.coulomb / abs(loaded.p4) + _static(loaded, reach, limits)
    peak = max(peak, _MOVES * breakaway)
    lines, base = (5, 8, 11, 17, 23), pace / 10
    signal = Multisine(base=base, harmonics=lines, peak=min(peak, RESERVE * limits.command))
    what = f"multisine about {pace:.3g} rad/s, peak {signal.peak:.2g} {input_kind.unit}"
    return _signal("multisine", what, mass, duration_of(estimate.parameters, mass, limits), signal)


def _held(loaded: LumpedParameters, limits: Limits) -> float:
    """Return the stiffness in the unit of p3 by which a share of the largest command holds it."""
    return _HOLDS * abs(loaded.p4) * limits.command / limits.angle


def _pace(loaded: LumpedParameters, limits: Limits) -> float:
    """Return the frequency in rad/s that runs are planned about: the resonance, if it has one."""
    return max(resonance_frequency(loaded), math.sqrt(_held(loaded, limits) / loaded.p1))


def least_friction(estimate: Estimate, mass: AddedMass) -> float:
    """Return half the lower limit of Coulomb friction over the inertia, in rad/s^2."""
    lower, _ = estimate.limits_of("coulomb", 0.0)
    return float(max(lower, 0.0) / 2 / estimate.parameters.with_added_mass(mass).p1)


def duration_of(parameters: LumpedParameters, mass: AddedMass, limits: Limits) -> float:
    """Return the length in s of a run: some periods of the joint's pace."""
    pace = _pace(parameters.with_added_mass(mass), limits)
    return STILL + min(max(_PERIODS * math.tau / pace, _SHORTEST), _LONGEST)


def candidates(
    estimate: Estimate,
    mass: AddedMass,
    limits: Limits,
    input_kind: InputKind,
    breakaway: float = 0.0,
) -> list[Recipe]:
    """Propose relays of several reaches, and sines on both sides of the joint's pace.

    ``breakaway``: the command that moves the joint from rest, below which a sine may not move it:
    friction at rest may be more than the model's.
    """
    loaded = estimate.parameters.with_added_mass(mass)
    duration = duration_of(estimate.parameters, mass, limits)
    pace = _pace(loaded, limits)
    reaches = [limits.angle * RESERVE * share for share in _REACHES]
    dry = loaded.coulomb / abs(loaded.p4)
    recipes = [
        _relay(mass, reach, 2 * dry + _static(loaded, reach / 4, limits), limits, duration)
        for reach in reaches
    ]
    for tone in _TONES:
        omega = tone * pace
        for reach in reaches[1:]:
            force = math.hypot(loaded.p3 - loaded.p1 * omega**2, loaded.p2 * omega) * reach / 2
            amplitude = force / abs(loaded.p4) + 4 / math.pi * dry
            if _MOVES * breakaway <= amplitude <= RESERVE * limits.command:
                kind = f"sine at {tone:g} of the resonance, of {reach:.2g} rad"
                what = f"sine of {omega:.3g} rad/s, amplitude {amplitude:.2g} {input_kind.unit}"
                sine = Sine(omega=omega, amplitude=amplitude)
                recipes.append(_signal(kind, what, mass, duration, sine))
    return recipes


def _static(loaded: LumpedParameters, angle: float, limits: Limits) -> float:
    """Return the command that holds an angle in rad, or swings so far if gravity does not hold."""
    return max(loaded.p3, _held(loaded, limits)) * angle / abs(loaded.p4)


def played(
    data: DataSet, estimate: Estimate, recipe: Recipe, limits: Limits, expected: Expected
) -> Log | None:
    """Play a recipe on the model of some data; None if it leaves the limits.

    ``expected``: what the guard goes by when the recipe is played with its mass.
    """
    parameters, mass = estimate.parameters, recipe.added_mass
    if recipe.signal is not None:
        log = expected_log(data, parameters, mass, recipe.signal, recipe.duration)
        speed = np.gradient(log.measured, log.time)
        swings = map(expected.swing, log.measured.tolist(), speed.tolist())
        fast = np.max(np.abs(speed))
        within = fast <= SOFT * limits.speed and max(swings) <= SOFT * limits.angle
        return log if within else None
    plain = replace(parameters, delay=0.0, **vars(IDEAL))
    motor = SimulatedMotor(
        GreyBoxJoint(Robot.of_lumped(plain), mass),
        path=CommandPath(delay=max(parameters.delay, 0.0), **vars(parameters.drive)),
        encoder=Encoder(steps=FINEST),
    )
    try:
        with Bench(motor, limits, _STEP) as bench:
            bench.expect(replace(expected, stiffness=None))
            run = bench.run(recipe.law(0.0), recipe.duration)
    except DriveFault as fault:  # no drive's: the model's
        raise fault.__cause__ or fault from None
    return None if run.cut else run.log(added_mass=mass)
