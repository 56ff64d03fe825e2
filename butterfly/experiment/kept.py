"""The experiment that results came of, kept beside them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from butterfly.errors import InputError
from butterfly.experiment.reading import Source
from butterfly.files import replacing
from butterfly.yaml_output import yaml_text

EXPERIMENT = "experiment.yaml"
"""File beside results that says what was done."""

_HEAD = """\
# What was asked for these results: the experiment file with all that it extends.
# `butterfly run` of this file does it again.
"""


def keep_experiment(source: Source, folder: Path) -> list[str]:
    """Write an experiment as it was given, what it extends put in, and the signals that it names.

    Read again, it is the same experiment: its runs have the same addresses.

    Parameters
    ----------
    source
        Read, and planned if it is a sweep, so that all signals are known.
    folder
        Of the results.

    Returns
    -------
    Names of the files, below the folder.

    Raises
    ------
    InputError
        If a file cannot be written, or would take the place of one that was read.
    """
    signals = {named.path: path for named, path in source.signals.items()}
    within = {name: _below(path, source) for name, path in signals.items()}
    text = yaml_text(_with_paths(source.content, {str(k): v for k, v in within.items()}))
    contents = {EXPERIMENT: (_HEAD + text).encode()}
    contents |= {within[name]: path.read_bytes() for name, path in signals.items()}
    read = [path.resolve() for path in (*source.paths, *signals.values())]
    written = []
    for name, content in contents.items():
        place = folder / name
        written.append(name)
        if place.resolve() in read and place.read_bytes() == content:
            continue
        if place.resolve() in read:
            expected = "a folder for results that is not the experiment's own (--out)"
            raise InputError(place, "path", "the file of the experiment", expected)
        with replacing(place) as draft:
            draft.write_bytes(content)
    return written


def _below(path: Path, source: Source) -> str:
    """Return where a file lies below the experiment's folder."""
    return path.relative_to(source.path.parent.resolve()).as_posix()


def _with_paths(value: Any, within: Mapping[str, str]) -> Any:  # noqa: ANN401 - any YAML
    """Return a content whose files of signals are named as they lie below a folder."""
    if isinstance(value, list):
        return [_with_paths(each, within) for each in value]
    if not isinstance(value, dict):
        return value
    content = {key: _with_paths(each, within) for key, each in value.items()}
    named = content.get("file")
    if isinstance(named, dict) and named.get("path") in within:
        content["file"] = {**named, "path": within[named["path"]]}
    return content
