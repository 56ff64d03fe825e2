"""The MuJoCo twin of whatever robot a user names."""

from __future__ import annotations

from typing import TYPE_CHECKING

from butterfly.errors import InputError
from butterfly.experiment.data_source import RESULT, named_data
from butterfly.experiment.reading import read_experiment
from butterfly.files import replacing
from butterfly.identify.estimators import HarmonicBalance
from butterfly.logs.formats import FORMATS
from butterfly.plant.mjcf import mjcf
from butterfly.plant.twin import MASS, twin
from butterfly.resources import locate
from butterfly.yaml_input import load_yaml

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from butterfly.identify.data import DataSet
    from butterfly.model.parameters import AddedMass
    from butterfly.plant.robot import Robot


def robot_of(
    source: Path, mass: float = MASS, read: Callable[[Path], DataSet] = named_data
) -> Robot:
    """Return the robot of an experiment file, or the identified twin of a data set.

    Parameters
    ----------
    source
        An experiment file or the name of a shipped one, or data (see `named_data`).
    mass
        Mass in kg given to an identified hand.
    read
        Reads data.

    Raises
    ------
    InputError
        If ``source`` is none of these, or cannot be read.
    """
    path = locate(source)
    if not is_data(path):
        return read_experiment(path).plant.robot
    return twin(HarmonicBalance(check=False)(read(source)).parameters, mass)


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
