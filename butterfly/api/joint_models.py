"""Logs of one joint of a robot whose model is at hand: what the model says goes into the manifest.

The model is read once (`butterfly.twin.joint_of_model`); the manifest then holds gravity across the
axis, the angle at which the joint hangs, and what a pose of the other joints adds, as it would hold
an added mass. What is said by hand is kept.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import InputError, listed, nearest
from butterfly.identification.data import DataSet
from butterfly.identification.trust import Finding, FindingKind
from butterfly.logs.clock import NANOSECONDS
from butterfly.logs.formats import DEFAULT_COLUMNS, read_log
from butterfly.logs.headers import (
    columns_by_joint,
    columns_meant,
    columns_of_joint,
    meaning_of,
    parts_of,
)
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.logs.manifest import LogEntry, Manifest, columns_of_entry
from butterfly.logs.model_facts import STILL, ModelFacts, PoseFacts
from butterfly.logs.reading import piece_name
from butterfly.logs.units import Units, units_spelt
from butterfly.model.parameters import JointKind
from butterfly.model.prior import Known, plain
from butterfly.model.terms import TERMS

ZERO_UNCERTAINTY = 0.05
"""Standard uncertainty in rad of a model's angle of hanging: of how its parts are mounted."""

_MOVED = 0.25  # of the farthest motion in a log: a joint that moves less is held
_BEYOND = 0.1  # rad or m, by which a log may leave the joint's range
_DIGITS = 4  # decimals of a mean position
_TINY = 1e-300
_LONG = 1.0  # m, longest arm of the mass that stands for a pose


def with_model(manifest: Manifest) -> Manifest:
    """Return a manifest with what its model says of the joint; one without a model as it is."""
    source, written = manifest.name, manifest.model_fields_set
    if manifest.model is None:
        for name in ("of", "pose"):
            if getattr(manifest, name):
                expected = "model as well: the MJCF or URDF that has this joint"
                raise InputError(source, name, getattr(manifest, name), expected)
        return manifest
    if manifest.facts is not None:
        return manifest
    joint = the_joint(manifest)
    from butterfly.twin.joint_of_model import JointOfModel  # noqa: PLC0415 - slow to import

    path = (Path(manifest.root) / str(manifest.model)).resolve()
    robot = JointOfModel.of(path, joint)
    logs = [entry for entry in manifest.logs if entry.of in {None, joint}]
    within = manifest.model_copy(update={"logs": logs})
    driven = logs_of_joints(within, {joint: robot.alike})[joint]
    if not driven and any(drives(manifest, entry, joint, [*robot.others]) for entry in logs):
        expected = "a log in which it moves: in these it is held (if not, say of: in the manifest)"
        raise InputError(source, "of", joint, expected)
    manifest = manifest.model_copy(update={"of": joint, "logs": driven or logs})
    entries = [_with_columns(manifest, entry, robot.others) for entry in manifest.logs]
    poses = _poses(manifest, entries)
    whole = [robot.pose_facts(pose) for pose in poses]
    facts = robot.facts(whole, manifest.link_masses)
    for name, value in (("joint", facts.kind), ("gravity", facts.gravity)):
        given = getattr(manifest, name)
        if name in written and given not in {value, Manifest.model_fields[name].default}:
            raise InputError(source, name, given, f"{value}, as {path.name} has it")
    update = {
        "model": os.path.relpath(path, manifest.root),
        "facts": facts,
        "joint": facts.kind,
        "gravity": facts.gravity,
        "known": {**_known(facts), **manifest.known},
        "logs": _with_poses(manifest, entries, facts, whole),
    }
    return manifest.model_copy(update=update)


def the_joint(manifest: Manifest) -> str:
    """Return the joint that a manifest is of; InputError if it is of none, or without a log."""
    names = dict.fromkeys(entry.of for entry in manifest.logs if entry.of)
    several = len(names) > 1 or any(entry.of is None for entry in manifest.logs)
    if manifest.of is None and (several or not names):
        expected = "the name of the joint in the model, or all (of: elbow, --of elbow)"
        raise InputError(manifest.name, "of", ", ".join(names) or "nothing", expected)
    joint = next(iter(names)) if manifest.of is None else manifest.of
    if all(entry.of not in {None, joint} for entry in manifest.logs):
        raise InputError(manifest.name, "of", joint, nearest(joint, names))
    return joint


