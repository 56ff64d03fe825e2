"""Physical and lumped parameters of the hand, its motor and its add-on masses."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property, total_ordering
from typing import Any, ClassVar

from butterfly.errors import InputError, require_number
from butterfly.model.terms import (
    CONSERVATIVE,
    TERMS,
    BaseTerms,
    DriveTerms,
    FrictionTerms,
    LoopTerms,
    Motion,
    torque_of,
)

GRAVITY = 9.81
"""Acceleration due to gravity in m/s^2, the thesis's value (61)."""


@dataclass(frozen=True, kw_only=True)
class Hand:
    """The rigid hand with the rotor of its motor."""

    mass: float
    """m_p in kg."""
    com_distance: float
    """l_c, pivot to centre of mass along the line to the added mass, in m; negative if it lies
    above the pivot at angle 0."""
    com_offset: float = 0.0
    """Distance in m of the centre of mass from that line, towards positive angles."""
    inertia: float
    """J_p about the centre of mass, in kg m^2."""
    tilt: float = 0.0
    """Angle in rad of the axis out of the horizontal; gravity then acts with its cosine."""

    def __post_init__(self) -> None:
        require_number("Hand", positive=True, mass=self.mass)
        for name in ("com_distance", "com_offset"):
            if not math.isfinite(getattr(self, name)):
                raise InputError("Hand", name, getattr(self, name), "a finite number of m")
        require_number("Hand", positive=True, inertia=self.inertia)
        if not abs(self.tilt) < math.pi / 2:
            raise InputError("Hand", "tilt", self.tilt, "less than pi/2 rad either way")


@dataclass(frozen=True, kw_only=True)
class VoltageDrive:
    """A DC motor fed with a voltage (4)."""

    resistance: float
    """R in Ohm."""
    torque_constant: float
    """k_i in N m/A."""
    back_emf_constant: float
    """k_emf in V s/rad; equal to k_i in SI units for a lossless motor."""
    inductance: float = 0.0
    """L in H; 0 lets the current follow at once, as (5) does."""

    def __post_init__(self) -> None:
        require_number("VoltageDrive", positive=True, resistance=self.resistance)
        require_number("VoltageDrive", positive=True, torque_constant=self.torque_constant)
        require_number("VoltageDrive", back_emf_constant=self.back_emf_constant)
        require_number("VoltageDrive", inductance=self.inductance)

    @property
    def gain(self) -> float:
        """p4 = k_i / R in N m/V (6)."""
        return self.torque_constant / self.resistance

    @property
    def damping(self) -> float:
        """The back-EMF's share k_emf k_i / R of p2, in N m s/rad (6)."""
        return self.back_emf_constant * self.gain

    @property
    def time_constant(self) -> float:
        """Time L/R in s in which the current follows the voltage."""
        return self.inductance / self.resistance


@dataclass(frozen=True, kw_only=True)
class TorqueDrive:
    """A current-controlled motor: the command sets the torque and no back EMF is felt."""

    gain: float
    """p4 in N m per unit of command."""

    damping: ClassVar[float] = 0.0  # a current loop adds none,
    time_constant: ClassVar[float] = 0.0  # and is taken to be fast

    def __post_init__(self) -> None:
        require_number("TorqueDrive", positive=True, gain=self.gain)


Drive = VoltageDrive | TorqueDrive


@dataclass(frozen=True, kw_only=True)
class Friction(FrictionTerms):
    """Friction at the pivot, all terms (see `FrictionTerms`)."""

    viscous: float = 0.0
    """k_f in N m s/rad."""

    def __post_init__(self) -> None:
        require_number("Friction", viscous=self.viscous)
        require_number("Friction", positive=True, stribeck_velocity=self.stribeck_velocity)
        for name, value in self.terms().items():
            if TERMS[name].lower == 0:
                require_number("Friction", **{name: value})
            elif not math.isfinite(value):
                raise InputError("Friction", name, value, "a finite number")
        require_periods("Friction", self.cogging_periods)
        if self.bristle_stiffness > 0 and not self.coulomb > 0:
            raise InputError(
                "Friction", "coulomb", self.coulomb, "more than 0, for bristles to bend"
            )
        if self.bristle_stiffness > 0 and (self.geared or self.coulomb_slope):
            found = f"{self.bristle_stiffness:g} N m/rad"
            expected = "0: bristles with friction that torque or angle change are not simulated"
            raise InputError("Friction", "bristle_stiffness", found, expected)


