"""Ranges of a joint to randomise it in: plain YAML, or Python with events of mjlab and Isaac Lab.

YAML is what any simulator's own code reads. Events are functions, so Python says them; the file
imports mjlab or Isaac Lab only where its functions are called. mjlab's ``dr`` terms are those of
the wheel 1.6.0, mjlab/envs/mdp/dr/{joint,actuator}.py. Isaac Lab's ``randomize_joint_parameters``
and ``randomize_actuator_gains`` are those of the wheel 2.3.2.post1, isaaclab/envs/mdp/events.py,
and of 3.0, envs/mdp/physics_events.py of isaac-sim/IsaacLab 3308ee7.

Both draw once for each environment, as units differ. Where the joint is not of the robot's own
model, inertia and damping are added to what the model has: inertia as armature, damping since a
part of it may be an actuator's back EMF.
"""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from butterfly.errors import visible
from butterfly.model.terms import LOOP_TERMS
from butterfly.twin.forms import Options
from butterfly.twin.model_rows import facts_of
from butterfly.twin.plain import HELD, OF_MJLAB, joint_name
from butterfly.twin.ranges import Range, of_own_model, ranges_of, tolerance_factor
from butterfly.twin.twin import Twin, Written, beyond, listed
from butterfly.yaml_files import yaml_text

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
