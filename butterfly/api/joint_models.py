"""Logs of one joint of a robot whose model is at hand: what the model says goes into the manifest.

The model is read once (`butterfly.twin.joint_of_model`); the manifest then holds gravity across the
axis, the angle at which the joint hangs, and what a pose of the other joints adds, as it would hold
an added mass. What is said by hand is kept.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.errors import InputError, nearest
from butterfly.identification.data import DataSet
from butterfly.logs.formats import column_names, read_log
from butterfly.logs.known_names import columns_by_joint, columns_meant, columns_of_joint
from butterfly.logs.manifest import LogEntry, Manifest
from butterfly.logs.model_facts import ModelFacts, PoseFacts
from butterfly.model.parameters import JointKind
from butterfly.model.prior import Known

ZERO_UNCERTAINTY = 0.05
"""Standard uncertainty in rad of a model's angle of hanging: of how its parts are mounted."""

_BEYOND = 0.1  # rad or m, by which a log may leave the joint's range
_LONG = 1.0  # m, longest arm of the mass that stands for a pose


def with_model(manifest: Manifest) -> Manifest:
    """Return a manifest with what its model says of the joint; one without a model as it is."""
    source, said = manifest.name, manifest.model_fields_set
    if manifest.model is None:
        for name in ("of", "pose"):
            if getattr(manifest, name):
                expected = "model as well: the MJCF or URDF that has this joint"
                raise InputError(source, name, getattr(manifest, name), expected)
        return manifest
    if manifest.of is None:
        raise InputError(source, "of", "nothing", "the name of the joint in the model")
    if manifest.facts is not None:
        return manifest
    from butterfly.twin.joint_of_model import RobotModel  # noqa: PLC0415 - slow to import

    path = (Path(manifest.root) / manifest.model).resolve()
    robot = RobotModel.of(path, manifest.of)
    entries = [_with_columns(manifest, entry, robot.others) for entry in manifest.logs]
    poses = [{**manifest.pose, **(entry.pose or {})} for entry in entries]
    facts = robot.facts(poses, manifest.link_masses)
    for name, value in (("joint", facts.kind), ("gravity", facts.gravity)):
        given = getattr(manifest, name)
        if name in said and given not in {value, Manifest.model_fields[name].default}:
            raise InputError(source, name, given, f"{value}, as {path.name} has it")
    whole = [robot.pose_facts(pose) for pose in poses]
    update = {
        "model": os.path.relpath(path, manifest.root),
        "facts": facts,
        "joint": facts.kind,
        "gravity": facts.gravity,
        "known": {**_known(facts), **manifest.known},
        "logs": _with_poses(manifest, entries, facts, whole),
    }
    return manifest.model_copy(update=update)


def _with_columns(manifest: Manifest, entry: LogEntry, others: Mapping[str, int]) -> LogEntry:
    """Return an entry with its columns by the names of joints, and the pose that they show."""
    place = {"at": entry.at} if entry.at else {}
    file = Path(manifest.root) / entry.file
    names = column_names(file, **place)
    kind = manifest.input if entry.input is None else entry.input
    update: dict[str, Any] = {}
    if entry.columns is None and manifest.columns is None and names:
        own = columns_of_joint(names, str(manifest.of), others, kind)
        if "angle" in own:
            update["columns"] = own
    if entry.neighbours is None and names:
        by_joint = columns_by_joint(names, {*others, str(manifest.of)})
        found = {n: columns_meant(by_joint[n], None, by_joint[n]).get("angle") for n in others}
        update["neighbours"] = {n: column for n, column in found.items() if column} or None
    for name in entry.neighbours or ():
        if name not in others:
            expected = nearest(name, others) if others else "no other joint"
            raise InputError(entry.file, f"neighbours.{name}", "no such joint", expected)
    entry = entry.model_copy(update=update)
    positions = neighbour_positions(manifest, entry)
    held = {name: float(np.mean(angles)) for name, angles in positions.items()}
    return entry.model_copy(update={"pose": {**held, **manifest.pose, **(entry.pose or {})}})


def neighbour_positions(manifest: Manifest, entry: LogEntry) -> dict[str, np.ndarray]:
    """Return the (n,) positions of the other joints in a log that has columns of them."""
    positions = {}
    columns = entry.columns or manifest.columns or {}
    rest: dict[str, str | int]
    rest = {field: columns[field] for field in ("time", "input") if field in columns}
    for name, column in (entry.neighbours or {}).items():
        log = read_log(
            Path(manifest.root) / entry.file,
            columns={**rest, "angle": column},
            units=manifest.scale(entry),
            **manifest.model_copy(update={"loop": {}}).properties(entry),
        )
        positions[name] = log.angle
    return positions


def _known(facts: ModelFacts) -> dict[str, Any]:
    """Return what the model lets be known: gravity, or the scale of what poses add."""
    share = facts.links.uncertainty
    if facts.kind is JointKind.SLIDE:
        return {}
    if len(facts.poses) > 1:
        common = (
            {} if facts.links.independent else {"mass_scale": Known(value=1.0, uncertainty=share)}
        )
        return {**common, "load": Known(value=0.0), "load_drag": Known(value=0.0)}
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
        why = "; is its sign turned?" if turned else "; is the unit or the zero another?"
        expected = (
            f"{low:.4g} to {high:.4g} {way}, the range of {facts.joint!r} in {facts.file}{why}"
        )
        raise InputError(log.source, "angle", f"{least:.4g} to {most:.4g} {way}", expected)
