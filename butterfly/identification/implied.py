"""From what is known of motor and hand to what that says of the model's parameters (6)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from butterfly.errors import InputError
from butterfly.identification.quantities import Formula, Quantities
from butterfly.logs.log import InputKind
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.model.prior import Known, Prior

_ROUNDING = 1e-3  # relative; by which exact numbers may differ
_NEXT_TO_EXACT = 1e-8  # of the largest added mass's share, an uncertainty that is none


@dataclass(frozen=True, kw_only=True)
class Relation:
    """A parameter that follows from what is known of motor and hand."""

    parameter: str
    needs: tuple[str, ...]  # names of `butterfly.model.prior.PHYSICAL`
    formula: Formula


_GAIN = Relation(
    parameter="p4",
    needs=("gear_ratio", "torque_constant", "resistance"),
    formula=lambda of: of["gear_ratio"] * of["torque_constant"] / of["resistance"],
)
_MOVING_MASS = Relation(
    parameter="p1",
    needs=("hand_mass", "gear_ratio", "rotor_inertia"),
    formula=lambda of: of["hand_mass"] + of["gear_ratio"] ** 2 * of["rotor_inertia"],
)


def beside_masses(known: Prior, masses: Iterable[AddedMass]) -> Prior:
    """Return what is known of p1 and p3, next to exactly where it stands beside uncertain masses.

    How far masses that were weighed badly move the other parameters is told by how these two do:
    they have to be among those that are fitted.
    """
    doubtful = [mass for mass in masses if mass.mass_uncertainty or mass.arm_uncertainty]
    largest = {
        "p1": max((mass.inertia for mass in doubtful), default=0.0),
        "p3": max((mass.gravity_moment for mass in doubtful), default=0.0),
    }
    softened = {
        name: Known(value=known.fixed[name], uncertainty=_NEXT_TO_EXACT * size)
        for name, size in largest.items()
        if name in known.fixed and size
    }
    return replace(known, parameters={**known.parameters, **softened}) if softened else known


def with_gear(physical: Mapping[str, Known], joint: JointKind) -> dict[str, Known]:
    """Return what is known, a motor without a gear turning as its hinge does.

    How far a motor turns while a slide moves by 1 m is nothing to be assumed.
    """
    direct = {} if joint is JointKind.SLIDE else {"gear_ratio": Known(value=1.0)}
    return direct | dict(physical)


def relations(
    physical: Mapping[str, Known], input_kind: InputKind, joint: JointKind
) -> list[Relation]:
    """Return the relations of which all is known, by names of `butterfly.model.prior.PHYSICAL`.

    Of a voltage p4 = N k_t/R. Of a torque command neither R nor N nor k_t tells p4, which is 1, N
    or N k_t as the command means N m at the joint, N m at the motor or A: nobody but the user knows
    which. Of a slide p1 = m_p + N^2 J_r, with N in rad/m.
    """
    known = with_gear(physical, joint).keys()
    held = {_GAIN: input_kind is InputKind.VOLTAGE, _MOVING_MASS: joint is JointKind.SLIDE}
    return [each for each, holds in held.items() if holds and known >= set(each.needs)]


def implied(told: Prior, input_kind: InputKind, joint: JointKind = JointKind.HINGE) -> Prior:
    """Return what is told, and what it says of parameters, uncertainties propagated.

    A parameter that is told itself as well has two sources, whose weights are the inverses of their
    variances; what is known exactly counts alone. This is to be done once only, with all that is
    told.
    """
    follows = _follow(told, input_kind, joint)
    both = {
        name: _both(name, told.parameters[name], each) if name in told.parameters else each
        for name, each in follows.items()
    }
    return told | Prior(parameters=both)


def apart(
    told: Prior, input_kind: InputKind, joint: JointKind = JointKind.HINGE
) -> dict[str, float]:
    """Return how far parameters with two sources are apart, in standard uncertainties."""
    return {
        name: abs(each.value - told.parameters[name].value)
        / math.hypot(each.uncertainty, told.parameters[name].uncertainty)
        for name, each in _follow(told, input_kind, joint).items()
        if name in told.parameters and not (each.fixed and told.parameters[name].fixed)
    }


def _follow(told: Prior, input_kind: InputKind, joint: JointKind) -> dict[str, Known]:
    motor = Quantities.of(with_gear(told.physical, joint))
    return {
        each.parameter: motor.find(each.formula)
        for each in relations(told.physical, input_kind, joint)
    }


def _both(name: str, told: Known, follows: Known) -> Known:
    """Return what two sources tell together."""
    if told.fixed and follows.fixed:
        if not math.isclose(told.value, follows.value, rel_tol=_ROUNDING):
            expected = f"{follows.value:.5g}, which follows from the others, or an uncertainty"
            raise InputError("known", name, f"{told.value:g}", expected)
        return told
    weight = follows.uncertainty**2 / (told.uncertainty**2 + follows.uncertainty**2)
    value = weight * told.value + (1 - weight) * follows.value
    return Known(value=value, uncertainty=math.sqrt(weight) * told.uncertainty)