def drives(manifest: Manifest, entry: LogEntry, joint: str, others: Sequence[str]) -> bool:
    """Whether a log is of a joint: it says so, or has columns of its motion and its command."""
    if entry.of is not None:
        return entry.of == joint
    columns = columns_of_entry(manifest, entry)
    kind = manifest.input if entry.input is None else entry.input
    meant = columns_of_joint(columns, joint, others, kind)
    return "angle" in meant and ("input" in meant or kind is InputKind.NONE)


def with_joints(manifest: Manifest, *, given_input: bool) -> Manifest:
    """Return a draft in which a log says its joint, where only one of its model's moves in it.

    The kind of input is that of the commands' names, unless it is given.
    """
    from butterfly.twin.joint_of_model import alike_joints, compiled, moving_joints  # noqa: PLC0415

    model = compiled((Path(manifest.root) / str(manifest.model)).resolve())[1]
    names, kinds = [*moving_joints(model)], set[InputKind | None]()
    for entry in () if given_input else manifest.logs:
        columns = columns_of_entry(manifest, entry)
        for joint, texts in columns_by_joint(columns, names).items():
            command = columns_of_joint(columns, joint, names).get("input")
            kinds |= {meaning_of(texts[command]).kind} if command else set()
    if len(kinds) == 1 and None not in kinds:
        manifest = manifest.model_copy(update={"input": kinds.pop()})
    of = dict[int, list[str]]()
    alike = {joint: alike_joints(model, joint) for joint in names}
    for joint, entries in logs_of_joints(manifest, alike).items():
        for entry in entries:
            of.setdefault(manifest.logs.index(entry), []).append(joint)
    logs = [
        entry.model_copy(update={"of": of[k][0]}) if len(of.get(k, ())) == 1 else entry
        for k, entry in enumerate(manifest.logs)
    ]
    return manifest.model_copy(update={"logs": logs})


def logs_of_joints(
    manifest: Manifest, alike: Mapping[str, Mapping[str, bool]]
) -> dict[str, list[LogEntry]]:
    """Return the logs that joints drive: of several joints with a command, those that move.

    A robot that holds its other joints logs a command of each. A log is of the joint that moves
    farthest, and of those like it, hinges or slides, that move at least `_MOVED` as far. ``alike``:
    for each joint the others, and whether they are of its kind.
    """
    logs = {joint: list[LogEntry]() for joint in alike}
    for entry in manifest.logs:
        reach: _Reach = {}
        for joint, others in alike.items():
            if drives(manifest, entry, joint, [*others]) and _moves(
                manifest, entry, joint, others, reach
            ):
                logs[joint].append(entry)
    return logs


_Reach = dict[tuple[str, str | int], float]
"""How far joints move in a log, by joint and column: each is read once."""


def _moves(
    manifest: Manifest, entry: LogEntry, joint: str, alike: Mapping[str, bool], reach: _Reach
) -> bool:
    """Whether a joint moves in a log, which it drives, as far as others that are driven in it."""
    names = [*alike, joint]
    rivals = [n for n, like in alike.items() if like and drives(manifest, entry, n, names)]
    if entry.of is not None or not rivals:
        return True
    of_joint = manifest.model_copy(update={"of": joint})
    described = _with_columns(of_joint, entry, dict.fromkeys(alike, 0))
    columns = {n: c for n, c in (described.neighbours or {}).items() if n in rivals}
    columns[joint] = (described.columns or manifest.columns or DEFAULT_COLUMNS)["angle"]
    lacking = {n: column for n, column in columns.items() if (n, column) not in reach}
    seen = described.model_copy(update={"neighbours": lacking})
    for name, log in neighbours(of_joint, seen).items():
        reach[name, lacking[name]] = float(np.ptp(log.angle))
    moved = {name: reach[name, column] for name, column in columns.items()}
    return moved[joint] >= _MOVED * max(moved.values())


