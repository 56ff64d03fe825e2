"""The file formats of logs, by the endings of their names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from butterfly.errors import InputError
from butterfly.logs.column_map import ColumnMap
from butterfly.logs.log import Log
from butterfly.logs.units import AS_IS, Units


@dataclass(frozen=True, kw_only=True)
class Format:
    """How logs are read from files of one ending, and written to them.

    Parameters
    ----------
    name
        Of the module of this package that does it, imported when it is used: each is slow.
    texts
        Whether files of this ending are often texts of another kind.
    """

    name: str
    texts: bool = False

    @property
    def read(self) -> Callable[..., Log]:
        """Reader, of a path, a column map, units and the fields of `Log` that no file holds."""
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
    ".csv": Format(name="csv"),
    ".parquet": Format(name="parquet"),
    ".tsv": Format(name="csv"),
    ".txt": Format(name="csv", texts=True),
    ".dat": Format(name="csv", texts=True),
}

ENDINGS = " or ".join([", ".join(list(FORMATS)[:-1]), list(FORMATS)[-1]])
"""The endings, in words."""


def read_log(
    path: Path,
    columns: ColumnMap | None = None,
    units: Units = AS_IS,
    **properties: Any,  # noqa: ANN401 - the fields of Log that a file cannot know
) -> Log:
    """Read one file, by its ending.

    Parameters
    ----------
    path
        The file.
    columns
        What holds ``time``, ``input``, ``angle`` and, if wanted, ``velocity``: columns of a table
        or variables of a .mat file, by name or number.
    units
        Of the columns.
    properties
        Fields of `Log` that the file does not hold; its ``name`` is the file's if not given.

    Raises
    ------
    InputError
        If the file cannot be read, or is of none of the `FORMATS`.
    """
    return _format_of(path).read(path, columns, units, **{"name": path.name} | properties)


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
