"""From motor and hand to the lumped parameters, and from these to physical parameters (6), (83).

A table of formulas: p1 and p4 by motor and hand, the equations solved for each physical parameter,
and derived quantities such as a resonance. A further quantity is a row with its symbol; console,
JSON, page and Python show it, its error by complex step.

Values with a joint covariance, and first-order propagation of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import ROUNDING, Samples
from butterfly.errors import InputError
from butterfly.identification.trust import SHOWS
from butterfly.logs.log import InputKind
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.model.prior import Known, Prior
from butterfly.model.terms import DISSIPATIVE, PARAMETERS, TERMS

Formula = Callable[[Mapping[str, Any]], Any]
"""A function of quantities by name; it takes complex numbers as well."""

_STEP = ROUNDING**2  # imaginary, of a complex-step derivative


@dataclass(frozen=True, kw_only=True, eq=False)
class Quantities:
    """Quantities with a joint covariance."""

    names: tuple[str, ...]  # The n quantities
    values: Samples  # (n,) in their units
    covariance: Samples  # (n, n), in their units; zeros for one that is known exactly

    @classmethod
    def of(cls, known: Mapping[str, Known]) -> Quantities:
        """Return quantities with independent errors."""
        return cls(
            names=tuple(known),
            values=np.array([quantity.value for quantity in known.values()]),
            covariance=np.diag([quantity.uncertainty**2 for quantity in known.values()]),
        )

    def find(self, formula: Formula) -> Known:
        """Return a formula's value and standard uncertainty, not finite where it divides by 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            gradient = self.gradient(formula)
            variance = float(gradient @ self.covariance @ gradient)
            value = float(formula(self._named(self.values)))
        return Known(value=value, uncertainty=float(np.sqrt(np.maximum(variance, 0.0))))

    def gradient(self, formula: Formula) -> Samples:
        """Return the (n,) derivatives of a formula by each quantity."""
        slopes = np.zeros(len(self.names))
        for k in range(slopes.size):
            moved = self.values.astype(complex)
            moved[k] += 1j * _STEP
            slopes[k] = np.imag(formula(self._named(moved))) / _STEP
        return slopes

    def _named(self, values: NDArray[Any]) -> dict[str, Any]:
        return dict(zip(self.names, values, strict=True))

    def combined_with(
        self, causes: Quantities, formulas: Mapping[str, Formula], *, new: frozenset[str]
    ) -> Quantities:
        """Return these and their causes, each updated by the information in the other.

        Some of these follow from the causes: x = f(c). Where that was used when these were
        estimated (as a prior), c depends on all else by x alone, so that with c ~ (c0, K) as
        given, the gradient G of f at c0 and x as estimated

            c = c0 + L (x - f(c0)) + remainder,   L = K G' (G K G')^-1,

        whose remainder has the covariance K - L G K and is independent of the estimate. Where it
        was not (``new``), x is first updated by f(c0), whose covariance is G K G'.
        """
        fresh = [name for name in formulas if name in new]
        updated = self._updated(causes, {name: formulas[name] for name in fresh})
        rows = [self.names.index(name) for name in formulas]
        slopes, excess = _linearised(updated, causes, formulas)
        prior = slopes @ causes.covariance @ slopes.T
        gain = causes.covariance @ slopes.T @ np.linalg.pinv(prior)
        inner = updated.covariance[np.ix_(rows, rows)]
        across = gain @ updated.covariance[rows]
        of_causes = causes.covariance + gain @ (inner - prior) @ gain.T
        return Quantities(
            names=(*updated.names, *causes.names),
            values=np.concatenate([updated.values, causes.values + gain @ excess]),
            covariance=np.block([[updated.covariance, across.T], [across, of_causes]]),
        )

    def _updated(self, causes: Quantities, formulas: Mapping[str, Formula]) -> Quantities:
        """Return these after a Kalman update by the values that follow from the causes."""
        rows = [self.names.index(name) for name in formulas]
        slopes, excess = _linearised(self, causes, formulas)
        spread = self.covariance[np.ix_(rows, rows)] + slopes @ causes.covariance @ slopes.T
        gain = self.covariance[:, rows] @ np.linalg.pinv(spread)
        return Quantities(
            names=self.names,
            values=self.values - gain @ excess,
            covariance=self.covariance - gain @ self.covariance[rows],
        )