@dataclass(frozen=True, kw_only=True)
class Base:
    """What the joint stands on: a mass on a horizontal spring and damper (see `BaseTerms`)."""

    compliance: float
    """Of the spring, in m/N."""
    frequency: float
    """Natural frequency in rad/s of the base with the bare hand."""
    damping: float
    """Its damping ratio."""

    def __post_init__(self) -> None:
        require_number("Base", positive=True, compliance=self.compliance, frequency=self.frequency)
        require_number("Base", damping=self.damping)

    @property
    def mass(self) -> float:
        """M_0 in kg of the base with the bare hand."""
        return 1 / (self.compliance * self.frequency**2)

    @property
    def friction(self) -> float:
        """C in N s/m of its damper."""
        return 2 * self.damping * self.frequency * self.mass

    def terms(self) -> dict[str, float]:
        """Return its terms by name."""
        return {f"base_{name}": value for name, value in vars(self).items()}


def require_periods(source: str, periods: float) -> None:
    """Raise InputError unless periods of cogging in a turn are 1, 2, 3, and so on."""
    if not (periods >= 1 and float(periods).is_integer()):
        raise InputError(source, "cogging_periods", periods, "1, 2, 3, ...")


class JointKind(StrEnum):
    """How a joint moves: a slide's angle is a way in m, its inertia a mass, its torque a force."""

    HINGE = "hinge"
    SLIDE = "slide"

    @property
    def way(self) -> str:
        """Unit of what is called its angle."""
        return "m" if self is JointKind.SLIDE else "rad"


def rounded(value: float) -> float:
    """Return a mass or an arm to the six digits by which equal ones are grouped, and printed."""
    return float(f"{value:g}")


@total_ordering
@dataclass(frozen=True, kw_only=True, eq=False)
class AddedMass:
    """A mass screwed to the hand; equal to others by its `key`, whatever is uncertain of it.

    Parameters
    ----------
    mass
        m_a in kg.
    arm
        l_a, pivot to mass, in m; 0 for no mass, and on a slide.
    own_inertia
        About its own centre of mass, in kg m^2: 0 for a point; a disc of radius r has m r^2/2. None
        on a slide.
    mass_uncertainty, arm_uncertainty
        Standard uncertainties, in kg and m.
    gravity
        In m/s^2, across the axis: 0 for a joint that turns about the vertical.
    joint
        What carries it.
    """

    mass: float = 0.0
    arm: float = 0.0
    own_inertia: float = 0.0
    mass_uncertainty: float = 0.0
    arm_uncertainty: float = 0.0
    gravity: float = GRAVITY
    joint: JointKind = JointKind.HINGE

    def __post_init__(self) -> None:
        placed = {name: getattr(self, name) for name in ("arm", "arm_uncertainty", "own_inertia")}
        require_number("AddedMass", mass=self.mass, **placed)
        require_number("AddedMass", mass_uncertainty=self.mass_uncertainty, gravity=self.gravity)
        for name in ("mass", "mass_uncertainty", "gravity", *placed):
            object.__setattr__(self, name, float(getattr(self, name)))  # of NumPy's, too
        if self.joint is JointKind.SLIDE:
            object.__setattr__(self, "gravity", 0.0)
        if self.mass == 0 or self.joint is JointKind.SLIDE:
            for name in placed:
                object.__setattr__(self, name, 0.0)

    @cached_property
    def key(self) -> tuple[float, float, float, float, JointKind]:
        """Mass, arm, own inertia, gravity (rounded) and joint: the same in every spelling."""
        numbers = (self.mass, self.arm, self.own_inertia, self.gravity)
        mass, arm, inertia, gravity = map(rounded, numbers)
        return mass, arm, inertia, gravity, self.joint

    def __eq__(self, other: object) -> bool:
        return self.key == other.key if isinstance(other, AddedMass) else NotImplemented

    def __lt__(self, other: Any) -> bool:  # noqa: ANN401 - whatever is compared
        return self.key < other.key if isinstance(other, AddedMass) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def inertia(self) -> float:
        """Z = m_a l_a^2 in kg m^2 (81), and its own inertia; on a slide m_a in kg."""
        if self.joint is JointKind.SLIDE:
            return self.mass
        return self.mass * self.arm**2 + self.own_inertia

    @property
    def swung(self) -> float:
        """m_a l_a^2 in kg m^2, of a point; on a slide m_a in kg."""
        return self.inertia - self.own_inertia

    @property
    def weight(self) -> float:
        """m_a g in N, which rests on the bearing whatever the direction of the axis."""
        return self.mass * (self.gravity or GRAVITY)

    @property
    def gravity_moment(self) -> float:
        """X = m_a g l_a in N m (81)."""
        return self.mass * self.gravity * self.arm

    @property
    def inertia_and_moment(self) -> tuple[float, float]:
        """Z and X (81) of the `key`: what motion shows of it, friction by its weight aside."""
        mass, arm, own, gravity, joint = self.key
        inertia = mass if joint is JointKind.SLIDE else mass * arm**2 + own
        return rounded(inertia), rounded(mass * gravity * arm)

    def __str__(self) -> str:
        if not self.mass:
            return "no added mass"
        if self.joint is JointKind.SLIDE:
            return f"{1e3 * self.mass:g} g"
        own = f" with {self.own_inertia:g} kg m²" if self.own_inertia else ""
        return f"{1e3 * self.mass:g} g at {1e3 * self.arm:g} mm{own}"


