"""From an estimate, and what is known of motor and hand, on to their physical parameters (6), (83).

Motion tells p1..p4, which are made of more than four physical parameters (7). Each of these that is
measured otherwise separates others.
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
from butterfly.identification.estimate import Estimate
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
    reach: float  # Half-width of its 95 % interval
    told: Known | None = None  # What was known of it before

    @property
    def below_zero(self) -> float:
        """By how many standard errors, of the interval, it is below 0 although it cannot be."""
        if self.name in SIGNED or not self.value < 0:
            return 0.0
        return float(-self.value / self.reach * SPREADS) if self.reach else math.inf


class Lack(StrEnum):
    """What motion does not tell, and which measurement would."""

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
class Unseparated:
    """Something that cannot be told."""

    lack: Lack  # What
    names: tuple[str, ...] = ()  # Of the knowledge that says nothing here
    most: Known | None = None  # What the back-EMF constant can be at most


@dataclass(frozen=True, kw_only=True)
class PhysicalParameters:
    """What is told, and what is not."""

    # The parameters that follow, or are known better than they were told
    found: tuple[PhysicalParameter, ...]
    unseparated: tuple[Unseparated, ...]  # What is left open

    def __getitem__(self, name: str) -> PhysicalParameter:
        """Return a parameter that was found."""
        return {each.name: each for each in self.found}[name]


def physical_parameters(
    estimate: Estimate, known: Prior, input_kind: InputKind, carrier: AddedMass
) -> PhysicalParameters:
    """Separate what the lumped parameters are made of, errors propagated to first order.

    Half-widths are those of the intervals, which are wider, with the same correlations. What
    ``estimate.known`` says of p4 has made it: R and k_t then depend on it (see
    `Quantities.told_of`). ``carrier`` is any added mass of the joint, for its kind and gravity.
    """
    joint = carrier.joint
    of_intervals = np.maximum(estimate.farther / SPREADS, estimate.standard_errors)
    narrow, wide = (
        _together(estimate, errors, known, input_kind, carrier)
        for errors in (estimate.standard_errors, of_intervals)
    )
    names = {*narrow.names} - {*estimate.unestimated}
    well = {row.name for row in estimate.table() if row.claim in {"precise", "known"}}
    ways = [
        way
        for way in WAYS
        if way.leads(names, input_kind, joint)
        and not (way.combined and well >= {*way.needs} - {BEST_SPEED})
    ]
    told = {name: itemgetter(name) for name in known.physical}
    derived = {way.name for way in ways if way.symbol is not None}
    found = []
    for name, formula in (told | {way.name: way.formula for way in ways}).items():
        value, before = narrow.find(formula), known.physical.get(name)
        reach = SPREADS * wide.find(formula).uncertainty
        if name in derived and (not math.isfinite(value.value) or reach >= abs(value.value)):
            continue
        if before is None or value.uncertainty < (1 - MATTERS) * before.uncertainty:
            found.append(
                PhysicalParameter(
                    name=name,
                    unit=_unit(name, input_kind, joint),
                    value=value.value,
                    standard_error=value.uncertainty,
                    reach=reach,
                    told=before,
                )
            )
    return PhysicalParameters(
        found=tuple(sorted(found, key=lambda each: [*SYMBOLS].index(each.name))),
        unseparated=tuple(_unseparated(narrow, known, input_kind, carrier)),
    )


def _unit(name: str, input_kind: InputKind, joint: JointKind) -> str:
    unit = SYMBOLS[name].of_slide if joint is JointKind.SLIDE else SYMBOLS[name].unit
    return unit.replace("unit", input_kind.unit)


def _together(
    estimate: Estimate, errors: Samples, known: Prior, input_kind: InputKind, carrier: AddedMass
) -> Quantities:
    """Return lumped and physical parameters, of which each tells of the other."""
    joint = carrier.joint
    causes = with_gear(known.physical, joint)
    if carrier.gravity:
        causes["gravity"] = Known(value=carrier.gravity)
    lumped = _estimated(estimate, errors)
    links = relations(known.physical, input_kind, joint)
    if not np.isfinite(lumped.covariance).all():
        links = []  # what is known how well tells nothing of what is not
    links = [each for each in links if each.name in lumped.names]
    used = {
        each.name
        for each in relations(estimate.known.physical, input_kind, joint)
        if each.name in estimate.known.parameters
    }
    return lumped.told_of(
        Quantities.of(causes),
        {each.name: each.formula for each in links},
        new=frozenset(each.name for each in links) - used,
    )


def _estimated(estimate: Estimate, errors: Samples) -> Quantities:
    """Return the lumped parameters, those that were held exactly known."""
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
    own = estimate.standard_errors
    scale = np.divide(errors, own, out=np.ones(n), where=own > 0)
    covariance[:n, :n] = estimate.covariance * np.outer(scale, scale)
    return Quantities(
        names=(*estimate.names, *held),
        values=np.array([*estimate.values.tolist(), *held.values()]),
        covariance=covariance,
    )


def _unseparated(
    found: Quantities, known: Prior, input_kind: InputKind, carrier: AddedMass
) -> Iterator[Unseparated]:
    """Say what is left open (see `Lack`)."""
    told = known.physical.keys()
    hinge = carrier.joint is JointKind.HINGE
    if not hinge and "gear_ratio" not in told:
        yield Unseparated(lack=Lack.GEAR)
    if hinge and not carrier.gravity:
        yield Unseparated(lack=Lack.GRAVITY)
    elif hinge and "hand_mass" not in told:
        yield Unseparated(lack=Lack.MASS)
    if not told & ({"rotor_inertia"} if hinge else {"rotor_inertia", "hand_mass"}):
        yield Unseparated(lack=Lack.ROTOR if hinge else Lack.ROTOR_OF_SLIDE)
    yield from _unseparated_of_motor(found, known, input_kind)


def _unseparated_of_motor(
    found: Quantities, known: Prior, input_kind: InputKind
) -> Iterator[Unseparated]:
    """Say what is left open of what the motor's torque is made of."""
    told = known.physical.keys()
    if input_kind in {InputKind.TORQUE, InputKind.CURRENT}:
        if input_kind is InputKind.TORQUE and "p4" not in known.parameters:
            yield Unseparated(lack=Lack.COMMAND)
        idle = tuple(sorted(told & {"resistance", "back_emf_constant"}))
        if idle:
            yield Unseparated(lack=Lack.UNUSED, names=idle)
        return
    if input_kind is InputKind.DUTY:
        yield Unseparated(lack=Lack.SUPPLY)
        return
    if not told & {"resistance", "torque_constant"}:
        yield Unseparated(lack=Lack.GAIN)
    if "back_emf_constant" not in told:
        yield Unseparated(lack=Lack.BACK_EMF, most=_most_back_emf(found))


def _most_back_emf(found: Quantities) -> Known | None:
    """Return what the back-EMF constant can be, were there no other viscous friction."""
    if not {"p2", "p4", "gear_ratio"} <= {*found.names}:
        return None
    return found.find(lambda of: of["p2"] / (of["gear_ratio"] * of["p4"]))
