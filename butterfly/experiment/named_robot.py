"""Whether a user names data or an experiment, and the file of a robot for MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from butterfly.errors import InputError
from butterfly.files import replacing
from butterfly.logs.formats import FORMATS
from butterfly.model.parameters import AddedMass
from butterfly.plant.robot import Robot
from butterfly.plant.stand_alone import StandAlone, stand_alone
from butterfly.yaml_document import load_yaml

RESULT = ".json"
"""Ending of a saved result."""


def export(robot: Robot, added: AddedMass, path: Path, command: Mapping[str, float]) -> StandAlone:
    """Write a robot as one MJCF file that moves by itself, light and camera included.

    Parameters
    ----------
    robot, added
        The robot and what it carries.
    path
        The file.
    command
        What becomes of the robot's command on its way, as `stand_alone` takes it.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    written = stand_alone(robot, added, **command)
    with replacing(path) as draft:
        draft.write_text(written.text, encoding="utf-8")
    return written


def is_data(path: Path) -> bool:
    """Whether a path is one of data; a file that is no YAML is left to its reader to refuse."""
    if path.is_dir() or path.suffix.lower() in {*FORMATS, RESULT}:
        return True
    try:
        return "logs" in load_yaml(path).content
    except InputError:
        return False
