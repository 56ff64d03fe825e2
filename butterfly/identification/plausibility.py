"""Whether an estimate is plausible: it follows the logs, and a joint can have its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple

import numpy as np
from scipy.special import stdtrit

from butterfly.arrays import Samples
from butterfly.identification.data import DataSet
from butterfly.identification.derived_quantities import discrepancies
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.free_run import LEAST_FIT
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.levels import CLEARLY, CONFIDENCE
from butterfly.identification.physical import physical_parameters
from butterfly.identification.servo_drive import assumes_clock
from butterfly.logs.log import InputKind
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import LAG
from butterfly.model.terms import LEVEL, OF_INPUT, TERMS

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
