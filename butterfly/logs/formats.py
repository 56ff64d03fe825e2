"""The file formats of logs, by the endings of their names."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from butterfly.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from butterfly.logs.log import Log


@dataclass(frozen=True, kw_only=True)
class Format:
    """How logs are read from files of one ending, and written to them.

    Parameters
    ----------
    name
        Of the module of this package that does it, imported when it is used: each is slow.
    mapped
        Whether the file's columns may have any names, said by a map that ``read`` takes second.
    """

    name: str
    mapped: bool = False

    @property
    def read(self) -> Callable[..., Log]:
        """Reader, of a path and the fields of `Log` that the file does not hold."""
        return self._function("read")

    @property
    def write(self) -> Callable[[Log, Path], None]:
        """Writer, of a log and a path."""
        return self._function("write")

    def _function(self, verb: str) -> Callable[..., Any]:
        module = import_module(f"butterfly.logs.{self.name}")
        function: Callable[..., Any] = getattr(module, f"{verb}_{self.name}")
        return function


FORMATS = {
    ".mat": Format(name="mat"),
    ".csv": Format(name="csv", mapped=True),
    ".parquet": Format(name="parquet"),
}

ENDINGS = " or ".join([", ".join(list(FORMATS)[:-1]), list(FORMATS)[-1]])
"""The endings, in words."""


def read_log(path: Path, columns: Mapping[str, str] | None = None, **properties: Any) -> Log:  # noqa: ANN401 - the fields of Log that a file cannot know
    """Read one file, by its ending.

    Parameters
    ----------
    path
        The file.
    columns
        Column map, for formats whose columns may have any names.
    properties
        Fields of `Log` that the file does not hold; its ``name`` is the file's if not given.

    Raises
    ------
    InputError
        If the file cannot be read, or is of none of the `FORMATS`.
    """
    found = _format_of(path)
    arguments = (columns,) if found.mapped else ()
    return found.read(path, *arguments, **{"name": path.name} | properties)


def write_log(log: Log, path: Path) -> None:
    """Write one file, in the format of its ending.

    Raises
    ------
    InputError
        If the file cannot be written, or is of none of the `FORMATS`.
    """
    _format_of(path).write(log, path)


def _format_of(path: Path) -> Format:
    if path.suffix.lower() not in FORMATS:
        raise InputError(path, "file name", path.suffix or "no ending", ENDINGS)
    return FORMATS[path.suffix.lower()]
