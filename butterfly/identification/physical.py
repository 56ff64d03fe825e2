"""From an estimate, and what is known of motor and hand, on to their physical parameters (6), (83).

Motion determines p1..p4, which are combinations of more than four physical parameters (7). Each
physical parameter that is measured otherwise makes others identifiable.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from operator import itemgetter

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.derived_quantities import (
    BEST_SPEED,
    SIGNED,
    SYMBOLS,
    WAYS,
    relations,
    with_gear,
)
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.levels import MATTERS, SPREADS
from butterfly.identification.quantities import Quantities
from butterfly.logs.log import InputKind
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.model.prior import Known, Prior


@dataclass(frozen=True, kw_only=True)
class PhysicalParameter:
    """One physical parameter."""

    name: str  # In `butterfly.identification.derived_quantities.SYMBOLS`
    unit: str  # Of all three
    # value, standard_error: In its unit
    value: float
    standard_error: float
    half_width: float  # Of its 95 % interval
    given: Known | None = None  # Prior value, if any

    @property
    def below_zero(self) -> float:
        """By how many standard errors, of the interval, it is below 0 although it cannot be."""
        if self.name in SIGNED or not self.value < 0:
            return 0.0
        return float(-self.value / self.half_width * SPREADS) if self.half_width else math.inf


class Missing(StrEnum):
    """Value that is missing to identify physical parameters; `UNUSED`: one without effect."""

    MASS = "mass"
    GRAVITY = "gravity"
    ROTOR = "rotor"
    ROTOR_OF_SLIDE = "rotor-of-slide"
    GAIN = "gain"
    BACK_EMF = "back-emf"
    GEAR = "gear"
    COMMAND = "command"
    UNUSED = "unused"
    SUPPLY = "supply"


@dataclass(frozen=True, kw_only=True)
class Unidentified:
    """Physical parameters that cannot be identified."""

    missing: Missing
    names: tuple[str, ...] = ()  # Of known values that have no effect with this input
    most: Known | None = None  # Upper bound of the back-EMF constant


@dataclass(frozen=True, kw_only=True)
class PhysicalParameters:
    """The physical parameters that are identified, and those that are not."""

    # The parameters that follow, or whose uncertainty is below that of their prior
    parameters: tuple[PhysicalParameter, ...]
    unidentified: tuple[Unidentified, ...]

    def __getitem__(self, name: str) -> PhysicalParameter:
        """Return an identified parameter by name."""
        return {parameter.name: parameter for parameter in self.parameters}[name]


def physical_parameters(
    estimate: Estimate, known: Prior, input_kind: InputKind, carrier: AddedMass
) -> PhysicalParameters:
    """Return the physical parameters that follow from an estimate, errors to first order.

    Half-widths are propagated from those of the estimate's intervals, which exceed its standard
    errors, with the same correlations. A prior of p4 in ``estimate.known`` is not used twice (see
    `Quantities.combined_with`). ``carrier``: any added mass of the joint, for its kind and gravity.
    """
    joint = carrier.joint
    by_errors, by_intervals = (
        _combined(estimate, covariance, known, input_kind, carrier)
        for covariance in (estimate.covariance, estimate.interval_covariance)
    )
    names = {*by_errors.names} - {*estimate.unestimated}
    well = {row.name for row in estimate.table() if row.claim in {"precise", "known"}}
    ways = [
        way
        for way in WAYS
        if way.leads(names, input_kind, joint)
        and not (way.combined and well >= {*way.needs} - {BEST_SPEED})
    ]
    given = {name: itemgetter(name) for name in known.physical}
    derived = {way.name for way in ways if way.symbol is not None}
    parameters = []
    for name, formula in (given | {way.name: way.formula for way in ways}).items():
        value, prior = by_errors.find(formula), known.physical.get(name)
        half_width = SPREADS * by_intervals.find(formula).uncertainty
        if name in derived and (not math.isfinite(value.value) or half_width >= abs(value.value)):
            continue
        if prior is None or value.uncertainty < (1 - MATTERS) * prior.uncertainty:
            parameters.append(
                PhysicalParameter(
                    name=name,
                    unit=_unit(name, input_kind, joint),
                    value=value.value,
                    standard_error=value.uncertainty,
                    half_width=half_width,
                    given=prior,
                )
            )
    return PhysicalParameters(
        parameters=tuple(
            sorted(parameters, key=lambda parameter: [*SYMBOLS].index(parameter.name))
        ),
        unidentified=tuple(_unidentified(by_errors, known, input_kind, carrier)),
    )


def _unit(name: str, input_kind: InputKind, joint: JointKind) -> str:
    unit = SYMBOLS[name].of_slide if joint is JointKind.SLIDE else SYMBOLS[name].unit
    return unit.replace("unit", input_kind.unit)


def _combined(
    estimate: Estimate, covariance: Samples, known: Prior, input_kind: InputKind, carrier: AddedMass
) -> Quantities:
    """Return lumped and known physical parameters, each updated by the information in the other."""
    joint = carrier.joint
    causes = with_gear(known.physical, joint)
    if carrier.gravity:
        causes["gravity"] = Known(value=carrier.gravity)
    lumped = _estimated(estimate, covariance)
    links = relations(known.physical, input_kind, joint)
    if not np.isfinite(lumped.covariance).all():
        links = []  # without a covariance no update is defined
    links = [way for way in links if way.name in lumped.names]
    used = {
        way.name
        for way in relations(estimate.known.physical, input_kind, joint)
        if way.name in estimate.known.parameters
    }
    return lumped.combined_with(
        Quantities.of(causes),
        {way.name: way.formula for way in links},
        new=frozenset(way.name for way in links) - used,
    )


def _estimated(estimate: Estimate, block: Samples) -> Quantities:
    """Return the lumped parameters with an (n, n) covariance; fixed ones are exact."""
    held = {
        name: value
        for name, value in (estimate.known.fixed | estimate.fixed).items()
        if name not in estimate.names
    }
    if {"p2", "coulomb"} <= {*estimate.names}:
        p2, coulomb = (estimate.names.index(name) for name in ("p2", "coulomb"))
        speed = -estimate.covariance[p2, coulomb] / estimate.covariance[p2, p2]
        held |= {BEST_SPEED: float(speed)} if 0 < speed < math.inf else {}
    n, count = len(estimate.names), len(estimate.names) + len(held)
    covariance = np.zeros((count, count))
    covariance[:n, :n] = block
    return Quantities(
        names=(*estimate.names, *held),
        values=np.array([*estimate.values.tolist(), *held.values()]),
        covariance=covariance,
    )


def _unidentified(
    quantities: Quantities, known: Prior, input_kind: InputKind, carrier: AddedMass
) -> Iterator[Unidentified]:
    """Yield the unidentified parameters of load, rotor and motor."""
    given = known.physical.keys()
    hinge = carrier.joint is JointKind.HINGE
    if not hinge and "gear_ratio" not in given:
        yield Unidentified(missing=Missing.GEAR)
    if hinge and not carrier.gravity:
        yield Unidentified(missing=Missing.GRAVITY)
    elif hinge and "hand_mass" not in given:
        yield Unidentified(missing=Missing.MASS)
    if not given & ({"rotor_inertia"} if hinge else {"rotor_inertia", "hand_mass"}):
        yield Unidentified(missing=Missing.ROTOR if hinge else Missing.ROTOR_OF_SLIDE)
    yield from _unidentified_of_motor(quantities, known, input_kind)


def _unidentified_of_motor(
    quantities: Quantities, known: Prior, input_kind: InputKind
) -> Iterator[Unidentified]:
    """Yield the unidentified parameters of the motor."""
    given = known.physical.keys()
    if input_kind in {InputKind.TORQUE, InputKind.CURRENT}:
        if input_kind is InputKind.TORQUE and "p4" not in known.parameters:
            yield Unidentified(missing=Missing.COMMAND)
        idle = tuple(sorted(given & {"resistance", "back_emf_constant"}))
        if idle:
            yield Unidentified(missing=Missing.UNUSED, names=idle)
        return
    if input_kind is InputKind.DUTY:
        yield Unidentified(missing=Missing.SUPPLY)
        return
    if not given & {"resistance", "torque_constant"}:
        yield Unidentified(missing=Missing.GAIN)
    if "back_emf_constant" not in given:
        yield Unidentified(missing=Missing.BACK_EMF, most=_most_back_emf(quantities))


def _most_back_emf(quantities: Quantities) -> Known | None:
    """Return the back-EMF constant if p2 were back EMF alone, its upper bound; None if unknown."""
    if not {"p2", "p4", "gear_ratio"} <= {*quantities.names}:
        return None
    return quantities.find(lambda of: of["p2"] / (of["gear_ratio"] * of["p4"]))