def _with_columns(manifest: Manifest, entry: LogEntry, others: Mapping[str, int]) -> LogEntry:
    """Return an entry with its columns by the names of joints, and the pose that they show."""
    names = columns_of_entry(manifest, entry)
    kind = manifest.input if entry.input is None else entry.input
    update: dict[str, Any] = {}
    if entry.columns is None and manifest.columns is None and names:
        columns = columns_of_joint(names, str(manifest.of), others, kind)
        if "angle" in columns:
            update["columns"] = columns
            update["units"] = _units_beside(manifest, entry, columns, others) or entry.units
        elif other := [
            n for n in others if drives(manifest, entry, n, [*others, str(manifest.of)])
        ]:
            expected = f"columns named after {str(manifest.of)!r}, or columns: that say which"
            raise InputError(entry.file, "columns", f"those of {listed(other)}", expected)
    if entry.neighbours is None and names:
        by_joint = columns_by_joint(names, {*others, str(manifest.of)})
        angles = {n: columns_meant(by_joint[n], None, by_joint[n]).get("angle") for n in others}
        update["neighbours"] = {n: column for n, column in angles.items() if column} or None
    for name in entry.neighbours or ():
        if name not in others:
            expected = nearest(name, others) if others else "no other joint"
            raise InputError(entry.file, f"neighbours.{name}", "no such joint", expected)
    return entry.model_copy(update=update)


def _units_beside(
    manifest: Manifest, entry: LogEntry, columns: Mapping[str, str], others: Iterable[str]
) -> dict[str, str | float]:
    """Return factors for columns whose joint is called like a unit, as joint ``turn`` is.

    They are of the unit that the rest of a column's name says, else of the project's own.
    """
    joint, given = str(manifest.of), {**manifest.units, **(entry.units or {})}
    texts = columns_by_joint([*columns.values()], {*others, joint})[joint]
    factors = {
        field: _factor(field, texts[columns[field]])
        for field in ("angle", "input")
        if field in columns and field not in given and _is_unit(joint)
    }
    return {**given, **factors} if factors else {}


def _factor(field: str, text: str) -> float:
    """Return the factor of the unit that a text says last; 1 if it says none."""
    units = [unit for part in parts_of(text) for unit in units_spelt(field, part)]
    return Units.of({field: units[-1]}).factor(field) if units else 1.0


def _is_unit(joint: str) -> bool:
    """Whether a joint's name has a word that is a unit of angles."""
    return any(units_spelt("angle", part) for part in parts_of(joint))


def _poses(manifest: Manifest, entries: Sequence[LogEntry]) -> list[dict[str, float]]:
    """Return the pose of the other joints in each log: as said, else as their columns have it.

    Columns that differ by less than what counts as still are one pose. So are all of them where
    their motion is corrected, which takes it off from one pose.
    """
    corrected, means = "p4" in manifest.prior.parameters, list[dict[str, float]]()
    for entry in entries:
        there = neighbours(manifest, entry)
        mean = {
            name: round(float(np.mean(log.angle)), _DIGITS) + 0.0 for name, log in there.items()
        }
        same = (
            known
            for known in means
            if known.keys() == mean.keys()
            and (corrected or all(abs(known[n] - angle) <= STILL for n, angle in mean.items()))
        )
        means.append(next(same, mean))
    pairs = zip(means, entries, strict=True)
    return [{**mean, **manifest.pose, **(entry.pose or {})} for mean, entry in pairs]


def neighbours(manifest: Manifest, entry: LogEntry) -> dict[str, Log]:
    """Return the motion of the other joints in a log that has columns of them, by joint."""
    columns = entry.columns or manifest.columns or DEFAULT_COLUMNS
    shared = ("time", NANOSECONDS, "input")
    rest: dict[str, str | int] = {field: columns[field] for field in shared if field in columns}
    whole = manifest.model_copy(update={"loop": {}})
    logs = {}
    for name, column in (entry.neighbours or {}).items():
        factor = (
            {"angle": _factor("angle", str(column).replace(name, ""))} if _is_unit(name) else {}
        )
        plain = entry.model_copy(update={"units": {**(entry.units or {}), **factor}})
        logs[name] = read_log(
            Path(manifest.root) / entry.file,
            columns={**rest, "angle": column},
            units=whole.scale(plain),
            **whole.properties(entry),
        )
    return logs


def with_neighbours(data: DataSet) -> DataSet:
    """Return logs without the torque that the motion of other joints made, and what to say of it.

    It is taken off the input where that is a torque: where p4 is known. Motion that is not
    corrected is a finding, and that some joints have no columns is another: a doubt, unless they
    are said to be clamped.
    """
    manifest = data.manifest
    if manifest is None or manifest.facts is None or manifest.model is None:
        return data
    taken, moved = _to_take_off(data)
    shares = [
        float(np.std(taken[log.name])) / max(float(np.std(log.input)), _TINY)
        for log in data.logs
        if log.name in taken
    ]
    remarks = _remarks(manifest.facts, manifest, moved, shares)
    held = data.test_logs and with_neighbours(data.test_logs)
    corrected = _less(data, taken, 1.0)
    return replace(corrected, test_logs=held, remarks=remarks, taken_off=taken)


