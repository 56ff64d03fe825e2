"""Whether a user names data or an experiment."""

from __future__ import annotations

from pathlib import Path

from butterfly.errors import InputError
from butterfly.experiment.data_source import RESULT
from butterfly.logs.formats import FORMATS
from butterfly.yaml_document import load_yaml


def is_data(path: Path) -> bool:
    """Whether a path is one of data; a file that is no YAML is left to its reader to refuse."""
    if path.is_dir() or path.suffix.lower() in {*FORMATS, RESULT}:
        return True
    try:
        return "logs" in load_yaml(path).content
    except InputError:
        return False
