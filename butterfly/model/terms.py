"""The terms of the model: one table of all parameters, their properties and their torques.

In the equation of motion all torques sum to zero,

    sum over the rows of parameter * basis = 0,

the motor's with the basis -u. All properties of a parameter (unit, bound, torque, potential,
estimators that offer it) are defined here; the compiled kernel and the MJCF are written by hand and
tested against this table. No other module lists names of terms: what is true of a term is a field
of its row, or follows from its unit and torque. docs/house.md says what a new term touches.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, fields
from operator import attrgetter
from typing import Any, Literal, NamedTuple

import numpy as np

from butterfly.arrays import Samples
from butterfly.model.describing import (
    base_describing_function,
    coulomb_describing_function,
    gravity_describing_function,
    stribeck_describing_function,
)

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
    setting: bool = False  # Whether other terms are taken at it, and closed forms know it
    positive: bool = False  # Whether no joint has a 0 of it
    # What logs need to show it at all: gravity, an angle that is measured, a drive, or an input
    needs: Literal["", "gravity", "angle", "drive", "input"] = ""
    of_mass: bool = False  # Whether it acts on what is added alone
    changes: bool = False  # Whether it changes from day to day, whatever is mounted
    of_body: bool = False  # Whether it is a property of the swinging body
    of_motor: bool = False  # Whether a motor, with its gear and drive, takes it to another joint
    fixed_base: bool = False  # Whether it is simulated on a base that does not move alone
    shifts_resonance: bool = False  # Whether small swings have another period with it
    recalibrated: bool = False  # Whether re-calibration on an orbit tries it unasked
    held_by: frozenset[str] = frozenset()  # Names of the files that have a place for it
    size: float = 0.0  # Such as a small hand may have, in the units of the table; tests plant it
    called: str = ""  # As sentences name it, where its name alone is not understood
    more_runs: str = ""  # The run that shows it, or tells it from what it looks like

    def power_of(self, symbol: str) -> int:
        """Return the power of a symbol in the unit; of inertia, N m s², as of a torque."""
        above, _, below = self.unit.replace("kg m²", "N m s²").partition("/")
        more, less = (
            parts.count(symbol) + 2 * parts.count(f"{symbol}²")
            for parts in (part.strip("()").split() for part in (above, below))
        )
        return more - less

    @property
    def angles(self) -> int:
        """Power of the angle in the torque of small motions: 1 of inertia, 0 of dry friction."""
        if self.derivative or self.basis is None:
            return min(self.derivative, 1)
        motions = (Motion(np.float64(x), x, *np.ones(6)) for x in (1e-4, 1e-3))
        motions = (Motion(np.float64(x), x, *np.ones(6)) for x in (1e-4, 1e-3))
        torques = [abs(float(self.basis(motion))) for motion in motions]
        return round(math.log10(torques[1] / torques[0])) if torques[0] else 0


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
_BAM, _URDF, _MODEL = "bam", "urdf", "model"


def _excess(m: Motion) -> Any:  # noqa: ANN401 - in the motion's shape
    return np.exp(-((m.velocity / m.stribeck_velocity) ** 2))


def _carried(way: Any, torque: Any) -> Any:  # noqa: ANN401
    return np.where(way == 0, abs(torque), way * torque)


def _opposed_torque(m: Motion) -> Any:  # noqa: ANN401
    """Smaller torque in N m of motor and load if they oppose each other, else 0."""
    return np.minimum(abs(m.motor), abs(m.load)) * (m.motor * m.load < 0)


# fmt: off
_ROWS = (
    Term("p1", "p₁", "kg m²", "inertia about the pivot",
         derivative=2, describing=lambda w, _a, _m: -(w**2), looks_like="an inertia",
         positive=True, of_body=True, held_by=frozenset({_BAM, _URDF, _MODEL}),
         called="the inertia p1",
         more_runs="a run that reverses faster, in which inertia takes more torque than friction"),
    Term("p2", "p₂", "N m s/rad", "viscous friction and back EMF, proportional to velocity",
         lower=0.0, basis=lambda m: m.velocity, derivative=1,
         describing=lambda w, _a, _m: 1j * w, looks_like="viscous friction",
         held_by=frozenset({_BAM, _URDF, _MODEL}), changes=True, called="viscous friction p2",
         of_motor=True),
    Term("p3", "p₃", "N m", "gravity moment",
         basis=lambda m: np.sin(m.angle), potential=lambda x, _n: 2 * np.sin(x / 2) ** 2,
         describing=lambda _w, a, _m: gravity_describing_function(a),
         looks_like="a gravity moment",
         held_by=frozenset({_BAM, _URDF, _MODEL}), of_body=True, needs="gravity",
         called="the gravity moment p3"),
    Term("p4", "p₄", "N m/unit", "stall torque per unit of input",
         basis=lambda m: -m.input,
         held_by=frozenset({_BAM, _URDF, _MODEL}), changes=True, needs="input",
         called="the gain p4",
         more_runs="a run with a larger input", of_motor=True),
    Term("coulomb", "T_c", "N m", "Coulomb friction; also holds the joint at rest",
         lower=0.0, basis=lambda m: m.direction, dry=True,
         describing=lambda _w, a, _m: coulomb_describing_function(a),
         looks_like="Coulomb friction", offered=frozenset({_ORBIT}),
         held_by=frozenset({_BAM, _URDF, _MODEL}), changes=True, recalibrated=True,
         called="Coulomb friction", size=1.2e-3, of_motor=True),
    Term("delay", "delay", "s", "delay from recorded input to torque",
         of_gain=True,
         needs="drive", held_by=frozenset({_URDF, _MODEL}), called="the delay"),
    Term("slow_delay", "slow delay", "s",
         "additional delay in the slow regime of a clock whose sampling interval switches",
         of_gain=True,
         offered=frozenset({_OUTPUT}), tried="rare"),
    Term("slow_interval", "slow interval", "s",
         "mean sampling interval above which the clock is in its slow regime", lower=0.0),
    Term("drag", "drag", "N m s²/rad²", "drag proportional to velocity squared",
         lower=0.0, basis=lambda m: abs(m.velocity) * m.velocity,
         describing=lambda w, a, _m: 8j * a * w**2 / (3 * np.pi),
         looks_like="quadratic drag", held_by=frozenset({_MODEL}),
         offered=frozenset({_HARMONIC, _WEAK, _OUTPUT, _ORBIT}),
         tried="common",
         recalibrated=True,
         more_runs="At one speed, drag and viscous friction are one number: add a faster run.",
         size=8e-4),
    Term("load", "load", "m",
         "growth of coulomb with the added weight; negative if it relieves the bearing",
         basis=lambda m: m.weight * m.direction, dry=True,
         describing=lambda _w, a, m: m.weight * coulomb_describing_function(a),
         looks_like="Coulomb friction that grows with the added weight",
         offered=frozenset({_HARMONIC, _WEAK, _OUTPUT}), tried="common",
         of_mass=True, held_by=frozenset({_URDF}), size=1.5e-3),
    Term("coulomb_slope", "T_c slope", "N m/rad", "growth of coulomb with the angle",
         basis=lambda m: m.angle * m.direction, dry=True,
         looks_like="Coulomb friction that grows with the angle",
         offered=frozenset({_WEAK, _OUTPUT}), tried="rare", size=1e-3),
    Term("load_drag", "load drag", "N m s²/(rad² kg)", "growth of drag with the added mass",
         lower=0.0, basis=lambda m: m.mass * abs(m.velocity) * m.velocity,
         describing=lambda w, a, m: m.mass * 8j * a * w**2 / (3 * np.pi),
         looks_like="quadratic drag that grows with the added mass",
         offered=frozenset({_HARMONIC, _WEAK, _OUTPUT}), tried="rare",
         of_mass=True, size=8e-3),
    Term("mass_inertia", "mass inertia", "–",
         "inertia of added masses about their own centre, relative to m l²; below 0, an arm or a "
         "clock that is off",
         lower=-0.1, describing=lambda w, _a, m: -(w**2) * m.carried,
         looks_like="an own inertia of the added masses",
         offered=frozenset({_HARMONIC, _WEAK, _OUTPUT}), tried="rare",
         of_mass=True, of_body=True, held_by=frozenset({_URDF}), size=0.06),
    Term("bias", "bias", "N m",
         "constant torque, or half the difference of Coulomb friction between directions",
         basis=lambda m: -np.ones_like(m.angle), potential=lambda x, _n: -x,
         looks_like="a constant torque", offered=frozenset({_WEAK, _OUTPUT, _ORBIT}),
         tried="common",
         recalibrated=True,
         more_runs="In one direction, bias and Coulomb friction are one number: add a run the "
         "other way.", size=-2e-3),
    Term("spring", "spring", "N m/rad",
         "stiffness towards angle 0, as of a cable or flexure",
         lower=0.0, basis=lambda m: m.angle, potential=lambda x, _n: 0.5 * x**2,
         shows_as=frozenset({"bias"}), describing=lambda _w, a, _m: np.ones_like(a),
         looks_like="a spring", offered=frozenset({_WEAK, _OUTPUT}), tried="rare",
         needs="angle", shifts_resonance=True, size=4e-3),
    Term("p3_offset", "p₃ offset", "N m",
         "gravity moment of a centre of mass off the line from pivot to added mass",
         basis=lambda m: np.cos(m.angle), potential=lambda x, _n: np.sin(x),
         looks_like="a centre of mass off the line to the added mass",
         offered=frozenset({_WEAK, _OUTPUT, _ORBIT}), tried="common",
         of_body=True, recalibrated=True, held_by=frozenset({_MODEL, _URDF}), size=-3e-3),
    Term("stribeck", "stribeck", "N m", "excess of static friction over Coulomb friction",
         lower=0.0, dry=True, basis=lambda m: m.direction * _excess(m),
         describing=lambda w, a, m: stribeck_describing_function(w, a, m.stribeck_velocity),
         looks_like="Stribeck friction", offered=frozenset({_HARMONIC, _WEAK, _OUTPUT, _ORBIT}),
         tried="common",
         held_by=frozenset({_BAM}),
         more_runs="At one speed, Stribeck and Coulomb friction are one number: add a slower run.",
         size=5e-4, of_motor=True),
    Term("stribeck_velocity", "Stribeck velocity", "rad/s",
         "velocity scale over which that excess vanishes",
         lower=1e-3,
         follows=frozenset({"stribeck", "motor_stribeck", "load_stribeck"}),
         offered=frozenset({_OUTPUT}),
         setting=True, held_by=frozenset({_BAM}), size=0.25, of_motor=True),
    Term("motor_friction", "motor friction", "–",
         "gear: growth of friction with motor torque",
         lower=0.0, dry=True, basis=lambda m: _carried(m.way, m.motor) * m.direction,
         looks_like="friction that grows with motor torque", offered=frozenset({_OUTPUT}),
         tried="rare", of_servo=True,
         fixed_base=True, held_by=frozenset({_BAM}),
         more_runs="With one load, motor friction and Coulomb friction are one number: "
         "add a run with another mass or command.", size=0.15, of_motor=True),
    Term("load_friction", "load friction", "–",
         "gear: growth of friction with load torque (gravity, spring)",
         lower=0.0, dry=True, basis=lambda m: _carried(-m.way, m.load) * m.direction,
         looks_like="friction that grows with the load", offered=frozenset({_OUTPUT}),
         tried="rare", of_servo=True,
         fixed_base=True, held_by=frozenset({_BAM}),
         more_runs="With one load, load friction and Coulomb friction are one number: "
         "add a run with another mass.", size=0.15, of_motor=True),
    Term("motor_stribeck", "motor Stribeck", "–",
         "gear: growth of Stribeck friction with motor torque",
         lower=0.0, dry=True, offered=frozenset({_OUTPUT}),
         basis=lambda m: _carried(m.way_at_rest, m.motor) * m.direction * _excess(m),
         fixed_base=True, held_by=frozenset({_BAM}), size=0.2, of_motor=True),
    Term("load_stribeck", "load Stribeck", "–",
         "gear: growth of Stribeck friction with load torque",
         lower=0.0, dry=True, offered=frozenset({_OUTPUT}),
         basis=lambda m: _carried(-m.way_at_rest, m.load) * m.direction * _excess(m),
         fixed_base=True, held_by=frozenset({_BAM}), size=0.2, of_motor=True),
    Term("lifting_stribeck", "lifting Stribeck", "1/(N m)",
         "gear: growth of Stribeck friction with torque squared while the motor drives the load",
         lower=0.0, dry=True, offered=frozenset({_OUTPUT}),
         basis=lambda m: _opposed_torque(m) ** 2 * (m.direction * m.load < 0) * m.direction
         * _excess(m),
         fixed_base=True, held_by=frozenset({_BAM}), size=10.0, of_motor=True),
    Term("lowering_stribeck", "lowering Stribeck", "1/(N m)",
         "gear: growth of Stribeck friction with torque squared while the load drives the motor",
         lower=0.0, dry=True, offered=frozenset({_OUTPUT}),
         basis=lambda m: _opposed_torque(m) ** 2 * (m.direction * m.load > 0) * m.direction
         * _excess(m),
         fixed_base=True, held_by=frozenset({_BAM}), size=10.0, of_motor=True),
    Term("tilt", "tilt", "rad",
         "angle of the axis from the horizontal, visible in the weight of added masses",
         lower=0.0, sign_observable=False,
         offered=frozenset({_OUTPUT}),
         of_body=True, held_by=frozenset({_URDF}), size=-0.5),
    Term("base_compliance", "base compliance", "m/N",
         "compliance of a moving base; 0 for a fixed one",
         lower=0.0, state="base",
         describing=lambda w, a, m: base_describing_function(w, a, m.moment, m.base),
         offered=frozenset({_OUTPUT}), tried="rare"),
    Term("base_frequency", "base frequency", "rad/s",
         "natural frequency of the base, without added mass",
         lower=1.0, state="base",
         follows=frozenset({"base_compliance"}), offered=frozenset({_OUTPUT}),
         positive=True),
    Term("base_damping", "base damping", "–", "damping ratio of the base, without added mass",
         lower=0.0, state="base", most=2.0,
         follows=frozenset({"base_compliance"}), offered=frozenset({_OUTPUT})),
    Term("cogging", "cogging", "N m", "sine part of a torque periodic in the angle",
         basis=lambda m: -np.sin(m.periods * m.angle),
         potential=lambda x, n: -2 * np.sin(n * x / 2) ** 2 / n,
         describing=lambda _w, a, m: -m.periods * gravity_describing_function(m.periods * a),
         offered=frozenset({_WEAK, _OUTPUT, _ORBIT}),
         shifts_resonance=True, size=-2e-3),
    Term("cogging_cosine", "cogging, cosine", "N m",
         "cosine part of a torque periodic in the angle",
         basis=lambda m: -np.cos(m.periods * m.angle), potential=lambda x, n: -np.sin(n * x) / n,
         offered=frozenset({_WEAK, _OUTPUT, _ORBIT}),
         shifts_resonance=True, size=2e-3),
    Term("cogging_periods", "cogging periods", "–",
         "periods of that torque per turn; 1 for a misaligned clutch",
         lower=1.0,
         setting=True),
    Term("bristle_stiffness", "bristle stiffness", "N m/rad",
         "LuGre: stiffness of friction before it slides; 0 for rigid sticking",
         lower=0.0, state="deflection of the bristles",
         fixed_base=True),
    Term("bristle_damping", "bristle damping", "N m s/rad", "LuGre: damping of that friction",
         lower=0.0, state="deflection of the bristles"),
    Term("back_emf", "back EMF", "N m s/rad",
         "part of p2 that lags with the armature, and is 0 while a servo is off",
         lower=0.0, state="torque of the motor",
         offered=frozenset({_OUTPUT}), of_servo=True,
         held_by=frozenset({_BAM}), of_motor=True),
    Term("time_constant", "time constant", "s", "electrical time constant L/R of the armature",
         lower=0.0, state="torque of the motor",
         positive=True, fixed_base=True, shifts_resonance=True, of_motor=True),
    Term("dead_zone", "dead zone", "unit",
         "command below which the drive gives no torque",
         lower=0.0, basis=lambda m: np.sign(m.input), of_gain=True,
         looks_like="a dead zone of the drive", offered=frozenset({_WEAK, _OUTPUT}), tried="rare",
         size=2e-3, of_motor=True),
    Term("compression", "compression", "1/unit",
         "saturation c of a drive that gives v/(1 + c |v|)",
         lower=0.0, basis=lambda m: m.input * abs(m.input), of_gain=True,
         looks_like="a saturating drive",
         offered=frozenset({_WEAK, _OUTPUT, _ORBIT}), tried="rare", of_servo=True,
         recalibrated=True, size=4.0, of_motor=True),
    Term("loop_kp", "loop P gain", "–", "P gain of the servo loop, relative to the given one",
         lower=0.0, offered=frozenset({_OUTPUT}), of_motor=True),
    Term("loop_ki", "loop I gain", "–", "I gain of the servo loop, relative to the given one",
         lower=0.0, offered=frozenset({_OUTPUT}), of_motor=True),
    Term("loop_kd", "loop D gain", "–", "D gain of the servo loop, relative to the given one",
         lower=0.0, offered=frozenset({_OUTPUT}), of_motor=True),
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

OF_SCALE = ("p1", "p4")
"""Parameters of the scale, whose half-widths decide the verdict; no joint has a 0 of either."""

OF_GRAVITY = ("p3", "p3_offset")
"""Gravity moments along the line from pivot to added mass, and across it."""

OF_INPUT = tuple(row.name for row in _ROWS if row.needs in {"drive", "input"})
"""Terms that only an input shows."""

OF_MASS = {row.name for row in _ROWS if row.of_mass}
"""Terms that act on what is added alone."""

CHANGING = tuple(row.name for row in _ROWS if row.changes)
"""What changes from day to day, whatever is mounted: friction and gain."""

_LED = frozenset().union(*(row.follows for row in _ROWS))  # terms that bring others

PLAIN = tuple(
    row.name for row in _ROWS if row.tried == "common" and not (row.of_mass or row.name in _LED)
)
"""Common terms that need neither an added mass nor a setting."""

SETTINGS = {row.name for row in _ROWS if row.setting}
"""What other terms are taken at."""

STATES = ("base_compliance", "bristle_stiffness", "time_constant")
"""Terms that add a state to the joint where they are not 0."""

FIXED_BASE = tuple(row.name for row in _ROWS if row.fixed_base)
"""Terms that are not simulated on a base that moves."""

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

LEVEL = tuple(row.name for row in DRY if row.unit == "N m")
"""Terms whose sum is the friction of a bare joint at rest."""

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
    """Whether a term is simulated with others (see `FIXED_BASE`)."""
    base = BASE_TERMS[0]
    against = (base,) if name in FIXED_BASE else FIXED_BASE if name == base else ()
    return not any(other in others for other in against)


def offered(estimator: str) -> tuple[str, ...]:
    """Names of the optional terms of an estimator, in the table's order."""
    return tuple(row.name for row in _ROWS if estimator in row.offered)


def held_by(file: str) -> set[str]:
    """Names of the terms that have a place in a file: bam, urdf, or a model (a robot's own)."""
    return {row.name for row in _ROWS if file in row.held_by}


def lower_bounds(names: Iterable[str]) -> Samples:
    """(n,) lower bounds of n parameters; -inf for a name not in the table."""
    return np.array([TERMS[name].lower if name in TERMS else -np.inf for name in names])