def without_neighbours(manifest: Manifest, logs: Sequence[Log]) -> Sequence[Log]:
    """Return some logs of a manifest without the torque of moving neighbours."""
    if manifest.facts is None or not logs:
        return logs
    named = {piece_name(entry): entry for entry in manifest.logs}
    entries = [named[log.name] for log in logs]
    part = manifest.model_copy(update={"logs": entries, "holdout": []})
    data = DataSet.of(logs, name=manifest.name, known=manifest.prior)
    return with_neighbours(replace(data, manifest=part)).logs


def with_heavier_neighbours(data: DataSet) -> DataSet | None:
    """Return corrected logs as they are if the links weigh two standard uncertainties more.

    None where nothing that moves was corrected.
    """
    kinds = {finding.kind for finding in data.remarks}
    manifest = data.manifest
    if FindingKind.NEIGHBOURS_CORRECTED not in kinds or manifest is None or manifest.facts is None:
        return None
    return _less(data, data.taken_off, 2 * manifest.facts.links.uncertainty)


def _less(data: DataSet, taken: Mapping[str, Samples], share: float) -> DataSet:
    """Return logs with a share of some (n,) inputs taken off, by the names of logs."""

    def less(log: Log) -> Log:
        if log.name not in taken:
            return log
        return replace(log, input=log.input - share * taken[log.name])

    return replace(data, test_logs=None).corrected(less)


def _to_take_off(data: DataSet) -> tuple[dict[str, Samples], dict[str, float]]:
    """Return (n,) inputs that the others' motion asks for, by log; and how far each moves.

    The first are of logs whose input is a torque alone.
    """
    from butterfly.twin.joint_of_model import (  # noqa: PLC0415
        JointMotion,
        JointOfModel,
        coupling,
    )

    manifest, gain = data.manifest, data.known.parameters.get("p4")
    inputs, moved = dict[str, Samples](), dict[str, float]()
    if manifest is None or manifest.facts is None or manifest.model is None:
        return inputs, moved
    driven = data.input_kind not in {InputKind.NONE, InputKind.SETPOINT}
    path = (Path(manifest.root) / manifest.model).resolve()
    robot = JointOfModel.of(path, manifest.facts.joint)
    for log, entry in zip(data.logs, manifest.logs, strict=True):
        others = {
            name: JointMotion.of(other.time, other.angle, log.time)
            for name, other in neighbours(manifest, entry).items()
        }
        for name, motion in others.items():
            moved[name] = max(moved.get(name, 0.0), motion.reach)
        if others and driven and gain is not None and gain.value and not log.integrated:
            motion = JointMotion.of(log.time, log.angle, log.time)
            torque = coupling(robot, motion, others, entry.pose or {})
            if log.between_samples is Intersample.ZERO_ORDER_HOLD:
                torque = (torque + np.append(torque[1:], torque[-1:])) / 2  # mean until the next
            inputs[log.name] = torque / gain.value
    return inputs, moved


def _remarks(
    facts: ModelFacts, manifest: Manifest, moved: Mapping[str, float], shares: Sequence[float]
) -> tuple[Finding, ...]:
    """Return what is to be said of the other joints' motion."""
    remarks = []
    unseen = tuple(
        name
        for name in facts.others
        if any(name not in (entry.neighbours or {}) for entry in manifest.logs)
    )
    if unseen:
        kinds = FindingKind.NEIGHBOURS_UNSEEN, FindingKind.NEIGHBOURS_STILL
        remarks.append(Finding(kinds[manifest.clamped], unseen))
    moving = tuple(name for name, reach in moved.items() if reach > STILL)
    if shares and moving:
        share = max(shares)
        remarks.append(Finding(FindingKind.NEIGHBOURS_CORRECTED, moving, number=share))
    elif moving:
        reach = max(moved.values())
        remarks.append(Finding(FindingKind.NEIGHBOURS_MOVED, moving, number=reach))
    return tuple(remarks)


