"""What an identification says of attributes of the robot's own model, beside today's values.

The identified p1 is that of links, rotor and whatever the actuators add:

    p1 = s J + armature + gear^2 armature of actuators,

with the inertia J of the model's links about the axis and the factor s by which their masses are
off. Where all are off by one factor, gravity tells it, s = p3 over the model's gravity moment, and
their error cancels; where each is off by itself, J has an error of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from butterfly.identification.derived_quantities import Formula, Quantities
from butterfly.identification.estimate import Estimate
from butterfly.identification.identified import Identified
from butterfly.identification.trust import unit_of
from butterfly.logs.log import InputKind
from butterfly.logs.model_facts import ActuatorFacts, ModelFacts
from butterfly.model.prior import Known
from butterfly.verdict import SPREADS

_SCALE = "scale of the links' masses"


@dataclass(frozen=True, kw_only=True)
class ModelRow:
    """An attribute of the model: what was identified, and what the file says."""

    element: str
    """Of the file: ``joint``, or an actuator's element."""
    name: str
    """Of that element."""
    attribute: str
    unit: str
    value: float
    half_width: float
    """Of its 95 % interval; NaN if unknown."""
    now: float | None
    """What the file says; None where it says nothing."""
    writes: bool = True
    """Whether the file can hold it."""
    term: str = ""
    """Of the servo's loop, that it carries."""

    @property
    def inside(self) -> bool | None:
        """Whether the file's value lies in the interval; None where that is not known."""
        if self.now is None or not math.isfinite(self.half_width):
            return None
        return abs(self.now - self.value) <= self.half_width

    def numbers(self) -> dict[str, Any]:
        """Return it for programs; None means unknown."""
        known = math.isfinite(self.half_width)
        return {
            "element": self.element,
            "name": self.name,
            "attribute": self.attribute,
            "unit": self.unit,
            "value": self.value,
            "lower": self.value - self.half_width if known else None,
            "upper": self.value + self.half_width if known else None,
            "in_file": self.now,
        }


def facts_of(identified: Identified) -> ModelFacts | None:
    """Return what the model of an identification says of its joint; None without a model."""
    content = (identified.origin.get("manifest") or {}).get("facts")
    return None if content is None else ModelFacts.model_validate(content)


def model_rows(identified: Identified) -> list[ModelRow]:
    """Return the attributes that were identified; none without a model, or of ratios."""
    facts, estimate = facts_of(identified), identified.estimate
    if facts is None or estimate.ratios or "p1" in estimate.open:
        return []
    return [*_of_joint(facts, estimate), *_of_actuators(facts, identified)]


def _of_joint(facts: ModelFacts, estimate: Estimate) -> Iterator[ModelRow]:
    """Yield armature, damping and dry friction."""
    quantities = _quantities(facts, estimate)
    inertia, moment = facts.bare
    by_gravity = facts.gravity_tells_scale and "p3" in quantities.names

    def armature(of: Mapping[str, Any]) -> Any:  # noqa: ANN401 - real or complex
        scale = of["p3"] / moment if by_gravity else of[_SCALE]
        return of["p1"] - inertia * scale - facts.rotors

    def damping(of: Mapping[str, Any]) -> Any:  # noqa: ANN401 - real or complex
        return of["p2"] - facts.motor_damping

    formulas: dict[str, tuple[Formula, float, str]] = {
        "armature": (armature, facts.armature, "p1"),
        "damping": (damping, facts.damping, "p2"),
        "frictionloss": (lambda of: of["coulomb"], facts.frictionloss, "coulomb"),
    }
    for attribute, (formula, now, parameter) in formulas.items():
        if parameter in quantities.names:
            known = quantities.find(formula)
            yield ModelRow(
                element="joint",
                name=facts.joint,
                attribute=attribute,
                unit=unit_of(parameter, joint=facts.kind),
                value=known.value,
                half_width=SPREADS * known.uncertainty,
                now=now,
            )