def _linearised(
    quantities: Quantities, causes: Quantities, formulas: Mapping[str, Formula]
) -> tuple[Samples, Samples]:
    """Return the (m, n) derivatives of m formulas, and the (m,) found less computed values."""
    slopes = np.array([causes.gradient(formula) for formula in formulas.values()])
    follows = [causes.find(formula).value for formula in formulas.values()]
    rows = [quantities.names.index(name) for name in formulas]
    return slopes.reshape(len(rows), len(causes.names)), quantities.values[rows] - follows


BEST_SPEED = "speed where friction is known best"
"""Speed at which the correlated errors of p2 and T_c cancel, so that friction is known best."""


class Symbol(NamedTuple):
    """How a quantity is written: symbol, meaning, unit (of the input: "unit"), unit on a slide."""

    symbol: str
    meaning: str
    unit: str
    of_slide: str


_OF_PARTS = {
    "resistance": Symbol("R", "resistance", "Ohm", "Ohm"),
    "torque_constant": Symbol("k_t", "torque constant", "N m/A", "N m/A"),
    "back_emf_constant": Symbol("k_emf", "back-EMF constant", "V s/rad", "V s/rad"),
    "gear_ratio": Symbol("N", "gear ratio", "–", "rad/m"),
    "motor_current": Symbol("1/(N k_t) p₄", "current per unit of command", "A/unit", "A/unit"),
    "viscous_friction": Symbol("k_f", "viscous friction without back EMF", "N m s/rad", "N s/m"),
    "rotor_inertia": Symbol("J_r", "rotor inertia", "kg m²", "kg m²"),
    "hand_mass": Symbol("m_p", "mass", "kg", "kg"),
    "com_distance": Symbol("l_c", "pivot to centre of mass", "m", "–"),
    "com_offset": Symbol("l_o", "lateral offset of the centre of mass", "m", "–"),
    "hand_inertia": Symbol("J_p + m_p l²", "inertia about the pivot, without rotor", "kg m²", "–"),
    "inertia": Symbol("J_p", "inertia about the centre of mass", "kg m²", "–"),
    "inertia_with_rotor": Symbol(
        "J_p + N² J_r", "inertia about the centre of mass, with rotor", "kg m²", "–"
    ),
}


@dataclass(frozen=True)
class Way:
    """How a quantity follows from others."""

    name: str
    # Parameters, values of motor and hand, or `gravity` in m/s^2, that must be known
    needs: tuple[str, ...]
    formula: Formula
    _: KW_ONLY
    # Values that must not be known: there is a better way then, or the formula does not hold
    without: tuple[str, ...] = ()
    # Of a derived quantity, which is shown where it is significant; None for motor and hand
    symbol: Symbol | None = None
    combined: bool = False  # Whether to show it only where one of its needs is imprecise
    # input_kind, joint: Where it holds; everywhere if None
    input_kind: InputKind | None = None
    joint: JointKind | None = JointKind.HINGE

    def leads(self, names: Iterable[str], input_kind: InputKind, joint: JointKind) -> bool:
        """Whether the known values of ``names`` determine the quantity, which is not among them."""
        known = {*names}
        return (
            self.name not in known
            and known >= {*self.needs}
            and not known & {*self.without}
            and self.input_kind in {None, input_kind}
            and self.joint in {None, joint}
        )


def _rotor(of: Mapping[str, Any]) -> Any:  # noqa: ANN401 - real or complex
    return of["gear_ratio"] ** 2 * of["rotor_inertia"]


def _pull(of: Mapping[str, Any]) -> Any:  # noqa: ANN401 - real or complex
    """Weight of the hand across its axis."""
    return of["hand_mass"] * of["gravity"] * np.cos(of.get("tilt", 0.0))


def _about_mass(of: Mapping[str, Any]) -> Any:  # noqa: ANN401 - real or complex
    """Inertia about the centre of mass, that of the rotor included."""
    squared = of["p3"] ** 2 + of.get("p3_offset", 0.0) ** 2
    return of["p1"] - of["hand_mass"] * squared / _pull(of) ** 2


_MOTOR: dict[str, Any] = {"input_kind": InputKind.VOLTAGE, "joint": None}
_AMPERES: dict[str, Any] = {"input_kind": InputKind.CURRENT, "joint": None}
_SLIDE: dict[str, Any] = {"joint": JointKind.SLIDE}
_WEIGHED = ("hand_mass", "gravity", "p3")
_ROTOR = ("rotor_inertia", "gear_ratio")
_STIFFER = tuple(row.name for row in TERMS.values() if row.shifts_resonance)
_OTHER_FRICTION = tuple(
    row.name for row in DISSIPATIVE if not (row.name in PARAMETERS or row.of_mass)
)

