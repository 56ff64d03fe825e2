"""Robots that a source names, and what can be looked at: logs, experiments, saved results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from butterfly.api.inspected import Inspection, RobotModel
from butterfly.api.sources import Named, is_data, manifest_of, names_result, read
from butterfly.api.verbs import identify, numbers_of_logs, saved_identification
from butterfly.errors import InputError
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.identification.estimators import Suitable
from butterfly.identification.identification import Identification
from butterfly.logs.health import examine
from butterfly.logs.log import InputKind
from butterfly.logs.reading import read_pieces, with_parts
from butterfly.model.parameters import GRAVITY, AddedMass, JointKind
from butterfly.plant.robot import HAND_MASS, Robot
from butterfly.plant.stand_alone import command_of
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import require_possible
from butterfly.report.inspection import inspect_logs
from butterfly.report.numbers import estimate_numbers

ARM = 0.104  # m


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
        an experiment, or a saved identification: its robot is described.
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
    if names_result(path) or not is_data(path):
        return robot_of(
            path, hand_mass=hand_mass, added_mass=added_mass, arm=description.get("arm")
        )
    manifest = with_parts(manifest_of(path, massless=True, **description))
    numbers = numbers_of_logs("inspect", logs, len(manifest.logs))
    part = manifest.model_copy(update={"logs": [manifest.logs[k] for k in numbers]})
    seen = inspect_logs(part, track)
    if len(seen) == 1 and seen[0].log is None:
        ((_, recorded),) = read_pieces(part, part.logs[0])
        examine(recorded, part.repair)  # which says why it cannot be used
    return Inspection.of(str(source), manifest, part, seen)


def robot_of(
    source: Named,
    *,
    hand_mass: float | None = None,
    added_mass: float = 0.0,
    arm: float | None = None,
) -> RobotModel:
    """Return the robot of an experiment, or the twin that data or a saved result make.

    A saved result is the estimate; other data are identified by the method that suits them.
    InputError if the source is of a slide, UnusableError if no joint has what was identified.
    """
    path = locate(Path(source))
    carried = AddedMass(mass=added_mass, arm=ARM if arm is None else arm)
    if not is_data(path):
        plan = read_experiment(path)
        command = vars(plan.plant.path)
        return RobotModel.of(plan.name, plan.plant.robot, carried, plan.input_kind, command)
    result = saved_identification(path)
    if result is None:
        result = identify(read(path, arm=arm), Suitable())
    return _twin(result, carried, hand_mass)


def _twin(result: Identification, carried: AddedMass, mass: float | None) -> RobotModel:
    """Return the simulated robot that moves as an identified one."""
    about, found = result.origin, result.estimate
    joint, kind = JointKind(about.get("joint", JointKind.HINGE)), InputKind(about["input"])
    if joint is JointKind.SLIDE:
        raise InputError(about["name"], "joint", joint, "a hinge, which the model in MuJoCo has")
    verdict = require_possible(found)
    carried = replace(carried, gravity=float(about.get("gravity", GRAVITY)))
    robot, rest = Robot.of_loaded(found.parameters, carried, mass)
    note = ""
    if mass is None and robot.hand.mass > HAND_MASS:
        note = (
            f"The hand has a mass of {robot.hand.mass:.3g} kg (--hand-mass): none of "
            f"{HAND_MASS:g} kg can have its p1 and p3, and the motion does not depend on it."
        )
    return RobotModel.of(
        about["name"],
        robot,
        rest,
        kind,
        command_of(found.parameters),
        verdict=verdict,
        note=note,
        besides={**result.basis(), **estimate_numbers(found)},
    )
