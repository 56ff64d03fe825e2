"""The MuJoCo twin of whatever robot a user names."""

from __future__ import annotations

from typing import TYPE_CHECKING

from butterfly.errors import InputError
from butterfly.experiment.reading import read_experiment
from butterfly.files import replacing
from butterfly.identify.data import read_data_set
from butterfly.identify.estimators import HarmonicBalance
from butterfly.logs.manifest import MANIFEST_NAME, read_manifest
from butterfly.plant.mjcf import mjcf
from butterfly.plant.twin import MASS, twin
from butterfly.resources import locate
from butterfly.yaml_input import load_yaml

if TYPE_CHECKING:
    from pathlib import Path

    from butterfly.model.parameters import AddedMass
    from butterfly.plant.robot import Robot


def robot_of(source: Path, root: Path | None = None, mass: float = MASS) -> Robot:
    """Return the robot of an experiment file, or the identified twin of a data set.

    Parameters
    ----------
    source
        An experiment file, a manifest, a folder with one, or the name of a shipped one.
    root
        Folder of the logs, if not the one that the manifest names.
    mass
        Mass in kg given to an identified hand.

    Raises
    ------
    InputError
        If ``source`` is none of these, or cannot be read.
    """
    path = locate(source)
    if path.is_dir():
        path /= MANIFEST_NAME
    if _is_manifest(path):
        return twin(
            HarmonicBalance(check=False)(read_data_set(read_manifest(path, root))).parameters, mass
        )
    return read_experiment(path).plant.robot


def export(robot: Robot, added: AddedMass, path: Path) -> None:
    """Write a robot as one MJCF file, light and camera included.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with replacing(path) as draft:
        draft.write_text(mjcf(robot, added, scene=True), encoding="utf-8")


def _is_manifest(path: Path) -> bool:
    """Whether a YAML file lists logs; a file that is no YAML is left to its reader to refuse."""
    try:
        return "logs" in load_yaml(path).content
    except InputError:
        return False
