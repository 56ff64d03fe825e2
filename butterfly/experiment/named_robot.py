"""Whether a user names data or an experiment, and the file of a robot for MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

from butterfly.errors import InputError
from butterfly.experiment.data_source import RESULT
from butterfly.files import replacing
from butterfly.logs.formats import FORMATS
from butterfly.plant.mjcf import mjcf
from butterfly.yaml_document import load_yaml

if TYPE_CHECKING:
    from pathlib import Path

    from butterfly.model.parameters import AddedMass
    from butterfly.plant.robot import Robot


def export(robot: Robot, added: AddedMass, path: Path) -> None:
    """Write a robot as one MJCF file, light and camera included.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with replacing(path) as draft:
        draft.write_text(mjcf(robot, added, scene=True), encoding="utf-8")


def is_data(path: Path) -> bool:
    """Whether a path is one of data; a file that is no YAML is left to its reader to refuse."""
    if path.is_dir() or path.suffix.lower() in {*FORMATS, RESULT}:
        return True
    try:
        return "logs" in load_yaml(path).content
    except InputError:
        return False