def _known(facts: ModelFacts) -> dict[str, Any]:
    """Return what the model lets be known: gravity, or the scale of what poses add."""
    share = facts.links.uncertainty
    if facts.kind is JointKind.SLIDE:
        return {}
    if len(facts.poses) > 1:
        of_masses = (term.name for term in TERMS.values() if term.of_mass)
        none = dict.fromkeys(of_masses, Known(value=0.0))  # no weight is added
        scale = {"mass_scale": Known(value=1.0, uncertainty=share)}
        return none if facts.links.independent else none | scale
    (pose,) = facts.poses
    if not pose.moment:
        return {}
    return {"p3": Known(value=pose.moment, uncertainty=share * pose.moment)}


def _with_poses(
    manifest: Manifest, entries: Sequence[LogEntry], facts: ModelFacts, whole: Sequence[PoseFacts]
) -> list[LogEntry]:
    """Return the entries with the zero of each pose, and with what it adds where poses differ.

    What two poses differ by is written as a mass at an arm: its inertia and gravity moment are the
    pose's beyond the least of all poses.
    """
    logs = []
    inertia, moment = facts.bare
    for entry, pose in zip(entries, whole, strict=True):
        update: dict[str, Any] = {"pose": pose.pose}
        if pose.moment and manifest.zero is None and entry.zero is None and not manifest.zeros:
            update["zero"] = Known(value=pose.zero, uncertainty=ZERO_UNCERTAINTY)
        if len(facts.poses) > 1:
            if entry.added_mass:
                expected = "no added mass, since poses of other joints differ (they are one)"
                raise InputError(entry.file, "added_mass", entry.added_mass, expected)
            update |= _as_mass(pose.inertia - inertia, pose.moment - moment, facts)
        logs.append(entry.model_copy(update=update))
    return logs


def _as_mass(inertia: float, moment: float, facts: ModelFacts) -> dict[str, Any]:
    """Return a mass, its arm and its own inertia that add an inertia and a gravity moment."""
    gravity = facts.gravity or math.inf
    first = moment / gravity  # kg m
    arm = min(inertia / first, _LONG) if first else _LONG / 10
    mass = first / arm if first else inertia / arm**2
    share = facts.links.uncertainty if facts.links.independent else 0.0
    return {
        "added_mass": Known(value=mass, uncertainty=share * mass),
        "arm": arm,
        "inertia": max(inertia - mass * arm**2, 0.0),
    }


def joint_clamped_in(path: Path, joint: str, pose: Mapping[str, float]) -> dict[str, Any]:
    """Return a manifest's fields, as a file has them, of a joint whose others are clamped."""
    from butterfly.twin.joint_of_model import JointOfModel  # noqa: PLC0415 - slow to import

    robot = JointOfModel.of(path, joint)
    if robot.kind is JointKind.SLIDE:
        raise InputError(path, "joint", f"{joint}, a slide", "a hinge, which a campaign can turn")
    whole = robot.pose_facts(pose)
    facts = robot.facts([whole], Manifest.model_fields["link_masses"].default)
    return {
        "model": str(path.absolute()),
        "of": joint,
        "pose": whole.pose,
        "clamped": True,
        "gravity": facts.gravity,
        "facts": facts.model_dump(mode="json"),
        "known": {name: plain(value) for name, value in _known(facts).items()},
    }


def of_joint(data: DataSet) -> DataSet:
    """Return the data of a model's joint, checked against it and corrected for its neighbours."""
    require_within(data)
    return with_neighbours(data)


def require_within(data: DataSet) -> None:
    """Raise InputError for a log whose angles leave the range that the model gives the joint."""
    facts = None if data.manifest is None else data.manifest.facts
    if facts is None or facts.range is None:
        return
    low, high = facts.range
    for log in data.logs:
        if log.integrated:
            continue
        least, most = float(np.min(log.angle)), float(np.max(log.angle))
        if low - _BEYOND <= least and most <= high + _BEYOND:
            continue
        way = facts.kind.way
        turned = low - _BEYOND <= -most and -least <= high + _BEYOND
        why = "; is its sign reversed?" if turned else "; is its unit or zero different?"
        expected = (
            f"{low:.4g} to {high:.4g} {way}, the range of {facts.joint!r} in {facts.file}{why}"
        )
        raise InputError(log.source, "angle", f"{least:.4g} to {most:.4g} {way}", expected)
