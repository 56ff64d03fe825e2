"""Logs in MATLAB's files: the thesis's matrix ``D`` of columns t, u, q, dq, or named variables."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, savemat, whosmat

from butterfly.errors import InputError, nearest, size_text
from butterfly.files import most_in, replacing
from butterfly.logs.formats import ColumnMap, checked_map
from butterfly.logs.log import SAMPLED, Log
from butterfly.logs.mat5 import whole
from butterfly.logs.units import AS_IS, Units

_MATRIX = "D"
_OBJECTS = (
    "a MATLAB object (timeseries, table, Simulink.SimulationOutput), which only MATLAB can read",
    "plain vectors, saved as t = x.Time; u = x.Data; save('log.mat', 't', 'u')",
)
_VERSION = slice(124, 126)  # of the header, which hold the version
_HDF5 = b"\x00\x02"
_OWN = "#"  # begins what MATLAB keeps for itself
_PLAIN = {"double", "single", "logical", "char", "struct"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
_OF_NODE = 1 << 14  # bytes that count for a node besides its own: of nodes in a ring is no end


def read_mat(
    path: Path,
    columns: ColumnMap | None = None,
    units: Units = AS_IS,
    **properties: Any,  # noqa: ANN401 - the fields of Log that a file cannot know
) -> Log:
    """Read a MATLAB file (see `read_log`); v7.3 needs the extra ``hdf5``.

    A column is a vector (``t``), a field of a struct (``data.t``) or a column of a matrix (``M.0``,
    or ``0`` of ``D``). Without a map they are the columns t, u, q[, dq] of ``D``.
    """
    arrays: dict[str, Any]
    if columns is None:
        matrix = _matrix(path)
        arrays = dict(zip(SAMPLED, np.ascontiguousarray(matrix.T, dtype=np.float64), strict=False))
    else:
        mapping = {field: _parts(name) for field, name in checked_map(path, columns).items()}
        variables = _load(path, {parts[0] for parts in mapping.values()})
        arrays = {field: _vector(path, variables, parts) for field, parts in mapping.items()}
    return Log(**arrays, source=str(path), **properties).converted(units)


def write_mat(log: Log, path: Path) -> None:
    """Write a log in the thesis's form; a missing velocity column is left out.

    Not compressed: angles and velocities hardly shrink, and to inflate them takes longer than all
    else that is done with a log of a minute.
    """
    matrix = np.column_stack(list(log.columns().values()))
    with replacing(path) as draft:
        savemat(draft, {_MATRIX: matrix})


def _parts(name: str | int) -> list[str]:
    """Split the name of a variable, field or column; a number alone is a column of ``D``."""
    parts = str(name).split(".")
    return [_MATRIX, *parts] if parts[0].isdecimal() else parts


def _matrix(path: Path) -> NDArray[Any]:
    matrix = _load(path, {_MATRIX}).get(_MATRIX)
    if matrix is None:
        _refuse_objects(path, _MATRIX)
        listed = ", ".join(_names(path)) or "none"
        found = f"no such variable (there are: {listed})"
        expected = "a matrix D with columns t, u, q[, dq], or --columns time=T,input=U,angle=Q"
        raise InputError(path, _MATRIX, found, expected)
    if not isinstance(matrix, np.ndarray) or matrix.ndim != 2 or matrix.shape[1] not in (3, 4):  # noqa: PLR2004 - t, u, q[, dq]
        found = type(matrix).__name__
        found = f"shape {matrix.shape}" if isinstance(matrix, np.ndarray) else found
        raise InputError(path, _MATRIX, found, "shape (n, 3) or (n, 4): t, u, q[, dq]")
    if matrix.dtype.kind not in "fiu":
        raise InputError(path, _MATRIX, f"type {matrix.dtype}", "real numbers")
    return matrix


def _load(path: Path, names: Collection[str]) -> dict[str, Any]:
    """Return the variables of some names that there are: arrays, or mappings of fields."""
    if not path.is_file():
        raise InputError(path, "path", "no such file", "an existing .mat file")
    if is_mat73(path):
        return load73(path, names)
    try:
        file = whole(path)
        return dict(loadmat(file, variable_names=list(names), simplify_cells=names != {_MATRIX}))
    except Exception as error:  # scipy's reader meets corrupt bytes with whatever they lead to
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(path, "content", f"unreadable ({reason})", "a whole .mat file") from None


def _names(path: Path) -> list[str]:
    return names73(path) if is_mat73(path) else [name for name, *_ in whosmat(whole(path)) if name]


def _vector(path: Path, variables: dict[str, Any], parts: list[str]) -> NDArray[np.float64]:
    """Return a vector by the name of its variable and what follows."""
    wanted = ".".join(parts)
    if parts[0] not in variables:
        _refuse_objects(path, wanted)
        raise InputError(path, wanted, "no such variable", _listing(parts[0], _names(path)))
    found: Any = variables[parts[0]]
    for k, part in enumerate(parts[1:], 1):
        if isinstance(found, dict) and part in found:
            found = found[part]
        elif isinstance(found, np.ndarray) and part.isdecimal() and _is_column(found, int(part)):
            found = found[:, int(part)]
        else:
            where = ".".join(parts[:k])
            valid = list(found) if isinstance(found, dict) else _column_numbers(found)
            raise InputError(path, wanted, f"no {part} in {where}", _listing(part, valid))
    if type(found).__name__.startswith("Matlab"):
        raise InputError(path, wanted, *_OBJECTS)
    if isinstance(found, dict):
        expected = f"one of its fields: {', '.join(f'{wanted}.{each}' for each in found)}"
        raise InputError(path, wanted, "a struct", expected)
    values = np.asarray(found)
    if values.dtype.kind not in "fiu":
        raise InputError(path, wanted, f"type {values.dtype}", "real numbers")
    if values.size != max(values.shape, default=0):
        expected = f"a vector, or one of its columns: {wanted}.0, ..."
        raise InputError(path, wanted, f"shape {values.shape}", expected)
    return np.asarray(values.ravel(), dtype=np.float64)


def _refuse_objects(path: Path, wanted: str) -> None:
    """Raise InputError if a file of before v7.3 holds objects, whose names it does not give."""
    if not is_mat73(path) and any(kind == "opaque" for _, _, kind in whosmat(whole(path))):
        raise InputError(path, wanted, *_OBJECTS)


def _is_column(values: NDArray[Any], number: int) -> bool:
    return values.ndim == 2 and number < values.shape[1]  # noqa: PLR2004 - a matrix


def _column_numbers(found: Any) -> list[str]:  # noqa: ANN401 - whatever the file holds
    return [str(k) for k in range(np.shape(found)[1])] if np.ndim(found) == 2 else []  # noqa: PLR2004


def _listing(wanted: str, valid: list[str]) -> str:
    return (
        nearest(wanted, valid) if valid else "a file that holds it: there is nothing to name here"
    )


class MatlabObject:
    """Stands for an object of MATLAB's, which nobody else can read."""


