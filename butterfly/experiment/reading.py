"""Read an experiment file, with what it extends and the files that it names."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from butterfly.errors import InputError
from butterfly.experiment.schema import Experiment, TableFile
from butterfly.experiment.signal_tables import filled, read_table
from butterfly.files import require_path
from butterfly.plant.excitations import Table
from butterfly.resources import locate, shipped
from butterfly.yaml_document import Document, load_yaml
from butterfly.yaml_input import StrictModel, validate

_DEEPEST = 10  # files that may extend each other
_OF_SIGNALS = re.compile(r"\bfile\.(choice\.)?path\.")  # in the place of a path, as a sweep says it


class _Signals(StrictModel):
    """The part of an experiment that names files."""

    file: TableFile


class Source:
    """An experiment file and what it extends, merged.

    Parameters
    ----------
    path
        The file.

    Attributes
    ----------
    content
        The merged mapping; files of signals are named as they lie from the file's folder on.
    tables
        Signals that were read from files so far, by their digests.
    signals
        These files.

    Raises
    ------
    InputError
        If a file cannot be read, is not YAML, or lies outside the allowed folders: that of the file
        which names it, and those below; and the shipped experiments.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._documents = _chain(path)
        content: dict[str, Any] = {}
        for document in reversed(self._documents):
            content = _merged(content, _seen_from(path.parent, document))
        content.pop("extends", None)
        self.content = content
        self.tables: dict[str, Table] = {}
        self.signals: dict[TableFile, Path] = {}
        self._digests: dict[TableFile, str] = {}

    @property
    def paths(self) -> list[Path]:
        """The file, and those that it extends."""
        return [document.path for document in self._documents]

    def experiment(self, content: dict[str, Any] | None = None) -> Experiment:
        """Validate the merged content, or a variation of it.

        Raises
        ------
        InputError
            On the first field that does not follow the schema, with file and line; or if a file of
            signals cannot be read.
        """
        read = self.with_digests(content or self.content)
        return validate(self._documents, filled(read, self.tables), Experiment)

    def with_digests(self, content: dict[str, Any]) -> dict[str, Any]:
        """Read the files of signals that a content names, and put their digests in their places.

        Raises
        ------
        InputError
            If one cannot be read.
        """
        signals = content.get("signals")
        if not isinstance(signals, list):
            return content
        return {**content, "signals": [self._with_digest(signal) for signal in signals]}

    def _with_digest(self, signal: Any) -> Any:  # noqa: ANN401 - whatever stands in the file
        if not (isinstance(signal, dict) and set(signal) == {"file"}):
            return signal
        named = validate(self._documents, signal, _Signals).file
        if named not in self._digests:
            path = _allowed(self.path.parent, named.path, self.path)
            digest, table = read_table(path, named.time, named.values)
            self.tables[digest] = table
            self._digests[named] = digest
            self.signals[named] = path
        return {"table": self._digests[named]}


def read_experiment(path: Path) -> Experiment:
    """Read an experiment file.

    Raises
    ------
    InputError
        If it does not follow the schema, or a file that it names cannot be read.
    """
    return Source(path).experiment()


def inside(folder: Path, named: Path, source: Path) -> Path:
    """Resolve a path named in a file against its folder, and keep it below.

    Raises
    ------
    InputError
        If it leads out of the folder.
    """
    require_path(str(named), source, "path")
    path = (folder / named).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise InputError(source, "path", named, f"a path below {folder.resolve()}")
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
        if base in [each.path.resolve() for each in documents] or len(documents) == _DEEPEST:
            raise InputError(document.path, "extends", named, "a file that does not lead back here")
        documents.append(load_yaml(base))
    return documents


def _seen_from(folder: Path, document: Document) -> dict[str, Any]:
    """Return what a file says, its paths of signals as seen from ``folder``.

    A file names them from its own folder on, wherever the file lies that extends it.
    """
    own = document.path.parent
    if own.resolve() == folder.resolve():
        return document.content

    def named(path: str) -> str:
        found = inside(own, Path(path), document.path)
        below = found.is_relative_to(folder.resolve())
        return (found.relative_to(folder.resolve()) if below else found).as_posix()

    found: dict[str, Any] = _with_paths(document.content, named)
    return found


def _with_paths(value: Any, named: Callable[[str], str], place: str = "") -> Any:  # noqa: ANN401 - any YAML
    """Return a content with other paths of signals, those that a sweep sets by their place too."""
    if isinstance(value, dict):
        return {key: _with_paths(each, named, f"{place}{key}.") for key, each in value.items()}
    if isinstance(value, list):
        return [_with_paths(each, named, place) for each in value]
    return named(value) if isinstance(value, str) and _OF_SIGNALS.search(place) else value


def _allowed(folder: Path, named: Path, source: Path) -> Path:
    """Return the place of a file of signals: below a folder, or shipped beside an experiment."""
    if named.is_absolute() and named.is_relative_to(shipped("experiments").resolve()):
        return named
    return inside(folder, named, source)


def _base(path: Path, named: str) -> Path:
    require_path(named, path, "extends")
    beside = path.parent / named
    if beside.exists():
        if beside.resolve().is_relative_to(shipped("experiments").resolve()):
            return beside.resolve()
        return inside(path.parent, Path(named), path)
    if Path(named).is_absolute() or ".." in Path(named).parts:
        raise InputError(path, "extends", named, "a file beside this one, or a shipped experiment")
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
"""Mappings that name one of several kinds, or belong together: replaced as a whole."""
