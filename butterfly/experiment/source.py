"""An experiment file, the files that it extends and names: read, and written with results.

A signal's file is read once for all runs of a sweep: the content of an experiment has the digest of
its table, and the long table is sent separately, once.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.arguments import checked
from butterfly.errors import InputError
from butterfly.experiment.schema import Experiment, SignalSpec, TableFile
from butterfly.files import locate, require_path, shipped, write_file
from butterfly.logs.csv import read_columns
from butterfly.signals.excitations import Table
from butterfly.yaml_files import Document, load_yaml, validate, yaml_text

EXPERIMENT = "experiment.yaml"
"""File with results that describes the experiment."""

_DEEPEST = 10  # files that may extend each other
_OF_SIGNALS = re.compile(r"\bfile\.(choice\.)?path\.")  # in the place of a path, as a sweep says it
_STORED = "sha256:"

HEAD = """\
# The experiment of these results, with all files that it extends.
# To repeat it: `butterfly run` this file.
"""
"""How the experiment begins that is kept with its results."""


class Source:
    """An experiment file merged with the files it extends (its folder, below, or shipped)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.documents = _chain(path)
        self.files: dict[str, Path] = {}
        """Signal files by their names beside results."""
        content: dict[str, Any] = {}
        for document in reversed(self.documents):
            changes = _with_paths(document.content, partial(self._name, document.path))
            content = _merged(content, changes)
        content.pop("extends", None)
        self.content = content
        """The merged mapping, in which signal files have their names beside results."""
        self.tables: dict[str, Table] = {}
        """Signals read from files so far, by digest."""
        self.digests: dict[TableFile, str] = {}
        """Digests of the tables of these files."""

    def _name(self, source: Path, path: str) -> str:
        """Return the name beside results of a signal file in one of the experiment's files."""
        file, folder = _inside(source, path), self.path.parent.resolve()
        below = file.relative_to(folder) if file.is_relative_to(folder) else Path(file.name)
        name = below.as_posix()
        while self.files.setdefault(name, file) != file:  # of another folder
            name = f"_{name}"
        return name

    def experiment(self, content: dict[str, Any] | None = None) -> Experiment:
        """Validate the merged content, or a variation of it, including signal files."""
        read = self.with_digests(content or self.content)
        return validate(self.documents, filled(read, self.tables), Experiment)

    def with_digests(self, content: dict[str, Any]) -> dict[str, Any]:
        """Read the signal files of a content, and replace them by their digests."""
        return _with_signals(content, self._with_digest)

    def _with_digest(self, signal: Any) -> Any:  # noqa: ANN401 - whatever stands in the file
        if not (isinstance(signal, dict) and set(signal) == {"file"}):
            return signal
        named = validate(self.documents, signal, SignalSpec).chosen
        if named not in self.digests:
            path = self.files[named.path.as_posix()]
            digest, table = read_table(path, named.time, named.values)
            self.tables[digest], self.digests[named] = table, digest
        return {"table": self.digests[named]}


@checked
def read_experiment(path: str | PathLike[str]) -> Experiment:
    """Read an experiment file, or a shipped one by its name.

    Raises
    ------
    InputError
        For the first invalid field, with file and line.
    """
    if not str(path):
        raise InputError("read_experiment", "path", "empty", "a path or a name")
    return Source(locate(Path(path))).experiment()


def keep_experiment(source: Source, folder: Path) -> list[str]:
    """Write a planned experiment and its signal files to a folder; return their names.

    InputError if that would change a file that was read.
    """
    contents = {EXPERIMENT: (HEAD + yaml_text(source.content)).encode()}
    names = [named.path.as_posix() for named in source.digests]
    contents |= {name: source.files[name].read_bytes() for name in names}
    extended = (document.path.resolve() for document in source.documents)
    read = {*extended, *(source.files[name] for name in names)}
    for name, content in contents.items():
        place = folder / name
        if place.resolve() in read and place.read_bytes() == content:
            continue
        if place.resolve() in read:
            expected = "another folder for results (--out)"
            raise InputError(place, "path", "the experiment file itself", expected)
        write_file(place, content)
    return list(contents)


