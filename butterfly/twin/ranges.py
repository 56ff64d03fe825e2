"""Ranges of a joint's attributes: of one unit by its intervals, or between units of a product.

Of one result a range is the 95 % interval: what is not known of that unit. Of results of n units it
is the range that holds 95 % of all units with a confidence of 95 %, ``m +- k s`` of their mean m
and standard deviation s, with Howe's factor (J. Am. Stat. Assoc. 64, 610-620, 1969)

    k² = (n - 1) (1 + 1/n) z² / chi²,

z the normal 97.5 % quantile, chi² the 5 % quantile at n - 1 degrees of freedom. That is within 2 %
of the exact factor, and above it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import Any

from scipy.special import chdtri

from butterfly.errors import InputError
from butterfly.identification.parameter import CONFIDENCE, SPREADS, unit_of
from butterfly.twin.model_rows import ModelRow, model_rows
from butterfly.twin.plain import drive_at_joint, joint_name
from butterfly.twin.twin import NO_DELAY, Twin

_ANY_SIGN = ("gear", "gainprm", "gain")


@dataclass(frozen=True, kw_only=True)
class Range:
    """What an attribute may be: of one unit, or of any."""

    row: ModelRow
    """With the value of one unit, or the mean of several."""
    half_width: float
    """NaN if unknown."""
    deviation: float | None = None
    """Standard deviation between units."""

    @property
    def attribute(self) -> str:
        """Name of what varies."""
        return self.row.attribute

    @property
    def ends(self) -> tuple[float, float] | None:
        """Lower and upper end, not below 0 where nothing can be; None if unknown."""
        if not math.isfinite(self.half_width):
            return None
        lower, upper = self.row.value - self.half_width, self.row.value + self.half_width
        if self.attribute in _ANY_SIGN:
            return lower, upper
        return max(lower, 0.0), max(upper, 0.0)

    @property
    def varies(self) -> bool:
        """Whether there is something to draw from."""
        return self.ends is not None and self.ends[0] < self.ends[1]

    def numbers(self) -> dict[str, Any]:
        """Return it for programs; None means unknown."""
        row, (lower, upper) = self.row, self.ends or (None, None)
        content: dict[str, Any] = {"element": row.element, "name": row.name}
        content |= {"attribute": row.attribute, "unit": row.unit}
        rounded = {"value": row.value, "lower": lower, "upper": upper}
        rounded |= {} if self.deviation is None else {"deviation": self.deviation}
        return content | {k: v if v is None else float(f"{v:.6g}") for k, v in rounded.items()}


def tolerance_factor(units: int) -> float:
    """Return how many standard deviations of 2 units or more, about their mean, hold 95 % of all.

    With a confidence of 95 %.
    """
    free = units - 1
    return float(SPREADS * math.sqrt(free * (1 + 1 / units) / chdtri(free, CONFIDENCE)))


def of_own_model(twin: Twin) -> list[ModelRow]:
    """Return what an identification determines of the robot's own model; nothing without one."""
    return [] if twin.source is None else model_rows(twin.source)


def ranges_of(units: Sequence[Twin]) -> list[Range]:
    """Return the ranges of one unit, or those between units, of the attributes that all have.

    They are attributes of the robot's own model, or else of the joint as it is exported.

    Raises
    ------
    InputError
        The units do not have the same joint, or one is given twice.
    """
    tables = [[*(of_own_model(unit) or _of_twin(unit)), *_of_delay(unit)] for unit in units]
    first, *others = tables
    for number, (unit, rows) in enumerate(zip(units[1:], others, strict=True), 1):
        _require_alike(units[0], first, unit, rows)
        if any(unit.parameters == before.parameters for before in units[:number]):
            raise InputError("export", "source", f"{unit.name} twice", "each unit once")
    if not others:
        return [Range(row=row, half_width=row.half_width) for row in first]
    factor, ranges = tolerance_factor(len(units)), []
    for row in first:
        alike = [other for rows in others for other in rows if other.attribute == row.attribute]
        if len(alike) == len(others):
            values = [row.value, *(other.value for other in alike)]
            mean = ModelRow(**_about(row), value=fmean(values), half_width=math.nan, now=row.now)
            spread = stdev(values)
            ranges.append(Range(row=mean, half_width=factor * spread, deviation=spread))
    return ranges


def _about(row: ModelRow) -> dict[str, Any]:
    """Return of what element a row is."""
    names = ("element", "name", "attribute", "unit")
    return {name: getattr(row, name) for name in names}


def _require_alike(
    first: Twin, rows: Sequence[ModelRow], other: Twin, of_other: Sequence[ModelRow]
) -> None:
    """Raise InputError unless two units have one joint, driven in one way."""
    kinds = [(unit.joint, unit.kind, unit.ratios, unit.servo is None) for unit in (first, other)]
    joints = [{row.name for row in some if row.element != "body"} for some in (rows, of_other)]
    if kinds[0] != kinds[1] or joints[0].isdisjoint(joints[1]):
        expected = "units of one joint, with the same kind of input and the same model, or none"
        raise InputError("export", "source", f"{first.name} and {other.name}", expected)


def _of_twin(twin: Twin) -> Iterator[ModelRow]:
    """Yield body, friction and drive of a joint that is exported."""
    p, joint, body = twin.loaded, joint_name(twin), twin.identifier
    places = {
        "p1": ("body", body, "inertia_about_axis"),
        "p3": ("body", body, "gravity_moment"),
        "p2": ("joint", joint, "damping"),
        "coulomb": ("joint", joint, "frictionloss"),
        "p4": ("drive", joint, "gain"),
    }
    for parameter, (element, name, attribute) in places.items():
        if value := getattr(p, parameter):
            yield ModelRow(
                element=element,
                name=name,
                attribute=attribute,
                unit=unit_of(parameter, twin.kind, twin.joint),
                value=value,
                half_width=_half_width(twin, parameter),
                now=None,
            )
    kp, kv, effort, speed = drive_at_joint(twin)
    kv -= p.back_emf if math.isfinite(speed) else 0.0
    force, way = unit_of("coulomb", joint=twin.joint), twin.joint.way
    units = {"kp": f"{force}/{way}", "kv": f"{force} s/{way}", "effort": force}
    for attribute, value in zip(units, (kp, kv, effort), strict=True):
        if value and math.isfinite(value):
            half = abs(value / p.p4) * _half_width(twin, "p4")
            about: dict[str, Any] = {"element": "drive", "name": joint, "attribute": attribute}
            yield ModelRow(**about, unit=units[attribute], value=value, half_width=half, now=None)


def _of_delay(twin: Twin) -> Iterator[ModelRow]:
    """Yield the delay of the command, where there is one."""
    if (delay := twin.parameters.delay) > NO_DELAY:
        yield ModelRow(
            element="drive",
            name=joint_name(twin),
            attribute="delay",
            unit="s",
            value=delay,
            half_width=_half_width(twin, "delay"),
            now=None,
        )


def _half_width(twin: Twin, parameter: str) -> float:
    """Return the half-width of a parameter's interval: 0 if it is exact, NaN if unknown."""
    if twin.estimate is None or parameter not in twin.estimate.names:
        return 0.0
    width = float(twin.estimate.farther[twin.estimate.names.index(parameter)])
    return width if math.isfinite(width) else math.nan
