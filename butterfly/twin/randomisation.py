"""Ranges of a joint, by intervals or between units, and files to randomise it in them."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import Any, NamedTuple

from scipy.special import chdtri

from butterfly.errors import InputError, visible
from butterfly.identification.trust import unit_of
from butterfly.model.terms import LOOP_TERMS
from butterfly.twin.forms import Options
from butterfly.twin.model_rows import ModelRow, facts_of, model_rows
from butterfly.twin.plain import HELD, OF_MJLAB, drive_at_joint, joint_name
from butterfly.twin.twin import NO_DELAY, Twin, Written, beyond, listed
from butterfly.verdict import CONFIDENCE, SPREADS
from butterfly.yaml_files import yaml_text

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


_MANY = 10  # units, whose factor is told beside that of fewer
_WITHOUT_EVENT = ("gear", "gainprm", "gain", "effort", "gravity_moment")


class _Event(NamedTuple):
    """An event of a function with its arguments, in Python."""

    name: str
    function: str
    selection: str
    arguments: Mapping[str, str]

    @property
    def lines(self) -> str:
        """Its lines in a dictionary of events."""
        params = {"asset_cfg": f"SceneEntityCfg(entity, {self.selection})", **self.arguments}
        lines = (f'                "{name}": {value},\n' for name, value in params.items())
        return (
            f"        {json.dumps(self.name)}: EventTermCfg(\n"
            f"            func={self.function},\n"
            '            mode="startup",\n'
            f"            params={{\n{''.join(lines)}            }},\n"
            "        ),\n"
        )


class _Joint(NamedTuple):
    """What varies of a joint, by attribute."""

    name: str
    is_own: bool  # of the robot's own model
    varied: Mapping[str, Range]

    def drawn(self, attribute: str) -> tuple[str, str]:
        """Return a range and how it is applied: as it is, or added to what the model has."""
        span = self.varied[attribute]
        lower, upper = span.ends or (span.row.value,) * 2
        if self.is_own or attribute == "frictionloss":
            return _pair(lower, upper), '"abs"'
        return _pair(lower - span.row.value, upper - span.row.value), '"add"'

    def share(self, attribute: str) -> str:
        """Return a range over the value; of what does not vary 1."""
        span = self.varied.get(attribute)
        if span is None or span.ends is None or not span.row.value:
            return "(1.0, 1.0)"
        return _pair(span.ends[0] / span.row.value, span.ends[1] / span.row.value)


def _pair(lower: float, upper: float) -> str:
    """Return two numbers in Python."""
    return f"({lower:.6g}, {upper:.6g})"


def as_randomisation(twin: Twin, options: Options) -> Written:
    """Return the ranges of one unit, or between several, as YAML or as Python."""
    units = (twin, *options.units)
    ranges = ranges_of(units)
    sentences = (*about_ranges(units, ranges), *_about_events(ranges))
    lags = _lags(ranges, options.timestep)
    delays = {
        "mjlab": {"delay_min_lag": lags[0], "delay_max_lag": lags[1]},
        "isaaclab": {"min_delay": lags[0], "max_delay": lags[1]},
    }
    notes = [*twin.log_lines, *sentences, OF_MJLAB]
    if options.ending == ".py":
        text = _python(twin, ranges, delays, notes)
    else:
        content = {"name": twin.name, "units": len(units), "timestep": options.timestep}
        rows = [span.numbers() for span in ranges]
        text = yaml_text({**content, "ranges": rows, "delay_in_steps": delays, "notes": notes})
    about = f"{len(ranges)} attributes of {visible(twin.name)}"
    about += f" and {len(units) - 1} more" if len(units) > 1 else ""
    return Written(text=text, about=about, left_out=sentences, title="Ranges", notes=(OF_MJLAB,))


def about_ranges(units: Sequence[Twin], ranges: Sequence[Range]) -> Iterator[str]:
    """Say what ranges are, and what they lack."""
    twin, count = units[0], len(units)
    if count > 1:
        more = f" (of {_MANY} units {tolerance_factor(_MANY):.3g})" if count < _MANY else ""
        yield (
            f"Ranges hold 95 % of all units with a confidence of 95 %: the mean of {count} units ± "
            f"{tolerance_factor(count):.3g} standard deviations{more}, which include the errors of "
            "identification."
        )
    elif twin.estimate is None:
        yield "These values are exact: export a saved result for its intervals."
    else:
        yield "Ranges are 95 % intervals of one unit. Give results of several for their scatter."
    names = [span.attribute for span in ranges]
    every = dict.fromkeys(span.attribute for unit in units for span in ranges_of((unit,)))
    sentences = {
        "Not all units have": [name for name in every if name not in names],
        "No interval is known for": [span.attribute for span in ranges if span.ends is None],
        "Below 0 (check the masses of the links):": [
            span.attribute for span in ranges if span.row.value < 0 and span.ends == (0.0, 0.0)
        ],
        "Ranges that include 0:": [
            span.attribute for span in ranges if span.varies and span.ends and not span.ends[0]
        ],
    }
    yield from (f"{words} {', '.join(some)}." for words, some in sentences.items() if some)
    if rest := beyond(twin.loaded, {*HELD, *LOOP_TERMS, "back_emf"}):
        yield f"Not included in the ranges: {listed(twin.loaded, rest, twin.kind.unit)}."


def _about_events(ranges: Sequence[Range]) -> Iterator[str]:
    """Say what events lack, and what they add to."""
    varied = [span.attribute for span in ranges if span.varies]
    if rest := [name for name in varied if name in _WITHOUT_EVENT]:
        yield f"Neither mjlab nor Isaac Lab has an event for {', '.join(rest)}."
    if "kv" in varied and "kp" not in varied:
        yield "mjlab has no event for kv alone."
    if "damping" in varied:
        yield (
            "Isaac Lab has no event for damping alone: its event for dry friction scales damping "
            "by the same range."
        )
    if "inertia_about_axis" in varied:
        yield (
            "Events vary armature (for the inertia) and damping in addition to those of your "
            "model: set the values above in it."
        )


def _lags(ranges: Sequence[Range], step: float) -> tuple[int, int]:
    """Return the ends of the delay in steps of the simulator."""
    for span in ranges:
        if span.attribute == "delay":
            lower, upper = span.ends or (span.row.value, span.row.value)
            return round(lower / step), round(upper / step)
    return 0, 0


def _python(
    twin: Twin,
    ranges: Sequence[Range],
    delays: Mapping[str, Mapping[str, int]],
    notes: Sequence[str],
) -> str:
    """Return a module with the ranges, the delays and both kinds of events."""
    about = (f"Ranges of {twin.name}, to randomise it in.", *notes)
    lines = (line for text in about for line in textwrap.wrap(visible(text), 97))
    comments = "\n".join(f"# {line}" for line in lines)
    rows = "".join(
        f"    {json.dumps(span.attribute)}: {_pair(*span.ends)},  # {span.row.unit}, "
        f"{span.row.element} {visible(span.row.name)}: {span.row.value:.6g}\n"
        for span in ranges
        if span.ends is not None
    )
    facts = facts_of(twin.source) if twin.source is not None and of_own_model(twin) else None
    name = joint_name(twin) if facts is None else facts.joint
    varied = {span.attribute: span for span in ranges if span.varies}
    joint = _Joint(name, facts is not None, varied)
    of_mjlab, of_isaac_lab = (
        "".join(event.lines for event in events(joint)) for events in (_of_mjlab, _of_isaac_lab)
    )
    return f'''{comments}

RANGES = {{
{rows}}}

OF_MJLAB_ACTUATOR = {json.dumps(delays["mjlab"])}  # in steps
OF_ISAAC_LAB_ACTUATOR = {json.dumps(delays["isaaclab"])}


def mjlab_events(entity="robot", group=0):
    """Return events of mjlab; group is the index of the joint's actuators in those of the robot."""
    from mjlab.envs.mdp import dr
    from mjlab.managers.event_manager import EventTermCfg
    from mjlab.managers.scene_entity_config import SceneEntityCfg

    return {{
{of_mjlab}    }}