OF_PARAMETERS = (
    Way(
        "p4",
        ("gear_ratio", "torque_constant", "resistance"),
        lambda of: of["gear_ratio"] * of["torque_constant"] / of["resistance"],
        **_MOTOR,
    ),
    Way(
        "p4",
        ("gear_ratio", "torque_constant"),
        lambda of: of["gear_ratio"] * of["torque_constant"],
        **_AMPERES,
    ),
    Way("p1", ("hand_mass", *_ROTOR), lambda of: of["hand_mass"] + _rotor(of), **_SLIDE),
)
"""Of a torque command R, N and k_t do not determine p4, which is 1, N or N k_t as the command means
N m at the joint, N m at the motor or A: nobody but the user knows which. Nor do they of a duty
without its supply."""

WAYS = (
    Way(
        "resistance",
        ("p4", "torque_constant", "gear_ratio"),
        lambda of: of["gear_ratio"] * of["torque_constant"] / of["p4"],
        **_MOTOR,
    ),
    Way(
        "torque_constant",
        ("p4", "resistance", "gear_ratio"),
        lambda of: of["p4"] * of["resistance"] / of["gear_ratio"],
        **_MOTOR,
    ),
    Way(
        "torque_constant", ("p4", "gear_ratio"), lambda of: of["p4"] / of["gear_ratio"], **_AMPERES
    ),
    Way(
        "viscous_friction",
        ("p2", "p4", "back_emf_constant", "gear_ratio"),
        lambda of: of["p2"] - of["gear_ratio"] * of["back_emf_constant"] * of["p4"],
        **_MOTOR,
    ),
    Way(
        "motor_current",
        ("p4", "torque_constant", "gear_ratio"),
        lambda of: of["p4"] / (of["gear_ratio"] * of["torque_constant"]),
        input_kind=InputKind.TORQUE,
        joint=None,
    ),
    Way("com_distance", _WEIGHED, lambda of: of["p3"] / _pull(of)),
    Way("com_offset", (*_WEIGHED, "p3_offset"), lambda of: of["p3_offset"] / _pull(of)),
    Way("hand_inertia", ("p1", *_ROTOR), lambda of: of["p1"] - _rotor(of)),
    Way("inertia", ("p1", *_WEIGHED, *_ROTOR), lambda of: _about_mass(of) - _rotor(of)),
    Way("inertia_with_rotor", ("p1", *_WEIGHED), _about_mass, without=("rotor_inertia",)),
    Way("hand_mass", ("p1", *_ROTOR), lambda of: of["p1"] - _rotor(of), **_SLIDE),
    Way(
        "rotor_inertia",
        ("p1", "hand_mass", "gear_ratio"),
        lambda of: (of["p1"] - of["hand_mass"]) / of["gear_ratio"] ** 2,
        **_SLIDE,
    ),
    Way(
        "resonance",
        ("p1", "p2", "p3"),
        lambda of: np.sqrt(of["p3"] / of["p1"] - (of["p2"] / of["p1"]) ** 2 / 2),
        symbol=Symbol("ω_r", "resonance of small swings, bare joint", "rad/s", "–"),
        without=_STIFFER,
    ),
    Way(
        "damping_ratio",
        ("p1", "p2", "p3"),
        lambda of: of["p2"] / (2 * np.sqrt(of["p1"] * of["p3"])),
        symbol=Symbol("ζ", "damping ratio of small swings, bare joint", "–", "–"),
        without=_STIFFER,
    ),
    Way(
        "decay_time",
        ("p1", "p2"),
        lambda of: of["p1"] / of["p2"],
        symbol=Symbol("p₁/p₂", "time constant of the speed, bare joint", "s", "s"),
        without=("time_constant",),
        joint=None,
    ),
    Way(
        "speed_gain",
        ("p2", "p4"),
        lambda of: of["p4"] / of["p2"],
        symbol=Symbol("p₄/p₂", "speed per unit of input", "rad/s/unit", "m/s/unit"),
        without=("drag",),
        joint=None,
    ),
    Way(
        "stiffness_ratio",
        ("p1", "p3"),
        lambda of: of["p3"] / of["p1"],
        symbol=Symbol("p₃/p₁", "gravity moment over inertia, bare joint", "1/s²", "–"),
        combined=True,
    ),
    Way(
        "friction_speed",
        (BEST_SPEED, "p2", "coulomb"),
        lambda of: of[BEST_SPEED],
        symbol=Symbol("v", "speed where friction is known best", "rad/s", "m/s"),
        combined=True,
        joint=None,
    ),
    Way(
        "friction",
        (BEST_SPEED, "p2", "coulomb"),
        lambda of: of["coulomb"] + of["p2"] * of[BEST_SPEED],
        symbol=Symbol("T_c + p₂ v", "friction at that speed", "N m", "N"),
        without=_OTHER_FRICTION,
        combined=True,
        joint=None,
    ),
)
"""Ways to physical parameters and derived quantities; only those whose needs are known apply."""

