"""Robots that a source names, and what can be looked at: logs, experiments, saved results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from butterfly.api.answers import Inspection, RobotModel
from butterfly.api.sources import RESULT_ENDING, Named, is_data, manifest_of, read
from butterfly.api.verbs import identify, numbers_of_logs, saved_identification
from butterfly.errors import InputError
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.identification.estimators import Suitable
from butterfly.identification.identification import Identification
from butterfly.identification.parameter import unit_of
from butterfly.logs.health import examine
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import Manifest
from butterfly.logs.reading import read_pieces, with_parts
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import GRAVITY, AddedMass, JointKind
from butterfly.plant.robot import HAND_MASS, Robot
from butterfly.plant.stand_alone import command_of
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import require_possible
from butterfly.report.format import field_unit
from butterfly.report.inspection import (
    STATES,
    Inspected,
    conditions_text,
    health_rows,
    hints,
    inspect_logs,
)
from butterfly.report.numbers.estimate_numbers import estimate_numbers
from butterfly.report.numbers.model_numbers import told_model
from butterfly.report.numbers.other_numbers import told_inspection
from butterfly.report.summary import zero_sentences
from butterfly.result import TextTable
from butterfly.verdict import Verdict

ARM = 0.104  # m


@dataclass(frozen=True, kw_only=True)
class NamedRobot:
    """A robot, what it carries and its command; of data, what it rests on.

    The command is what `butterfly.plant.stand_alone` takes.
    """

    name: str
    robot: Robot
    carried: AddedMass
    input_kind: InputKind
    command: Mapping[str, float]
    verdict: Verdict | None = None
    note: str = ""
    besides: dict[str, Any] = field(default_factory=dict)


def inspect(
    source: Named,
    *,
    logs: Sequence[int] | None = None,
    hand_mass: float | None = None,
    added_mass: float = 0.0,
    track: Track = untracked,
    **description: Any,  # noqa: ANN401 - what `read` takes
) -> Inspection | RobotModel:
    """Look at logs, at the robot of an experiment, or at a saved identification.

    Parameters
    ----------
    source
        A log, a folder of logs of any names, a manifest or a shipped data set: each log is checked;
        an experiment, or a saved identification: the robot is told.
    logs
        Numbers of the logs to look at; all if not given.
    hand_mass, added_mass
        Mass in kg of an identified hand, on which its motion does not depend (a possible one is
        taken if it is not given), and of what the robot carries.
    track
        Shows progress.
    description
        What is said of the data, as `read` takes it.

    Raises
    ------
    InputError
        If it is none of these, cannot be read, or the one log that is looked at cannot be used.
    """
    path = locate(Path(source))
    if path.suffix == RESULT_ENDING or not is_data(path):
        named = robot_of(
            path, hand_mass=hand_mass, added_mass=added_mass, arm=description.get("arm")
        )
        return _robot_model(named)
    manifest = with_parts(manifest_of(path, massless=True, **description))
    numbers = numbers_of_logs("inspect", logs, len(manifest.logs))
    part = manifest.model_copy(update={"logs": [manifest.logs[k] for k in numbers]})
    seen = inspect_logs(part, track)
    if len(seen) == 1 and seen[0].log is None:
        ((_, recorded),) = read_pieces(part, part.logs[0])
        examine(recorded, part.repair)  # which says why it cannot be used
    only = len(seen) == 1
    return Inspection(
        source=str(source),
        logs=tuple(seen),
        content=told_inspection(part, seen, _sentences(seen, manifest)),
        printed=(_one_log(part, seen[0]) if only else _every_log(str(source), seen),),
    )


def robot_of(
    source: Named,
    *,
    hand_mass: float | None = None,
    added_mass: float = 0.0,
    arm: float | None = None,
) -> NamedRobot:
    """Return the robot of an experiment, or the twin that data or a saved result make.

    A saved result is the estimate; other data are identified by the method that suits them.

    Raises
    ------
    InputError
        If ``source`` is neither an experiment nor data, cannot be read, or is of a slide.
    UnusableError
        If no joint has the parameters that were identified.
    """
    path = locate(Path(source))
    carried = AddedMass(mass=added_mass, arm=ARM if arm is None else arm)
    if not is_data(path):
        plan = read_experiment(path)
        return NamedRobot(
            name=plan.name,
            robot=plan.plant.robot,
            carried=carried,
            input_kind=plan.input_kind,
            command=vars(plan.plant.path),
        )
    result = saved_identification(path)
    if result is None:
        result = identify(read(path, arm=arm), Suitable(check=False))
    return _twin(result, carried, hand_mass)


def _twin(result: Identification, carried: AddedMass, mass: float | None) -> NamedRobot:
    """Return the simulated robot that moves as an identified one."""
    about, found = result.origin, result.estimate
    joint, kind = JointKind(about.get("joint", JointKind.HINGE)), InputKind(about["input"])
    if joint is JointKind.SLIDE:
        raise InputError(about["name"], "joint", joint, "a hinge, which the model in MuJoCo has")
    verdict = require_possible(found)
    carried = replace(carried, gravity=float(about.get("gravity", GRAVITY)))
    robot, rest = Robot.of_loaded(found.parameters, carried, mass)
    document, note = result.to_dict(), ""
    if mass is None and robot.hand.mass > HAND_MASS:
        note = (
            f"The hand has a mass of {robot.hand.mass:.3g} kg (--hand-mass): none of "
            f"{HAND_MASS:g} kg can have its p1 and p3, and the motion does not depend on it."
        )
    return NamedRobot(
        name=about["name"],
        robot=robot,
        carried=rest,
        input_kind=kind,
        command=command_of(found.parameters),
        verdict=verdict,
        note=note,
        besides={
            "data": document["data"],
            "chosen": document["chosen"],
            **estimate_numbers(found),
        },
    )


def _robot_model(named: NamedRobot) -> RobotModel:
    """Tell the parts of a robot, and the lumped parameters with what it carries."""
    robot, carried = named.robot, named.carried
    loaded = robot.lumped.with_added_mass(carried)
    rows = {
        "hand": _numbers_of(robot.hand),
        "drive": _numbers_of(robot.drive),
        "friction": _numbers_of(robot.friction) or "none",
        "clutch": _numbers_of(robot.clutch) if robot.clutch else "rigid",
        "added mass": str(carried) if carried.mass else "none",
        "p1": f"{loaded.p1:.6g} kg m²",
        "p2": f"{loaded.p2:.6g} N m s/rad",
        "p3": f"{loaded.p3:.6g} N m",
        "p4": f"{loaded.p4:.6g} {unit_of('p4', named.input_kind)}",
        "resonance": f"{resonance_frequency(loaded):.5g} rad/s",
    }
    told = told_model(
        named.name,
        robot,
        carried,
        named.input_kind,
        verdict=named.verdict,
        besides=named.besides,
    )
    if named.note:
        told = replace(told, summary=(*told.summary, named.note))
    return RobotModel(content=told, printed=(TextTable("", (), [*rows.items()]),))


def _numbers_of(part: object) -> str:
    """Name the numbers of one part that are not at their defaults, with their units."""
    return ", ".join(
        f"{each.name} {getattr(part, each.name):.6g} {field_unit(f'part.{each.name}')}".rstrip(" –")
        for each in fields(part)  # type: ignore[arg-type]
        if getattr(part, each.name) != each.default
    )


def _one_log(manifest: Manifest, seen: Inspected) -> TextTable:
    assert seen.log is not None and seen.health is not None  # noqa: S101, PT018 - it can be used
    path = Path(manifest.root) / seen.name
    return TextTable(str(path), (), health_rows(seen.log, seen.health))


def _every_log(source: str, seen: Sequence[Inspected]) -> TextTable:
    """Return a line for each log."""
    rows = []
    for each in seen:
        health = each.health
        numbers = ("–", "–", "–")
        if health is not None:
            numbers = (f"{health.samples}", f"{health.duration:.3f}", f"{1e3 * health.step:.3f}")
        rows.append((each.name, STATES[each.condition], *numbers, each.findings))
    return TextTable(source, ("log", "state", "samples", "s", "ms", "findings"), rows)


def _sentences(seen: Sequence[Inspected], manifest: Manifest) -> list[str]:
    """Say in which condition the logs are, what to do about it, and where the hand hangs."""
    logs = [each.log for each in seen if each.log is not None]
    counted = [conditions_text([each.condition for each in seen])] if len(seen) > 1 else []
    return [
        *counted,
        *hints(remark for each in seen for remark in each.remarks),
        *zero_sentences(logs, manifest.knowledge),
    ]