def isaac_lab_events(entity="robot"):
    """Return events of Isaac Lab."""
    from isaaclab.envs import mdp
    from isaaclab.managers import EventTermCfg, SceneEntityCfg

    return {{
{of_isaac_lab}    }}
'''


def _of_mjlab(joint: _Joint) -> Iterator[_Event]:
    """Yield the events of mjlab."""
    functions = {
        "armature": "joint_armature",
        "inertia_about_axis": "joint_armature",
        "damping": "joint_damping",
        "frictionloss": "joint_friction",
    }
    for attribute, function in functions.items():
        if attribute in joint.varied:
            ranges, operation = joint.drawn(attribute)
            arguments = {"ranges": ranges, "operation": operation}
            selection = f"joint_names=({json.dumps(joint.name)},)"
            yield _Event(f"{joint.name}_{attribute}", f"dr.{function}", selection, arguments)
    group, by_share = "actuator_ids=[group]", {"operation": '"scale"'}
    if "kp" in joint.varied:
        gains = {"kp_range": joint.share("kp"), "kd_range": joint.share("kv")}
        yield _Event(f"{joint.name}_gains", "dr.pd_gains", group, gains | by_share)
    if "forcerange" in joint.varied and joint.varied["forcerange"].row.now is not None:
        effort = {"effort_limit_range": joint.share("forcerange")}
        yield _Event(f"{joint.name}_effort", "dr.effort_limits", group, effort | by_share)


def _of_isaac_lab(joint: _Joint) -> Iterator[_Event]:
    """Yield the events of Isaac Lab."""
    selection, by_share = f"joint_names=[{json.dumps(joint.name)}]", {"operation": '"scale"'}
    parameters, gains = "mdp.randomize_joint_parameters", "mdp.randomize_actuator_gains"
    for attribute in ("armature", "inertia_about_axis"):
        if attribute in joint.varied:
            ranges, operation = joint.drawn(attribute)
            arguments = {"armature_distribution_params": ranges, "operation": operation}
            yield _Event(f"{joint.name}_{attribute}", parameters, selection, arguments)
    if "frictionloss" in joint.varied:
        share = {"friction_distribution_params": joint.share("frictionloss")}
        yield _Event(f"{joint.name}_frictionloss", parameters, selection, share | by_share)
    if joint.varied.keys() & {"kp", "kv"}:
        shares = {"stiffness_distribution_params": joint.share("kp")}
        shares |= {"damping_distribution_params": joint.share("kv")}
        yield _Event(f"{joint.name}_gains", gains, selection, shares | by_share)
