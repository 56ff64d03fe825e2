"""The terms of the model: one table of all parameters, their properties and their torques.

In the equation of motion all torques sum to zero,

    sum over the rows of parameter * basis = 0,

the motor's with the basis -u. All properties of a parameter (unit, bound, torque, potential,
estimators that offer it) are defined here; the compiled kernel and the MJCF are written by hand and
tested against this table. docs/house.md says what a new term touches.

A describing function is the gain of a nonlinear torque on a sinusoidal angle: with
th(t) = Re{a e^(j w t)} it is the fundamental of the torque over that of the angle (Gelb & Vander
Velde, Multiple-Input Describing Functions, 1968, ch. 2).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, fields
from operator import attrgetter
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import dawsn, j0, j1, jv

from butterfly.arrays import Samples

PARAMETERS = ("p1", "p2", "p3", "p4", "coulomb", "delay")
"""The parameters that estimators fit by default, in order."""


class Motion(NamedTuple):
    """The arguments of a torque: numbers, or arrays of one shape."""

    angle: Any  # In rad from hanging down
    velocity: Any  # In rad/s
    direction: Any  # Sign of the velocity
    periods: float  # Of cogging in a turn
    stribeck_velocity: float  # In rad/s
    input: Any = 0.0  # As delivered by the drive
    weight: Any = 0.0  # Added weight on the bearing in N, unless already in T_c
    mass: Any = 0.0  # Added mass in kg, unless already in the drag
    carried: Any = 0.0  # m l^2 in kg m^2 of the added mass, unless already in p1
    motor: Any = 0.0  # Torque of the motor in N m
    load: Any = 0.0  # Torque of gravity, springs etc. in N m
    moment: Any = 0.0  # First moment in kg m of the swinging mass
    base: Any = (1.0, 1.0)  # Frequency in rad/s and damping ratio of the loaded base
    way: Any = 0.0  # Sign of what a gear carries of both,
    way_at_rest: Any = 0.0  # and of what its excess at rest grows with


@dataclass(frozen=True)
class Term:
    """A row: one parameter and its effect."""

    name: str  # As in code,
    symbol: str  # and as printed
    unit: str  # In which "unit" is the input's
    meaning: str
    _: KW_ONLY
    lower: float = -math.inf  # Lower bound of an estimate
    # Braking torque per unit of the parameter, as a function of the `Motion`
    basis: Callable[[Motion], Any] | None = None
    # 2 for the inertia and 1 for viscous friction, whose basis is that derivative of the angle
    derivative: int = 0
    # Energy per unit of the parameter at an angle, with the periods of cogging in a turn; its slope
    # is the basis
    potential: Callable[[Any, float], Any] | None = None
    # Torque over angle, per unit, for a sine: from frequencies in rad/s, amplitudes in rad and the
    # `Motion` that holds weight and settings
    describing: Callable[[Samples, Samples, Motion], Any] | None = None
    # Whether it holds the joint at rest: friction times the sign of the velocity
    dry: bool = False
    of_gain: bool = False  # Whether p4 times the parameter enters the equation
    sign_observable: bool = True  # Whether the motion reveals the sign
    state: str = ""  # State that it adds to the joint, if any
    # Name of a residual torque of this shape; empty if not searched for
    looks_like: str = ""
    follows: frozenset[str] = frozenset()  # It needs one of these terms
    shows_as: frozenset[str] = frozenset()  # It shows as one of these terms where it is not fitted
    # Names of the estimators that can estimate it when asked to
    offered: frozenset[str] = frozenset()
    tried: Literal["", "common", "rare"] = ""  # How common it is, if it is tried unasked
    of_servo: bool = False  # Whether it is common in servos
    most: float = math.inf  # Above it, one that was not asked for is taken for something else

    @property
    def seconds(self) -> int:
        """Power of time in the unit; inertia is torque over angular acceleration, N m s²."""
        above, _, below = self.unit.replace("kg m²", "N m s²").partition("/")
        counts = [part.strip("()").split() for part in (above, below)]
        more, less = (part.count("s") + 2 * part.count("s²") for part in counts)
        return more - less


def gravity_describing_function(a: Samples) -> Samples:
    """Gain 2 J1(a)/a of ``sin`` for a sinusoid of amplitude a > 0 in rad; tends to 1 for a -> 0.

    That of ``sin(N th)`` is N times that of N a.
    """
    return np.asarray(2.0 * j1(a) / a)


def coulomb_describing_function(a: Samples) -> NDArray[np.complex128]:
    """Gain j 4/(pi a) of ``sgn(thd)`` on a sinusoidal angle of amplitude a > 0 in rad, in 1/rad."""
    return np.asarray(4j / (np.pi * a))


def stribeck_describing_function(
    omega: Samples, a: Samples, velocity: float
) -> NDArray[np.complex128]:
    """Gain of ``sgn(thd) exp(-(thd/v_s)^2)`` on a sinusoidal angle of amplitude a in rad, in 1/rad.

    With b = a w/v_s it is j 4/(pi a) D(b)/b, D Dawson's integral.
    """
    b = a * omega / velocity
    return np.asarray(coulomb_describing_function(a) * dawsn(b) / b)


def base_describing_function(omega: Samples, a: Samples, m: Motion) -> NDArray[np.complex128]:
    """Gain, per compliance, by which a base reduces the torque on a joint that swings by a rad.

    With Q = 1 - (w/w_b)^2 + 2 j zeta w/w_b of a stiff base, h' = H cos th pulls with
    H cos(th) s'' where Q s = w^2 times the fundamental of H sin th.
    """
    natural, damping = m.base
    pushed = m.moment * gravity_describing_function(a)
    force = omega**2 * pushed / (1 - (omega / natural) ** 2 + 2j * damping * omega / natural)
    along, across = j0(a) - jv(2, a), j0(a) + jv(2, a)
    return np.asarray(-(omega**2) * m.moment * (along * force.real + 1j * across * force.imag))


@dataclass(frozen=True, kw_only=True)
class FrictionTerms:
    """The terms besides p1..p4; each is 0 by default.

    Sliding at velocity v and angle th, the joint is braked by

        g(v) sgn v + drag |v| v,   g(v) = T_c + T_s exp(-(v/v_s)^2),

    where T_c grows by ``coulomb_slope th``, while it is above 0, and drag by ``load_drag`` times
    the added mass. In a gear T_c grows by ``|motor_friction motor - load_friction load|``, with the
    torques in N m of the motor and the load (gravity etc.), and T_s likewise with
    ``motor_stribeck`` and ``load_stribeck``. While both torques oppose each other, T_s also grows
    by the square of the smaller, times ``lifting_stribeck`` if the motor drives the load and
    ``lowering_stribeck`` if the load drives the motor. These are M1 to M6 of Duclusaud, Passault
    and Rouxel, arXiv 2410.08650, with their Stribeck exponent 2, but the direction of motion, not
    the larger torque, decides which side drives. The joint is pulled by ``bias - spring th +
    cogging sin(N th) + cogging_cosine cos(N th)``. At rest it sticks until the other torques exceed
    T_c + T_s. With bristles it creeps: the LuGre model replaces g(v) sgn v by ``k z + c z'`` with
    ``z' = v - k |v| z / g(v)`` (Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE TAC 40(3),
    1995). `TERMS` has unit and meaning of each.
    """

    coulomb: float = 0.0
    load: float = 0.0
    coulomb_slope: float = 0.0
    load_drag: float = 0.0
    mass_inertia: float = 0.0
    stribeck: float = 0.0
    stribeck_velocity: float = 0.1
    motor_friction: float = 0.0
    load_friction: float = 0.0
    motor_stribeck: float = 0.0
    load_stribeck: float = 0.0
    lifting_stribeck: float = 0.0
    lowering_stribeck: float = 0.0
    bristle_stiffness: float = 0.0
    bristle_damping: float = 0.0
    drag: float = 0.0
    bias: float = 0.0
    spring: float = 0.0
    cogging: float = 0.0
    cogging_cosine: float = 0.0
    cogging_periods: float = 1.0

    def terms(self) -> dict[str, Any]:
        """Return all terms by name."""
        return {field.name: getattr(self, field.name) for field in fields(FrictionTerms)}

    @property
    def geared(self) -> bool:
        """Whether friction grows with the torque of motor or load."""
        return any(_OF_GEAR(self))

    def motion(self, angle: Any, velocity: Any, **more: Any) -> Motion:  # noqa: ANN401 - numbers, or arrays
        """Return a `Motion`, in rad and rad/s, with these terms and ``more`` fields."""
        periods, slow = self.cogging_periods, self.stribeck_velocity
        moving = Motion(angle, velocity, np.sign(velocity), periods, slow, **more)
        if not self.geared:
            return moving
        motor, load = moving.motor, moving.load
        return moving._replace(
            way=np.sign(self.motor_friction * motor - self.load_friction * load),
            way_at_rest=np.sign(self.motor_stribeck * motor - self.load_stribeck * load),
        )

    @property
    def holding(self) -> float:
        """T_c + T_s, the static friction in N m."""
        return self.level(0.0)

    @property
    def sticks_harder(self) -> bool:
        """Whether Stribeck friction is rigid, or friction depends on torque or angle."""
        harder = self.stribeck > 0 and self.bristle_stiffness == 0
        return harder or self.geared or self.coulomb_slope != 0

    def level(self, velocity: float) -> float:
        """Return g(v) in N m at a velocity in rad/s, without torques."""
        sliding = FrictionTerms.motion(self, 0.0, velocity)._replace(direction=1.0)
        return float(torque_of(self, sliding, DRY))


@dataclass(frozen=True, kw_only=True)
class DriveTerms:
    """The output v/(1 + c |v|) of the drive for a command u, after a dead zone.

    ``v = u - dead_zone sgn u`` for commands above the dead zone, else 0; c is ``compression``.
    """

    dead_zone: float = 0.0
    compression: float = 0.0

    @property
    def drive(self) -> DriveTerms:
        """These terms alone."""
        return DriveTerms(dead_zone=self.dead_zone, compression=self.compression)

    def delivered(self, inputs: Any) -> Any:  # noqa: ANN401 - one input, or (n,)
        """Return the output for one command, or for (n,)."""
        if self.dead_zone:
            inputs = inputs - np.clip(inputs, -self.dead_zone, self.dead_zone)
        return inputs / (1 + self.compression * abs(inputs)) if self.compression else inputs

    def slopes(self, inputs: Samples) -> dict[str, Samples]:
        """Return the (n,) derivatives of the output for (n,) commands by each term."""
        return {name: self.slope(name, inputs) for name in DRIVE}

    def slope(self, name: str, inputs: Samples) -> Samples:
        """Return the (n,) derivatives of the output for (n,) commands by one term."""
        excess = DriveTerms(dead_zone=self.dead_zone).delivered(inputs)
        slopes = -np.sign(excess) if name == "dead_zone" else -excess * abs(excess)
        weaker = (1 + self.compression * abs(excess)) ** 2 if self.compression else 1.0
        return np.asarray(slopes / weaker)


@dataclass(frozen=True, kw_only=True)
class LoopTerms:
    """Gains of a servo loop, relative to the given ones, and its latency."""

    loop_kp: float = 1.0
    loop_ki: float = 1.0
    loop_kd: float = 1.0
    latency: float = 0.0


@dataclass(frozen=True, kw_only=True)
class BaseTerms:
    """A horizontally moving base: mass, spring and damper (see `kernel.moving_base`)."""

    base_compliance: float = 0.0
    base_frequency: float = 25.0
    base_damping: float = 0.7

    @property
    def base_gives(self) -> bool:
        """Whether the base moves."""
        return self.base_compliance > 0


_ROUNDS = 30  # for friction that grows with the torque that overcomes it
IDEAL = DriveTerms()
"""A drive whose output is its command."""

DRIVE = tuple(field.name for field in fields(DriveTerms))
"""Names of the terms of the drive."""

LOOP_TERMS = tuple(field.name for field in fields(LoopTerms))
"""Names of the terms of a servo loop: gains and latency."""

BASE_TERMS = tuple(field.name for field in fields(BaseTerms))
"""Names of the terms of a moving base."""


_HARMONIC, _WEAK = "harmonic-balance", "weak-form"
_OUTPUT, _ORBIT = "output-error", "re-calibration"


def _excess(m: Motion) -> Any:  # noqa: ANN401 - in the motion's shape
    return np.exp(-((m.velocity / m.stribeck_velocity) ** 2))


def _carried(way: Any, torque: Any) -> Any:  # noqa: ANN401
    return np.where(way == 0, abs(torque), way * torque)


def _passed_on(m: Motion) -> Any:  # noqa: ANN401
    """Smaller torque in N m of motor and load if they oppose each other, else 0."""
    return np.minimum(abs(m.motor), abs(m.load)) * (m.motor * m.load < 0)


# fmt: off
_ROWS = (
    Term("p1", "p₁", "kg m²", "inertia about the pivot",
         derivative=2, describing=lambda w, _a, _m: -(w**2), looks_like="an inertia"),
    Term("p2", "p₂", "N m s/rad", "viscous friction and back EMF, proportional to velocity",
         lower=0.0, basis=lambda m: m.velocity, derivative=1,
         describing=lambda w, _a, _m: 1j * w, looks_like="viscous friction"),
    Term("p3", "p₃", "N m", "gravity moment",
         basis=lambda m: np.sin(m.angle), potential=lambda x, _n: 2 * np.sin(x / 2) ** 2,
         describing=lambda _w, a, _m: gravity_describing_function(a),
         looks_like="a gravity moment"),
    Term("p4", "p₄", "N m/unit", "stall torque per unit of input",
         basis=lambda m: -m.input),
    Term("coulomb", "T_c", "N m", "Coulomb friction; also holds the joint at rest",
         lower=0.0, basis=lambda m: m.direction, dry=True,
         describing=lambda _w, a, _m: coulomb_describing_function(a),
         looks_like="Coulomb friction", offered=frozenset({_ORBIT})),
    Term("delay", "delay", "s", "delay from recorded input to torque",
         of_gain=True),
    Term("slow_delay", "slow delay", "s",
         "additional delay in the slow regime of a clock whose sampling interval switches",
         of_gain=True,
         offered=frozenset({_OUTPUT}), tried="rare"),
    Term("slow_interval", "slow interval", "s",
         "mean sampling interval above which the clock is in its slow regime", lower=0.0),
    Term("drag", "drag", "N m s²/rad²", "drag proportional to velocity squared",
         lower=0.0, basis=lambda m: abs(m.velocity) * m.velocity,
         describing=lambda w, a, _m: 8j * a * w**2 / (3 * np.pi),
         looks_like="quadratic drag", offered=frozenset({_HARMONIC, _WEAK, _OUTPUT, _ORBIT}),
         tried="common"),
    Term("load", "load", "m",
         "growth of coulomb with the added weight; negative if it relieves the bearing",
         basis=lambda m: m.weight * m.direction, dry=True,
         describing=lambda _w, a, m: m.weight * coulomb_describing_function(a),
         looks_like="Coulomb friction that grows with the added weight",
         offered=frozenset({_HARMONIC, _WEAK, _OUTPUT}), tried="common"),
    Term("coulomb_slope", "T_c slope", "N m/rad", "growth of coulomb with the angle",
         basis=lambda m: m.angle * m.direction, dry=True,
         looks_like="Coulomb friction that grows with the angle",
         offered=frozenset({_WEAK, _OUTPUT}), tried="rare"),
    Term("load_drag", "load drag", "N m s²/(rad² kg)", "growth of drag with the added mass",
         lower=0.0, basis=lambda m: m.mass * abs(m.velocity) * m.velocity,
         describing=lambda w, a, m: m.mass * 8j * a * w**2 / (3 * np.pi),
         looks_like="quadratic drag that grows with the added mass",
         offered=frozenset({_HARMONIC, _WEAK, _OUTPUT}), tried="rare"),
    Term("mass_inertia", "mass inertia", "–",
         "inertia of added masses about their own centre, relative to m l²; below 0, an arm or a "
         "clock that is off",
         lower=-0.1, describing=lambda w, _a, m: -(w**2) * m.carried,
         looks_like="an own inertia of the added masses",
         offered=frozenset({_HARMONIC, _WEAK, _OUTPUT}), tried="rare"),
    Term("bias", "bias", "N m",
         "constant torque, or half the difference of Coulomb friction between directions",
         basis=lambda m: -np.ones_like(m.angle), potential=lambda x, _n: -x,
         looks_like="a constant torque", offered=frozenset({_WEAK, _OUTPUT, _ORBIT}),
         tried="common"),
    Term("spring", "spring", "N m/rad",
         "stiffness towards angle 0, as of a cable or flexure",
         lower=0.0, basis=lambda m: m.angle, potential=lambda x, _n: 0.5 * x**2,
         shows_as=frozenset({"bias"}), describing=lambda _w, a, _m: np.ones_like(a),
         looks_like="a spring", offered=frozenset({_WEAK, _OUTPUT}), tried="rare"),
    Term("p3_offset", "p₃ offset", "N m",
         "gravity moment of a centre of mass off the line from pivot to added mass",
         basis=lambda m: np.cos(m.angle), potential=lambda x, _n: np.sin(x),
         looks_like="a centre of mass off the line to the added mass",
         offered=frozenset({_WEAK, _OUTPUT, _ORBIT}), tried="common"),
    Term("stribeck", "stribeck", "N m", "excess of static friction over Coulomb friction",
         lower=0.0, dry=True, basis=lambda m: m.direction * _excess(m),
         describing=lambda w, a, m: stribeck_describing_function(w, a, m.stribeck_velocity),
         looks_like="Stribeck friction", offered=frozenset({_HARMONIC, _WEAK, _OUTPUT, _ORBIT}),
         tried="common"),
    Term("stribeck_velocity", "Stribeck velocity", "rad/s",
         "velocity scale over which that excess vanishes",
         lower=1e-3,
         follows=frozenset({"stribeck", "motor_stribeck", "load_stribeck"}),
         offered=frozenset({_OUTPUT})),
    Term("motor_friction", "motor friction", "–",
         "gear: growth of friction with motor torque",
         lower=0.0, dry=True, basis=lambda m: _carried(m.way, m.motor) * m.direction,
         looks_like="friction that grows with motor torque", offered=frozenset({_OUTPUT}),
         tried="rare", of_servo=True),
    Term("load_friction", "load friction", "–",
         "gear: growth of friction with load torque (gravity, spring)",
         lower=0.0, dry=True, basis=lambda m: _carried(-m.way, m.load) * m.direction,
         looks_like="friction that grows with the load", offered=frozenset({_OUTPUT}),
         tried="rare", of_servo=True),
    Term("motor_stribeck", "motor Stribeck", "–",
         "gear: growth of Stribeck friction with motor torque",
         lower=0.0, dry=True, offered=frozenset({_OUTPUT}),
         basis=lambda m: _carried(m.way_at_rest, m.motor) * m.direction * _excess(m)),
    Term("load_stribeck", "load Stribeck", "–",
         "gear: growth of Stribeck friction with load torque",
         lower=0.0, dry=True, offered=frozenset({_OUTPUT}),
         basis=lambda m: _carried(-m.way_at_rest, m.load) * m.direction * _excess(m)),
    Term("lifting_stribeck", "lifting Stribeck", "1/(N m)",
         "gear: growth of Stribeck friction with torque squared while the motor drives the load",
         lower=0.0, dry=True, offered=frozenset({_OUTPUT}),
         basis=lambda m: _passed_on(m) ** 2 * (m.direction * m.load < 0) * m.direction
         * _excess(m)),
    Term("lowering_stribeck", "lowering Stribeck", "1/(N m)",
         "gear: growth of Stribeck friction with torque squared while the load drives the motor",
         lower=0.0, dry=True, offered=frozenset({_OUTPUT}),
         basis=lambda m: _passed_on(m) ** 2 * (m.direction * m.load > 0) * m.direction
         * _excess(m)),
    Term("tilt", "tilt", "rad",
         "angle of the axis from the horizontal, visible in the weight of added masses",
         lower=0.0, sign_observable=False,
         offered=frozenset({_OUTPUT})),
    Term("base_compliance", "base compliance", "m/N",
         "compliance of a moving base; 0 for a fixed one",
         lower=0.0, state="base",
         describing=base_describing_function, offered=frozenset({_OUTPUT}), tried="rare"),
    Term("base_frequency", "base frequency", "rad/s",
         "natural frequency of the base, without added mass",
         lower=1.0, state="base",
         follows=frozenset({"base_compliance"}), offered=frozenset({_OUTPUT})),
    Term("base_damping", "base damping", "–", "damping ratio of the base, without added mass",
         lower=0.0, state="base", most=2.0,
         follows=frozenset({"base_compliance"}), offered=frozenset({_OUTPUT})),
    Term("cogging", "cogging", "N m", "sine part of a torque periodic in the angle",
         basis=lambda m: -np.sin(m.periods * m.angle),
         potential=lambda x, n: -2 * np.sin(n * x / 2) ** 2 / n,
         describing=lambda _w, a, m: -m.periods * gravity_describing_function(m.periods * a),
         offered=frozenset({_WEAK, _OUTPUT, _ORBIT})),
    Term("cogging_cosine", "cogging, cosine", "N m",
         "cosine part of a torque periodic in the angle",
         basis=lambda m: -np.cos(m.periods * m.angle), potential=lambda x, n: -np.sin(n * x) / n,
         offered=frozenset({_WEAK, _OUTPUT, _ORBIT})),
    Term("cogging_periods", "cogging periods", "–",
         "periods of that torque per turn; 1 for a misaligned clutch",
         lower=1.0),
    Term("bristle_stiffness", "bristle stiffness", "N m/rad",
         "LuGre: stiffness of friction before it slides; 0 for rigid sticking",
         lower=0.0, state="deflection of the bristles"),
    Term("bristle_damping", "bristle damping", "N m s/rad", "LuGre: damping of that friction",
         lower=0.0, state="deflection of the bristles"),
    Term("back_emf", "back EMF", "N m s/rad",
         "part of p2 that lags with the armature, and is 0 while a servo is off",
         lower=0.0, state="torque of the motor",
         offered=frozenset({_OUTPUT}), of_servo=True),
    Term("time_constant", "time constant", "s", "electrical time constant L/R of the armature",
         lower=0.0, state="torque of the motor"),
    Term("dead_zone", "dead zone", "unit",
         "command below which the drive gives no torque",
         lower=0.0, basis=lambda m: np.sign(m.input), of_gain=True,
         looks_like="a dead zone of the drive", offered=frozenset({_WEAK, _OUTPUT}), tried="rare"),
    Term("compression", "compression", "1/unit",
         "saturation c of a drive that gives v/(1 + c |v|)",
         lower=0.0, basis=lambda m: m.input * abs(m.input), of_gain=True,
         looks_like="a saturating drive",
         offered=frozenset({_WEAK, _OUTPUT, _ORBIT}), tried="rare", of_servo=True),
    Term("loop_kp", "loop P gain", "–", "P gain of the servo loop, relative to the given one",
         lower=0.0, offered=frozenset({_OUTPUT})),
    Term("loop_ki", "loop I gain", "–", "I gain of the servo loop, relative to the given one",
         lower=0.0, offered=frozenset({_OUTPUT})),
    Term("loop_kd", "loop D gain", "–", "D gain of the servo loop, relative to the given one",
         lower=0.0, offered=frozenset({_OUTPUT})),
    Term("latency", "latency", "s",
         "delay of a servo from sampling the joint to the torque, besides its clock",
         lower=0.0, offered=frozenset({_OUTPUT}), of_servo=True),
)
# fmt: on

GEAR = tuple(
    f"{which}_{kind}"
    for kind, count in (("friction", 2), ("stribeck", 4))
    for which in ("motor", "load", "lifting", "lowering")[:count]
)
"""Friction that grows with torque."""
_OF_GEAR = attrgetter(*GEAR)

TERMS = {row.name: row for row in _ROWS}
"""All rows by name, in printed order."""

FOLLOWERS = {row.name for row in _ROWS if row.follows}
"""Terms that need another term."""

COMMON = tuple(row.name for row in _ROWS if row.tried == "common")
"""Terms that are tried unasked, since many joints have them."""

RARE = tuple(row.name for row in _ROWS if row.tried == "rare")
"""Terms that are tried unasked, and need better evidence."""

OF_SERVO = tuple(row.name for row in _ROWS if row.of_servo)
"""Terms that are common in servos, which have a gear and can be switched off."""

GROWING = {row.name for row in _ROWS if row.unit.startswith(("kg", "N m"))} | {"load"}
"""Parameters proportional to the scale of all torques."""

SHARES = dict.fromkeys(GROWING, 1.0)
SHARES |= {row.name: -1.0 for row in _ROWS if row.unit in {"1/(N m)", "m/N"}}
"""Power of that scale in each parameter that depends on it."""

TORQUES = {row.name for row in _ROWS if row.basis or row.derivative} & GROWING
TORQUES -= {"load", "load_drag", "coulomb_slope"}
"""Those of them that act without another term."""

BEYOND_MUJOCO = (*GEAR, "coulomb_slope")
"""Friction that MuJoCo alone does not have."""

DRY = tuple(row for row in _ROWS if row.dry)
"""Terms that hold the joint at rest."""

CONSERVATIVE = tuple(row for row in _ROWS if row.potential is not None)
"""Terms with a potential."""

OF_ANGLE = {row.name for row in CONSERVATIVE} - {"bias"} | {"tilt"}
"""Terms that depend on the angle."""

DISSIPATIVE = tuple(
    row for row in _ROWS if row.basis and not row.potential and row.name not in {"p4", *DRIVE}
)
"""Terms that brake: functions of the velocity."""


def torque_of(parameters: FrictionTerms, motion: Motion, rows: Iterable[Term]) -> Any:  # noqa: ANN401
    """Return the braking torque in N m of rows with a basis, in the shape of the motion."""
    total = 0.0
    for row in rows:
        value = getattr(parameters, row.name)
        if value:
            assert row.basis is not None  # noqa: S101 - the caller's choice of rows
            total = total + value * row.basis(motion)
    return total


def made_up(parameters: FrictionTerms, motion: Motion, rows: Sequence[Term]) -> Any:  # noqa: ANN401
    """Return the braking torque in N m of some rows while the motor compensates it.

    The motion has the motor torque without compensation, which in a gear increases friction.
    """
    torque = torque_of(parameters, motion, rows)
    for _ in range(_ROUNDS if parameters.geared else 0):
        motor = motion.motor + torque
        moving = parameters.motion(motion.angle, motion.velocity, motor=motor)
        torque = torque_of(parameters, moving, rows)
    return torque


def companions(names: Iterable[str]) -> set[str]:
    """Return the names of the terms that need one of some terms."""
    leaders = {*names}
    return {row.name for row in _ROWS if row.follows & leaders}


def is_simulated_with(name: str, others: Container[str]) -> bool:
    """Whether a term is simulated with others: friction of gears is not on a base that moves."""
    base = BASE_TERMS[0]
    against = {base} if name in GEAR else {*GEAR} if name == base else set()
    return not any(term in others for term in against)


def offered(estimator: str) -> tuple[str, ...]:
    """Names of the optional terms of an estimator, in the table's order."""
    return tuple(row.name for row in _ROWS if estimator in row.offered)


def lower_bounds(names: Iterable[str]) -> Samples:
    """(n,) lower bounds of n parameters; -inf for a name not in the table."""
    return np.array([TERMS[name].lower if name in TERMS else -np.inf for name in names])
