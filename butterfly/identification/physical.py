"""From an estimate, and what is known of motor and hand, on to their physical parameters (6), (83).

Motion determines p1..p4, which are combinations of more than four physical parameters (7). Each
physical parameter that is measured otherwise makes others identifiable.

Whether an estimate is plausible: it follows the logs, and a joint can have its parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from enum import StrEnum
from operator import itemgetter

import numpy as np
from scipy.special import stdtrit

from butterfly.arrays import Samples
from butterfly.identification.data import DataSet
from butterfly.identification.derived_quantities import (
    BEST_SPEED,
    SIGNED,
    SYMBOLS,
    WAYS,
    Quantities,
    discrepancies,
    relations,
    with_gear,
)
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import LEAST_FIT
from butterfly.identification.segments import assumes_clock
from butterfly.identification.trust import CLEARLY, MATTERS, Finding, FindingKind
from butterfly.logs.log import InputKind
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.model.prior import LAG, Known, Prior
from butterfly.model.terms import LEVEL, OF_INPUT, TERMS
from butterfly.verdict import CONFIDENCE, SPREADS


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


BETTER_METHOD = "The method {0} finds a joint that follows these logs: --method {0}."
"""What is said where another method does."""

_EARLY = 1e-4  # s, by which stamps of input and angle may differ

LEAST_RESISTANCE = 0.01
"""Ohm; no motor of a robot's joint has less."""


def judge_physics(estimate: Estimate, masses: Sequence[AddedMass]) -> list[Finding]:
    """Return findings of impossible values: no inertia, negative friction, a negative delay."""
    parameters = estimate.parameters
    judged = []
    least = min((parameters.p1 + mass.inertia for mass in masses), default=parameters.p1)
    if not least > 0:
        judged.append(Finding(FindingKind.NO_INERTIA, ("p1",), number=least))
    half = np.nan_to_num((estimate.upper - estimate.lower) / 2).tolist()
    rows = list(zip(estimate.names, estimate.values.tolist(), half, strict=True))
    negative = [name for name, value, error in rows if TERMS[name].lower == 0 and value < -error]
    if "load" in estimate.names and any(_drives(estimate, mass) for mass in masses):
        negative.append("load")
    if negative:
        judged.append(Finding(FindingKind.NEGATIVE, tuple(negative)))
    if any(n == "delay" and value < -max(e, _EARLY) for n, value, e in rows):
        judged.append(Finding(FindingKind.EARLY, ("delay",)))
    # possible: angle or input may count the other way
    if parameters.p4 < 0 and "p4" not in estimate.known.parameters:
        judged.append(Finding(FindingKind.NEGATIVE_GAIN, ("p4",)))
    return judged


def is_possible(estimate: Estimate, masses: Sequence[AddedMass]) -> bool:
    """Whether a joint can have the parameters (see `judge_physics`)."""
    return not any(finding.impossible for finding in judge_physics(estimate, masses))


def _drives(estimate: Estimate, mass: AddedMass) -> bool:
    """Whether friction that grows with the added weight is clearly negative with some mass."""
    weights = np.isin(estimate.names, LEVEL).astype(float)
    weights[estimate.names.index("load")] = mass.weight
    error = float(np.sqrt(max(weights @ estimate.covariance @ weights, 0.0)))
    level = estimate.parameters.with_added_mass(mass).level(0.0)
    # A sum has hardly fewer degrees of freedom than the fewest of its parts.
    freedom = np.inf if estimate.freedom is None else estimate.freedom[weights != 0].min()
    return bool(level < -stdtrit(freedom, 0.5 + CONFIDENCE / 2) * error)


def judge_input(estimate: Estimate, kind: InputKind) -> list[Finding]:
    """Return findings on the input: a voltage-driven motor has p2 >= K^2/R = p4^2 R (6)."""
    if kind is InputKind.NONE:
        return [Finding(FindingKind.UNDRIVEN, OF_INPUT)]
    if kind is not InputKind.VOLTAGE or "p4" not in estimate.names:
        return []
    upper = {"p2": estimate.parameters.p2}  # where it is known
    upper |= dict(zip(estimate.names, estimate.upper.tolist(), strict=True))
    p4 = abs(estimate.parameters.p4)
    if not upper["p2"] >= 0 or not p4 > 0:
        return []
    resistance = upper["p2"] / p4**2
    if resistance >= LEAST_RESISTANCE:
        return []
    return [Finding(FindingKind.TORQUE_DRIVEN, ("p2", "p4"), number=resistance)]


def judge_units(data: DataSet) -> list[Finding]:
    """Return findings of the units assumed for inputs whose files state none that is understood."""
    units: dict[tuple[str, ...], tuple[tuple[str, ...], list[str]]] = {}
    for log, health in zip(data.logs, data.health, strict=True):
        read = health.columns.get("input")
        if read is None or not read.assumed or not health.driven:
            continue
        kind = FindingKind.UNIT_UNREAD if read.unread else FindingKind.UNIT_ASSUMED
        what = astuple(read.unread) if read.unread else (read.unit,)
        _, names = units.setdefault((kind, *what[:2]), (what, []))
        names.append(log.name)
    return [
        Finding(FindingKind(key[0]), ("p4", *what), logs=tuple(names))
        for key, (what, names) in units.items()
    ]


def judge_knowledge(estimate: Estimate, data: DataSet) -> list[Finding]:
    """Return contradictions: p4 by two sources, physical parameters that are clearly negative."""
    carrier = data.logs[0].added_mass
    sources = discrepancies(data.given, data.input_kind, carrier.joint)
    findings = [
        Finding(FindingKind.SOURCES_CONFLICT, (name,), number=far)
        for name, far in sources.items()
        if far > CLEARLY
    ]
    physical = physical_parameters(estimate, data.known, data.input_kind, carrier)
    below = {
        parameter.name: parameter.below_zero
        for parameter in physical.parameters
        if parameter.below_zero > CLEARLY
    }
    if below:
        findings.append(Finding(FindingKind.CONTRADICTED, tuple(below), number=max(below.values())))
    return findings


def judge_basis(estimate: Estimate, data: DataSet) -> list[Finding]:
    """Return the scales that no log can identify and that were given without an uncertainty."""
    loads = [log.added_mass for log in data.logs if log.added_mass.mass]
    open_ = {
        "mass_scale": loads and not any(mass.mass_uncertainty for mass in loads),
        "arm": loads and not any(mass.arm_uncertainty for mass in loads),
        "gravity_scale": any(mass.gravity_moment for mass in loads),
        "input_scale": "p4" in estimate.names,
        "angle_scale": not all(log.integrated for log in data.logs),
        "velocity_scale": any(log.integrated for log in data.logs)
        and "angle_scale" not in data.known.values,
        "time_scale": True,
        LAG: "delay" in estimate.names,
        "loop_clock": any(map(assumes_clock, data.logs)),
    }
    rests = tuple(
        name for name, is_open in open_.items() if is_open and name not in data.known.values
    )
    return [Finding(FindingKind.RESTS_ON, rests)] if rests else []


def judge_fit(fits: Samples) -> list[Finding]:
    """Return the finding of a poor fit, by the (n,) FIT in % of n free runs, or none."""
    median = float(np.median(fits))
    return [] if median >= LEAST_FIT else [Finding(FindingKind.POOR_FIT, number=median)]
