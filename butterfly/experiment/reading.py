"""Read an experiment file, with what it extends and the files that it names."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from butterfly.errors import InputError
from butterfly.experiment.schema import Experiment, TableFile
from butterfly.logs.csv import read_columns
from butterfly.resources import locate, shipped
from butterfly.yaml_input import Document, StrictModel, load_yaml, validate

if TYPE_CHECKING:
    from collections.abc import Mapping

_DEEPEST = 10  # files that may extend each other


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
        The merged mapping, files of signals read into tables: all that a run needs.

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
            content = _merged(content, document.content)
        content.pop("extends", None)
        self.content = content
        self.content["signals"] = [self._table(each) for each in self._signals()]
        if not self.content["signals"]:
            del self.content["signals"]

    def experiment(self, content: dict[str, Any] | None = None) -> Experiment:
        """Validate the merged content, or a variation of it.

        Raises
        ------
        InputError
            On the first field that does not follow the schema, with file and line.
        """
        return validate(self._documents, content or self.content, Experiment)

    def _signals(self) -> list[Any]:
        signals = self.content.get("signals", [])
        return list(signals) if isinstance(signals, list) else [signals]

    def _table(self, signal: Any) -> Any:  # noqa: ANN401 - whatever stands in the file
        if not (isinstance(signal, dict) and set(signal) == {"file"}):
            return signal
        named = validate(self._documents, signal, _Signals).file
        path = inside(self.path.parent, named.path, self.path)
        time, values = read_columns(path, [named.time, named.values])
        return {"table": {"time": time.tolist(), "values": values.tolist()}}


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


def _base(path: Path, named: str) -> Path:
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