def _quantities(facts: ModelFacts, estimate: Estimate) -> Quantities:
    """Return the parameters with the errors of their intervals, and the scale of the links."""
    names = [name for name in estimate.names if name not in {*estimate.unestimated, *estimate.open}]
    rows = [estimate.names.index(name) for name in names]
    fixed = {
        name: value
        for name, value in (estimate.known.fixed | estimate.fixed).items()
        if name not in names
    }
    given = {name: Known(value=value) for name, value in fixed.items()}
    given[_SCALE] = Known(value=1.0, uncertainty=facts.links.uncertainty)
    estimated = Quantities(
        names=tuple(names),
        values=estimate.values[rows],
        covariance=estimate.interval_covariance[np.ix_(rows, rows)],
    )
    return estimated.combined_with(Quantities.of(given), {}, new=frozenset())


def _of_actuators(facts: ModelFacts, identified: Identified) -> Iterator[ModelRow]:
    """Yield gain, or stiffness and damping, and effort of what drives the joint."""
    estimate = identified.estimate
    kind, gain = InputKind(identified.origin["input"]), estimate.parameters.p4
    share = _relative(estimate, "p4")
    drive = _drive(identified) if _is_servo(identified) else None
    for actuator in facts.actuators[:1]:
        element = actuator.shortcut
        about: dict[str, Any] = {"element": element, "name": actuator.name}
        force, way = unit_of("coulomb", joint=facts.kind), facts.kind.way
        if drive is None and kind is not InputKind.NONE and "p4" in estimate.names:
            attribute, now = _said_of_gain(actuator)
            value = gain * now / actuator.gain if actuator.gain else gain
            yield ModelRow(
                **about,
                attribute=attribute,
                unit=f"{force}/{kind.unit}",
                value=value,
                half_width=share * abs(value),
                now=now,
                writes=element == "motor" and not facts.rotors,
            )
        if drive is not None and drive[0]:
            rows = {"kp": (drive[0], f"{force}/{way}", actuator.kp, "loop_kp")}
            if drive[1]:
                rows["kv"] = (drive[1], f"{force} s/{way}", actuator.kv, "loop_kd")
            for attribute, (value, unit, now, term) in rows.items():
                wide = share + _relative(estimate, term)
                wide += _relative(estimate, "back_emf") if attribute == "kv" else 0.0
                squared = actuator.gear**2
                yield ModelRow(
                    **about,
                    attribute=attribute,
                    unit=unit,
                    value=value / squared,
                    half_width=wide * abs(value) / squared,
                    now=now / squared,
                    writes=element == "position",
                    term=term,
                )
        if drive is not None and math.isfinite(drive[2]):
            yield ModelRow(
                **about,
                attribute="forcerange",
                unit=force,
                value=drive[2] / abs(actuator.gear),
                half_width=share * drive[2] / abs(actuator.gear),
                now=actuator.effort and actuator.effort / abs(actuator.gear),
            )


def _is_servo(identified: Identified) -> bool:
    """Whether the logs are of set-points, from which the law of a servo makes the input."""
    manifest = identified.origin.get("manifest") or {}
    return bool(manifest.get("input") == InputKind.SETPOINT.value)


def _drive(identified: Identified) -> tuple[float, float, float, float]:
    """Return stiffness, damping, effort and speed of a servo (see `plain.drive_at_joint`)."""
    from butterfly.twin.plain import drive_at_joint  # noqa: PLC0415 - slow to import
    from butterfly.twin.twin import Twin  # noqa: PLC0415

    return drive_at_joint(Twin.identified(identified))


def _said_of_gain(actuator: ActuatorFacts) -> tuple[str, float]:
    """Return the attribute that an actuator's torque for ctrl 1 is said by, and its value."""
    if actuator.shortcut == "motor":
        return "gear", actuator.gear
    return "gainprm", actuator.gain / actuator.gear if actuator.gear else 0.0


def _relative(estimate: Estimate, name: str) -> float:
    """Return the relative half-width of a parameter; 0 if it is exact."""
    if name not in estimate.names:
        return 0.0
    return float(estimate.relative_half_widths[name])
