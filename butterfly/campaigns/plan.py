"""What the runs so far tell of a joint, whether they are sound, and those that could follow."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.campaigns.bench import ENOUGH, LAG, RESERVE, STILL, Bench, Law, Relay, Signal
from butterfly.campaigns.drive import DriveFault, SafetyStop
from butterfly.campaigns.folder import Folder, Step, log_name
from butterfly.campaigns.guard import SOFT, Expected, Limits
from butterfly.errors import ButterflyError, IdentifiabilityError
from butterfly.identification.consistency import with_scale
from butterfly.identification.data import DataSet
from butterfly.identification.design import OF_GOAL, expected_log, wanted
from butterfly.identification.estimate import Estimate
from butterfly.identification.identified import Identified
from butterfly.identification.identify import identify
from butterfly.identification.repeatability import Contradiction, contradiction_text
from butterfly.identification.trust import MATTERS
from butterfly.logs.log import InputKind, Log, Sine
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import Prior
from butterfly.model.terms import IDEAL
from butterfly.plant.joints import GreyBoxJoint
from butterfly.plant.motor import CommandPath
from butterfly.plant.rig import SimulatedMotor
from butterfly.plant.robot import Robot
from butterfly.plant.sensors import FINEST, Encoder
from butterfly.signals.excitations import Excitation, Multisine
from butterfly.verdict import Level

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


_BRAKES = 0.5  # of the deceleration that the model gives a brake, which is certain
_LEAST = 1e-9  # of a half-width, that counts as wanted of a value that is 0
_ZERO = 0.5  # rad from where a joint rests, within which it may hang


class Knowledge:
    """What was identified from the runs in a folder, and what follows for the next one."""

    def __init__(
        self,
        bench: Bench,
        folder: Folder,
        goal: float,
        masses: Sequence[AddedMass],
        known: Mapping[str, Any],
    ) -> None:
        self._bench, self._folder, self._goal = bench, folder, goal
        self._several, self._known = len(masses) > 1, known
        self.model: Identified | None = None

    def identify(self) -> None:
        """Identify the joint from all runs so far."""
        self.model = self.identified()

    def expected(self, mass: AddedMass) -> Expected | None:
        """Return what the model says of the joint with a mass; None while there is none."""
        if self.sound is None:
            return None
        loaded, stiffness = self.sound.parameters.with_added_mass(mass), None
        is_known = self.is_known(mass)
        brake = self._bench.braking * loaded.p4 / loaded.p1 if is_known else 0.0
        if is_known and not self._bench.is_loaded_anew:
            stiffness = max(loaded.p3, 0.0) / loaded.p1
        runs = self._folder.journal.steps
        names = [log_name(k) for k, step in enumerate(runs) if step.added_mass == mass]
        home = self._bench.home
        zeros = [self.sound.zeros[name] for name in names if name in self.sound.zeros]
        near = [zero for zero in zeros if abs(zero - home) < _ZERO]  # of this start of the encoder
        return Expected(
            resonance=self._resonance(mass),
            friction=least_friction(self.sound.estimate, mass),
            brake=_BRAKES * brake,
            stiffness=stiffness,
            hanging=near[-1] if near else home,
            delay=max(loaded.delay, 0.0),
        )

    def damping(self, model: Identified, mass: AddedMass, size: float) -> tuple[float, float]:
        """Return speed in rad/s and angle in rad from which a critically damped brake is full."""
        loaded, near = model.parameters.with_added_mass(mass), self._bench.near
        torque = size * loaded.p4
        damping = 2 * math.sqrt(loaded.p1 * max(loaded.p3 + torque / near, 0.0))
        return torque / (damping + LAG * torque / near), near

    def is_known(self, mass: AddedMass) -> bool:
        """Whether the model is of the joint with this mass, too."""
        return not self.is_open or any(e.added_mass == mass for e in self._folder.journal.steps)

    def _resonance(self, mass: AddedMass) -> float:
        """Return the least resonance in rad/s with a mass; with one not used yet an upper bound.

        It lies between that with the last mass and that of what is added, by itself.
        """
        assert self.sound is not None  # noqa: S101 - see `expected`
        last = self._folder.journal.steps[-1].added_mass
        more = np.subtract(mass.inertia_and_moment, last.inertia_and_moment)
        alone = math.sqrt(max(more[1] / more[0], 0.0)) if more[0] > 0 else math.inf
        known = self.is_known(mass)
        estimate, p3 = self.sound.estimate, self.sound.parameters.p3
        lower, _ = estimate.limits_of("p3", p3)
        least = replace(estimate.parameters, p3=max(lower, p3 / 2))  # as little as holds it back
        resonance = resonance_frequency(least.with_added_mass(mass if known else last))
        return resonance if known else max(resonance, alone)

    def identified(self, runs: slice | None = None) -> Identified | None:
        """Identify from all logs so far, or some; None if they do not determine the parameters.

        While the scale is open, p1 is held at 1: all others are ratios to it.
        """
        data, steps = self._folder.data(runs), self._folder.journal.steps
        if self._leaves_open(steps if runs is None else steps[runs]):
            data = data.knowing(Prior.of({"p1": 1.0}))
        try:
            identified = identify(data)
        except ButterflyError:
            return None
        return identified if min(identified.parameters.p1, identified.parameters.p4) > 0 else None

    @property
    def sound(self) -> Identified | None:
        """What was identified, if it may be used."""
        model = self.model
        used = model is not None and model.estimate.level is not Level.WARNING
        return model if used else None

    @property
    def is_open(self) -> bool:
        """Whether the runs so far leave the scale open."""
        return self._leaves_open(self._folder.journal.steps)

    def _leaves_open(self, steps: Sequence[Step]) -> bool:
        """Whether some runs leave the scale open."""
        try:
            with_scale({step.added_mass for step in steps}, Prior.of(self._known))
        except IdentifiabilityError:
            return True
        return False

    def wanted(self, model: Identified) -> Samples:
        """Return (n,) half-widths that the goal asks for."""
        open_ = self.is_open and self._several
        return wanted(model.estimate, model.data.logs, self._goal, scale_open=open_)

    @property
    def shares(self) -> dict[str, float]:
        """Half-widths over those that are wanted, by name."""
        model = self.model
        if model is None:
            return {}
        widths = np.minimum(model.estimate.farther, 1e300)
        shares = widths / np.maximum(self.wanted(model), _LEAST * widths)
        pairs = zip(model.estimate.names, shares.tolist(), strict=True)
        return {name: share for name, share in pairs if name in OF_GOAL}

    @property
    def is_reached(self) -> bool:
        """Whether all half-widths are as wanted, under a verdict *good*."""
        model = self.model
        good = model is not None and model.estimate.level is Level.GOOD
        return good and max(self.shares.values(), default=0.0) <= 1


_SLIPS = 2.0  # widths of the band in which friction holds a joint, within which it may rest


class Rests:
    """Where the joint rests with each mass."""

    def __init__(self) -> None:
        self._first: dict[AddedMass, float] = {}  # angle in rad of the first rest

    def take(self, mass: AddedMass, rest: float) -> None:
        """Take where the joint rested with a mass, in rad, in a former session."""
        self._first.setdefault(mass, rest)

    def require_no_slip(self, rest: float, mass: AddedMass, model: Identified | None) -> None:
        """Raise `SafetyStop` if the joint rests where gravity and friction do not let it.

        ``rest`` in rad; without a usable model, any rest is accepted.
        """
        first = self._first.setdefault(mass, rest)
        if model is None:
            return
        estimate = model.estimate
        least, _ = estimate.limits_of("p3", estimate.parameters.p3)
        loaded = replace(estimate.parameters, p3=least).with_added_mass(mass)
        _, most = estimate.limits_of("coulomb", loaded.coulomb)
        width = 2 * most / loaded.p3 if loaded.p3 > 0 else math.inf
        if abs(rest - first) > _SLIPS * width + ENOUGH:
            raise SafetyStop(
                f"the joint rests {abs(rest - first):.3g} rad from its first rest position, but "
                f"friction explains only {width:.2g} rad: the encoder slips or has another zero, "
                "or the mount moved; put it back, or begin in a new folder"
            )


def require_changed(
    before: Identified | None, old: Step, new: Step, alone: Callable[[], Identified | None]
) -> None:
    """Raise `SafetyStop` if the first run after a change of mass shows the joint as it was.

    ``before``: what was identified before the ``new`` run; ``alone``: identifies from that run.
    Ratios to the inertia are compared. Where the scale is known, a mass that should change them by
    too little to be seen passes.
    """
    if before is None or old.added_mass == new.added_mass:
        return
    was = _ratios(before, old)
    expected = _ratios(before, new) if "p1" in before.estimate.names else math.inf
    if np.max(np.abs(expected / was - 1)) < 2 * MATTERS or (model := alone()) is None:
        return
    if np.max(np.abs(_ratios(model, new) / was - 1)) <= MATTERS:
        raise SafetyStop(
            f"the joint moves as it did with {old.added_mass}: {new.added_mass} is not mounted, or "
            "is too small for this joint to make a difference"
        )


def require_repeated(contradiction: Contradiction | None) -> None:
    """Raise `SafetyStop` where two runs of one mass contradict each other."""
    if contradiction is not None:
        raise SafetyStop(contradiction_text(contradiction.finding))


def _ratios(model: Identified, step: Step) -> Samples:
    """Return (2,) gravity moment and gain over the inertia, with the mass of a run."""
    loaded = model.parameters.with_added_mass(step.added_mass)
    return np.array([loaded.p3, loaded.p4]) / loaded.p1
