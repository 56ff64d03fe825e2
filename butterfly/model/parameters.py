"""Physical and lumped parameters of the joint, its motor and its added masses."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property, total_ordering
from typing import Any, ClassVar, NamedTuple

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
    """The rigid body that the joint moves, with the rotor of its motor."""

    mass: float
    """m_p in kg."""
    com_distance: float
    """l_c, pivot to centre of mass along the line to the added mass, in m; negative if above the
    pivot at angle 0."""
    com_offset: float = 0.0
    """Distance in m of the centre of mass from that line, towards positive angles."""
    inertia: float
    """J_p about the centre of mass, in kg m^2."""
    tilt: float = 0.0
    """Angle in rad of the axis from the horizontal; gravity acts with its cosine."""

    def __post_init__(self) -> None:
        require_number("Hand", positive=True, mass=self.mass)
        for name in ("com_distance", "com_offset"):
            if not math.isfinite(getattr(self, name)):
                raise InputError("Hand", name, getattr(self, name), "a finite number of m")
        require_number("Hand", positive=True, inertia=self.inertia)
        if not abs(self.tilt) < math.pi / 2:
            raise InputError("Hand", "tilt", self.tilt, "an angle between -pi/2 and pi/2 rad")


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
    """L in H; 0 for a current without lag, as in (5)."""

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
        """The back-EMF part k_emf k_i / R of p2, in N m s/rad (6)."""
        return self.back_emf_constant * self.gain

    @property
    def time_constant(self) -> float:
        """Electrical time constant L/R in s."""
        return self.inductance / self.resistance


@dataclass(frozen=True, kw_only=True)
class TorqueDrive:
    """A current-controlled motor: the command sets the torque, without back EMF."""

    gain: float
    """p4 in N m per unit of command."""

    damping: ClassVar[float] = 0.0  # a current loop adds no damping
    time_constant: ClassVar[float] = 0.0  # and is assumed fast

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
                "Friction", "coulomb", self.coulomb, "more than 0 with bristle_stiffness"
            )
        if self.bristle_stiffness > 0 and (self.geared or self.coulomb_slope):
            stiffness = f"{self.bristle_stiffness:g} N m/rad"
            expected = "0 with friction that depends on torque or angle (not simulated together)"
            raise InputError("Friction", "bristle_stiffness", stiffness, expected)


@dataclass(frozen=True, kw_only=True)
class Base:
    """A moving base: a mass on a horizontal spring and damper (see `BaseTerms`)."""

    compliance: float
    """Of the spring, in m/N."""
    frequency: float
    """Natural frequency in rad/s of the base with the bare joint."""
    damping: float
    """Its damping ratio."""

    def __post_init__(self) -> None:
        require_number("Base", positive=True, compliance=self.compliance, frequency=self.frequency)
        require_number("Base", damping=self.damping)

    @property
    def mass(self) -> float:
        """M_0 in kg of the base with the bare joint."""
        return 1 / (self.compliance * self.frequency**2)

    @property
    def friction(self) -> float:
        """C in N s/m of its damper."""
        return 2 * self.damping * self.frequency * self.mass

    def terms(self) -> dict[str, float]:
        """Return the terms of the base by name."""
        return {f"base_{name}": value for name, value in vars(self).items()}


def require_periods(source: str, periods: float) -> None:
    """Raise InputError unless the periods of cogging per turn are a positive integer."""
    if not (periods >= 1 and float(periods).is_integer()):
        raise InputError(source, "cogging_periods", periods, "1, 2, 3, ...")


class JointKind(StrEnum):
    """How a joint moves; a slide's angle is in m, its inertia is a mass, its torques are forces."""

    HINGE = "hinge"
    SLIDE = "slide"

    @property
    def way(self) -> str:
        """Unit of its angle."""
        return "m" if self is JointKind.SLIDE else "rad"


def rounded(value: float) -> float:
    """Return a mass or an arm rounded to six digits, for grouping and printing."""
    return float(f"{value:g}")


@total_ordering
@dataclass(frozen=True, kw_only=True, eq=False)
class AddedMass:
    """A mass added to the joint; compared by its `key`, without uncertainties.

    Parameters
    ----------
    mass
        m_a in kg.
    arm
        l_a, pivot to mass, in m; 0 without a mass and on a slide.
    own_inertia
        About its own centre of mass, in kg m^2: 0 for a point, m r^2/2 for a disc of radius r; 0 on
        a slide.
    mass_uncertainty, arm_uncertainty
        Standard uncertainties, in kg and m.
    gravity
        In m/s^2, perpendicular to the axis; 0 for a vertical axis.
    joint
        Kind of the joint.
    label
        Its name if it is not a mass but a pose of the other joints.
    """

    mass: float = 0.0
    arm: float = 0.0
    own_inertia: float = 0.0
    mass_uncertainty: float = 0.0
    arm_uncertainty: float = 0.0
    gravity: float = GRAVITY
    joint: JointKind = JointKind.HINGE
    label: str = ""

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
    def key(self) -> tuple[float, float, float, float, JointKind, str]:
        """Mass, arm, own inertia, gravity (rounded), joint and label, for comparison."""
        numbers = (self.mass, self.arm, self.own_inertia, self.gravity)
        mass, arm, inertia, gravity = map(rounded, numbers)
        return mass, arm, inertia, gravity, self.joint, self.label

    def __eq__(self, other: object) -> bool:
        return self.key == other.key if isinstance(other, AddedMass) else NotImplemented

    def __lt__(self, other: Any) -> bool:  # noqa: ANN401 - whatever is compared
        return self.key < other.key if isinstance(other, AddedMass) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.key)

    @cached_property
    def inertia(self) -> float:
        """Z = m_a l_a^2 in kg m^2 (81), plus its own inertia; on a slide m_a in kg."""
        if self.joint is JointKind.SLIDE:
            return self.mass
        return self.mass * self.arm**2 + self.own_inertia

    @cached_property
    def swung(self) -> float:
        """m_a l_a^2 in kg m^2, without own inertia; on a slide m_a in kg."""
        return self.inertia - self.own_inertia

    @cached_property
    def weight(self) -> float:
        """m_a g in N, the load on the bearing for any direction of the axis."""
        return self.mass * (self.gravity or GRAVITY)

    @cached_property
    def gravity_moment(self) -> float:
        """X = m_a g l_a in N m (81)."""
        return self.mass * self.gravity * self.arm

    @property
    def loads(self) -> dict[str, float]:
        """What it adds to parameters of the joint, by name: its inertia and gravity moment."""
        return {"p1": self.inertia, "p3": self.gravity_moment}

    @property
    def inertia_and_moment(self) -> tuple[float, float]:
        """Z and X (81) of the `key`: its effect on the motion, except friction by its weight."""
        mass, arm, own_inertia, gravity, joint, _ = self.key
        inertia = mass if joint is JointKind.SLIDE else mass * arm**2 + own_inertia
        return rounded(inertia), rounded(mass * gravity * arm)

    def __str__(self) -> str:
        if self.label:
            return self.label
        if not self.mass:
            return "no added mass"
        if self.joint is JointKind.SLIDE:
            return f"{1e3 * self.mass:g} g"
        suffix = f" with {self.own_inertia:g} kg m²" if self.own_inertia else ""
        return f"{1e3 * self.mass:g} g at {1e3 * self.arm:g} mm{suffix}"