def is_mat73(path: Path) -> bool:
    """Whether a file claims to be one of v7.3."""
    with path.open("rb") as file:
        return file.read(128)[_VERSION] == _HDF5


def names73(path: Path) -> list[str]:
    """Return the names of the variables of a file of v7.3."""
    with _opened(path) as file:
        try:
            return [str(name) for name in file if not name.startswith(_OWN)]
        except Exception as error:  # as in `load73`
            raise _damaged(path, error) from None


def load73(path: Path, names: Collection[str]) -> dict[str, Any]:
    """Return the variables of some names that there are: arrays, or mappings of fields."""
    room = _Room(most_in(path.stat().st_size))
    with _opened(path) as file:
        try:
            return {name: _value(file[name], room) for name in names if name in file}
        except Exception as error:  # HDF5's reader meets corrupt bytes with whatever they lead to
            raise _damaged(path, error) from None


def _opened(path: Path) -> Any:  # noqa: ANN401 - h5py is an extra
    try:
        import h5py  # noqa: PLC0415 - an extra
    except ImportError:
        expected = "h5py (pip install 'butterfly-testbed[hdf5]'), or a file saved with '-v7'"
        raise InputError(path, "content", "MATLAB v7.3 (HDF5)", expected) from None
    try:
        return h5py.File(path, "r")
    except OSError as error:
        raise _damaged(path, error) from None


def _damaged(path: Path, error: Exception) -> InputError:
    reason = " ".join(str(error).split())
    return InputError(path, "content", f"unreadable ({reason})", "a whole .mat file")


@dataclass
class _Room:
    """Bytes that a file may still hold."""

    left: int

    def take(self, size: int) -> None:
        """Raise ValueError if there are not as many: a file may claim any size."""
        if not 0 <= size <= self.left:
            raise ValueError(f"arrays of {size_text(size)} more than there may be")
        self.left -= size


def _value(node: Any, room: _Room) -> Any:  # noqa: ANN401 - h5py is an extra
    """Return a variable as MATLAB has it: HDF5 keeps its dimensions the other way round."""
    room.take(_OF_NODE)
    kind = node.attrs.get("MATLAB_class", b"")
    if "MATLAB_object_decode" in node.attrs or (kind and kind.decode() not in _PLAIN):
        return MatlabObject()
    if hasattr(node, "items"):
        return {key: _value(below, room) for key, below in node.items()}
    room.take(node.nbytes)
    values = np.asarray(node[()])
    return np.asarray("".join(map(chr, values.ravel()))) if kind == b"char" else values.T