def read_table(path: Path, time: str, values: str) -> tuple[str, Table]:
    """Read a signal from two columns of a CSV file; return its digest, and the table."""
    columns = read_columns(path, [time, values])
    try:
        table = Table(time=tuple(columns[0].tolist()), values=tuple(columns[1].tolist()))
    except InputError as error:
        raise InputError(path, error.field, error.value, error.expected) from None
    content = np.ascontiguousarray(columns, dtype="<f8").tobytes()
    return _STORED + hashlib.sha256(content).hexdigest(), table


def filled(content: Mapping[str, Any], tables: Mapping[str, Table]) -> dict[str, Any]:
    """Return an experiment's content with tables instead of their digests."""

    def table_of(signal: Any) -> Any:  # noqa: ANN401 - whatever stands in the file
        table = tables.get(signal_digest(signal) or "")
        return signal if table is None else {"table": table}

    return _with_signals(content, table_of)


def _with_signals(content: Mapping[str, Any], changed: Callable[[Any], Any]) -> dict[str, Any]:
    """Return a content with changed signals, if any."""
    signals = content.get("signals")
    part = {"signals": [changed(signal) for signal in signals]} if isinstance(signals, list) else {}
    return {**content, **part}


def signal_digest(signal: Any) -> str | None:  # noqa: ANN401 - whatever stands in the file
    """Return the digest of a signal's table; None without one."""
    named = signal.get("table") if isinstance(signal, dict) else None
    return named if isinstance(named, str) and named.startswith(_STORED) else None


def _inside(source: Path, named: str) -> Path:
    """Resolve a path in a file against its folder; InputError if it leads out of it."""
    require_path(named, source, "path")
    folder = source.parent.resolve()
    path = (folder / named).resolve()
    if not path.is_relative_to(folder):
        raise InputError(source, "path", named, f"a path inside {folder}")
    return path


def _chain(path: Path) -> list[Document]:
    """Return a file and the files that it extends, in turn."""
    documents = [load_yaml(path)]
    while "extends" in documents[-1].content:
        document = documents[-1]
        named = document.content["extends"]
        if not isinstance(named, str):
            raise InputError(document.path, "extends", named, "the path of an experiment file")
        base = _base(document.path, named)
        if base in [file.path.resolve() for file in documents] or len(documents) == _DEEPEST:
            expected = "a file that does not extend this one"
            raise InputError(document.path, "extends", named, expected)
        documents.append(load_yaml(base))
    return documents


def _with_paths(value: Any, named: Callable[[str], str], place: str = "") -> Any:  # noqa: ANN401 - any YAML
    """Return a content with other paths of signals, including those set by a sweep."""
    if isinstance(value, dict):
        return {key: _with_paths(part, named, f"{place}{key}.") for key, part in value.items()}
    if isinstance(value, list):
        return [_with_paths(part, named, place) for part in value]
    return named(value) if isinstance(value, str) and _OF_SIGNALS.search(place) else value


def _base(path: Path, named: str) -> Path:
    require_path(named, path, "extends")
    sibling = path.parent / named
    if sibling.exists():
        if sibling.resolve().is_relative_to(shipped("experiments").resolve()):
            return sibling.resolve()
        return _inside(path, named)
    if Path(named).is_absolute() or ".." in Path(named).parts:
        expected = "a file in the same folder, or a shipped experiment"
        raise InputError(path, "extends", named, expected)
    return locate(Path(named)).resolve()


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` with ``changes``: mappings merged key by key, everything else replaced."""
    result = dict(base)
    for key, value in changes.items():
        old = result.get(key)
        if isinstance(old, dict) and isinstance(value, dict) and key not in _REPLACED:
            value = _merged(old, value)  # noqa: PLW2901 - the same key, completed
        result[key] = value
    return result


_REPLACED = frozenset({"drive", "target", "velocity", "sweep"})
"""Mappings that are replaced as a whole, since their keys belong together."""