NO_ADDED_MASS = AddedMass()
"""The bare joint."""


@dataclass(frozen=True, kw_only=True)
class LumpedParameters(FrictionTerms, DriveTerms, LoopTerms, BaseTerms):
    """The grey-box model (5), with tau_eps and the drive's lags written out.

        p1 thdd + p2 thd + p3 sin th + p3_offset cos th + friction = p4 v(t - delay) + pulls

    `FrictionTerms` defines friction and pulls, `DriveTerms` v of a command, `LoopTerms` the loop of
    a servo, `BaseTerms` the base. p3 is negative if the centre of mass is above the pivot when the
    added mass hangs down.

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
        Gravity moment in N m of a centre of mass off the line from pivot to added mass.
    tilt
        Angle in rad of the axis from the horizontal. The gravity moment of added masses is reduced
        by its cosine; p3 and p3_offset are already reduced.
    delay
        Delay from recorded input to torque, in s.
    slow_delay, slow_interval
        Additional delay in s where the mean sampling interval of a log's clock exceeds
        ``slow_interval`` in s (see `butterfly.logs.clock`).
    back_emf
        The back-EMF part k_emf k_i/R of p2, in N m s/rad; only used with ``time_constant``.
    time_constant
        L/R of the armature in s, the lag of the motor's torque p4 v - back_emf thd. 0 for the
        reduced model (5).
    gravity
        Gravity of the moments p3 and p3_offset, in m/s^2.
    carried_moment
        Moment m l in kg m of added masses without gravity.
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
        """First moments in kg m of the swinging mass, on and off the line to the added mass."""
        return first_moments(self)

    @property
    def on_base(self) -> dict[str, Any]:
        """Fields of a `Motion` for the moving base."""
        return {"moment": self.moments[0], "base": (self.base_frequency, self.base_damping)}

    def motion(self, angle: Any, velocity: Any, **more: Any) -> Motion:  # noqa: ANN401 - numbers, or arrays
        """Return a `Motion`, in rad and rad/s, of the loaded joint with ``more`` fields."""
        moving = super().motion(angle, velocity, **more)
        if not self.geared:
            return moving
        load = -torque_of(self, moving, CONSERVATIVE)
        return super().motion(angle, velocity, load=load, **more)

    def require_gain(self, source: str) -> None:
        """Raise InputError if p4 is 0, since nothing drives the joint."""
        if self.p4 == 0:
            expected = "a gain: identify from a log of the driven joint, or set known: {p4: ...}"
            raise InputError(source, "p4", "0 (no log is driven)", expected)

    def with_added_mass(self, added: AddedMass) -> LumpedParameters:
        """Return the parameters with an added mass (78), its weight on the bearing."""
        return replace(self, **dict(zip(UnderLoad._fields, under(self, added), strict=True)))


class UnderLoad(NamedTuple):
    """Parameters that an added mass changes, as returned by `under`."""

    p1: float
    p3: float
    coulomb: float
    drag: float
    base_frequency: float
    base_damping: float
    gravity: float
    carried_moment: float


def under(p: Any, added: Any) -> tuple[float, ...]:  # noqa: ANN401 - also translated, for a page
    """Return the parameters of `UnderLoad` with an added mass, which also moves with a base."""
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
    """Return the first moments in kg m (see `LumpedParameters.moments`)."""
    if p.gravity == 0:
        return p.carried_moment, 0.0
    return p.p3 / p.gravity, p.p3_offset / p.gravity


def value_if_absent(name: str) -> float:
    """Return the value of a parameter of a joint that lacks it; 0 of what is none of a joint."""
    return float(getattr(LumpedParameters, name, 0.0))


def friction_brakes(values: Mapping[str, float], masses: Iterable[AddedMass]) -> bool:
    """Whether friction brakes at rest with each added mass, where it is among some values."""
    if "coulomb" not in values:
        return True
    friction, growth = values["coulomb"], values.get("load", 0.0)
    level = min((friction + growth * mass.weight for mass in masses), default=friction)
    return level >= 0 and not (friction <= 0 < values.get("stribeck", 0.0))