SYMBOLS = _OF_PARTS | {way.name: way.symbol for way in WAYS if way.symbol is not None}
"""Symbols of all quantities."""

SIGNED = frozenset({"com_distance", "com_offset", "motor_current"} | (SYMBOLS.keys() - _OF_PARTS))
"""Those that may be negative."""


def relaxed_for_masses(known: Prior, masses: Iterable[AddedMass]) -> Prior:
    """Return the prior; with uncertain masses exact p1 and p3 become uncertain, to be fitted."""
    uncertain = [mass for mass in masses if mass.mass_uncertainty or mass.arm_uncertainty]
    largest = {
        "p1": max((mass.inertia for mass in uncertain), default=0.0),
        "p3": max((mass.gravity_moment for mass in uncertain), default=0.0),
    }
    relaxed = {
        name: Known(value=known.fixed[name], uncertainty=ROUNDING * size)
        for name, size in largest.items()
        if name in known.fixed and size
    }
    return known | Prior(relaxed)


def with_gear(physical: Mapping[str, Known], joint: JointKind) -> dict[str, Known]:
    """Return known physical values; a hinge without a gear ratio has that of 1."""
    direct = {} if joint is JointKind.SLIDE else {"gear_ratio": Known(value=1.0)}
    return direct | dict(physical)


def relations(physical: Mapping[str, Known], input_kind: InputKind, joint: JointKind) -> list[Way]:
    """Return the ways to parameters that known values of motor and hand determine."""
    known = with_gear(physical, joint)
    return [way for way in OF_PARAMETERS if way.leads(known, input_kind, joint)]


def _by_motor_and_hand(given: Prior, input_kind: InputKind, joint: JointKind) -> dict[str, Known]:
    """Return the parameters that follow from known values of motor and hand."""
    motor = Quantities.of(with_gear(given.physical, joint))
    ways = relations(given.physical, input_kind, joint)
    return {way.name: motor.find(way.formula) for way in ways}


def implied(given: Prior, input_kind: InputKind, joint: JointKind = JointKind.HINGE) -> Prior:
    """Return the prior with the parameters that follow from it; two sources are averaged."""
    both = {
        name: _both(name, given.parameters[name], value) if name in given.parameters else value
        for name, value in _by_motor_and_hand(given, input_kind, joint).items()
    }
    return given | Prior(both)


def discrepancies(
    given: Prior, input_kind: InputKind, joint: JointKind = JointKind.HINGE
) -> dict[str, float]:
    """Return differences of parameters with two sources, in standard uncertainties."""
    pairs = {
        name: (value, given.parameters[name])
        for name, value in _by_motor_and_hand(given, input_kind, joint).items()
        if name in given.parameters
    }
    return {
        name: abs(one.value - other.value) / math.hypot(one.uncertainty, other.uncertainty)
        for name, (one, other) in pairs.items()
        if not (one.fixed and other.fixed)
    }


def _both(name: str, given: Known, follows: Known) -> Known:
    """Return the weighted mean of two sources, one of which may be exact."""
    if given.fixed and follows.fixed:
        if not math.isclose(given.value, follows.value, rel_tol=SHOWS):
            expected = f"{follows.value:.5g}, by the other known values, or an uncertainty"
            raise InputError("known", name, f"{given.value:g}", expected)
        return given
    weight = follows.uncertainty**2 / (given.uncertainty**2 + follows.uncertainty**2)
    value = weight * given.value + (1 - weight) * follows.value
    return Known(value=value, uncertainty=math.sqrt(weight) * given.uncertainty)