NO_ADDED_MASS = AddedMass()
"""The bare hand."""


@dataclass(frozen=True, kw_only=True)
class LumpedParameters(FrictionTerms, DriveTerms, LoopTerms, BaseTerms):
    """The grey-box model (5), with tau_eps and the drive's lags written out.

        p1 thdd + p2 thd + p3 sin th + p3_offset cos th + friction = p4 v(t - delay) + pulls

    `FrictionTerms` says what friction and pulls are, `DriveTerms` what v is of a command,
    `LoopTerms` what a servo's loop makes of one, `BaseTerms` what it stands on. p3 may be negative:
    a hand whose centre of mass lies above the pivot when the added mass hangs down.

    Parameters
    ----------
    p1
        Inertia about the pivot in kg m^2.
    p2
        Viscous friction and back EMF in N m s/rad.
    p3
        Gravity moment in N m.
    p4
        N m per unit of input (per volt, or per unit of torque command).
    p3_offset
        Gravity moment in N m of a centre of mass beside the line from pivot to added mass.
    tilt
        Angle in rad of the axis out of the horizontal, which takes its cosine from the gravity
        moment of added masses; p3 and p3_offset are what is left of the hand's.
    delay
        From recorded input to torque, in s.
    slow_delay, slow_interval
        What is added to the delay, in s, where the mean sampling interval of a log's clock is above
        the other, in s (see `butterfly.logs.regimes`).
    back_emf
        The back EMF's share k_emf k_i/R of p2, in N m s/rad; it counts only with the next.
    time_constant
        Of the armature, L/R in s: the motor's torque p4 v - back_emf thd then follows with this
        lag. 0 is the reduced model (5).
    gravity
        That p3 and p3_offset are moments of, in m/s^2.
    carried_moment
        Moment m l in kg m of added masses that gravity does not pull at.
    """

    p1: float
    p2: float
    p3: float
    p4: float
    p3_offset: float = 0.0
    tilt: float = 0.0
    delay: float = 0.0
    slow_delay: float = 0.0
    slow_interval: float = 0.0
    back_emf: float = 0.0
    time_constant: float = 0.0
    gravity: float = GRAVITY
    carried_moment: float = 0.0

    @property
    def moments(self) -> tuple[float, float]:
        """First moments in kg m of what swings, on and beside the line to the added mass."""
        return first_moments(self)

    @property
    def on_base(self) -> dict[str, Any]:
        """What a `Motion` tells of the base that gives under this."""
        return {"moment": self.moments[0], "base": (self.base_frequency, self.base_damping)}

    def motion(self, angle: Any, velocity: Any, **more: Any) -> Motion:  # noqa: ANN401 - numbers, or arrays
        """Return a motion in rad and rad/s of the joint under its load, and ``more`` of it."""
        moving = super().motion(angle, velocity, **more)
        if not self.geared:
            return moving
        load = -torque_of(self, moving, CONSERVATIVE)
        return super().motion(angle, velocity, load=load, **more)

    def require_gain(self, source: str) -> None:
        """Raise InputError if nothing drives the joint: p4 stands at 0."""
        if self.p4 == 0:
            expected = "the gain of a drive: from a log of the driven joint, or known: {p4: ...}"
            raise InputError(source, "p4", "0, as nothing drives the joint", expected)

    def with_added_mass(self, added: AddedMass) -> LumpedParameters:
        """Return the parameters of the hand carrying ``added`` (78), its weight on the bearing."""
        return replace(self, **dict(zip(UNDER_LOAD, under(self, added), strict=True)))


UNDER_LOAD = (
    *("p1", "p3", "coulomb", "drag"),
    *("base_frequency", "base_damping", "gravity", "carried_moment"),
)
"""Parameters that an added mass changes: what `under` returns."""


def under(p: Any, added: Any) -> tuple[float, ...]:  # noqa: ANN401 - also translated, for a page
    """Return the parameters of the joint under ``added``, whose mass moves with a base."""
    slower = math.sqrt(1 + p.base_frequency**2 * p.base_compliance * added.mass)
    return (
        p.p1 + added.inertia + p.mass_inertia * added.swung,
        p.p3 + added.gravity_moment * math.cos(p.tilt),
        p.coulomb + p.load * added.weight,
        p.drag + p.load_drag * added.mass,
        p.base_frequency / slower,
        p.base_damping / slower,
        added.gravity,
        p.carried_moment + added.mass * added.arm,
    )


def first_moments(p: Any) -> tuple[float, float]:  # noqa: ANN401
    """Return the first moments in kg m of what swings (see `LumpedParameters.moments`)."""
    if p.gravity == 0:
        return p.carried_moment, 0.0
    return p.p3 / p.gravity, p.p3_offset / p.gravity
