"""Logs in MATLAB's files: the thesis's matrix ``D`` of columns t, u, q, dq, or named variables."""

from __future__ import annotations

import math
import mmap
import struct
import zlib
from collections.abc import Collection, Container
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, savemat

from butterfly.errors import InputError, nearest, size_text
from butterfly.files import most_in, replacing
from butterfly.logs.formats import ColumnMap, checked_map
from butterfly.logs.log import SAMPLED, Log
from butterfly.logs.units import AS_IS, Heading, Units

_MATRIX = "D"
_OBJECTS = (
    "a MATLAB object (timeseries, table, Simulink.SimulationOutput), which only MATLAB can read",
    "plain vectors, saved as t = x.Time; u = x.Data; save('log.mat', 't', 'u')",
)


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
    if columns is None:
        arrays: dict[str, Any] = dict(zip(SAMPLED, _matrix(path).T, strict=False))
        headings = {field: Heading(name=_MATRIX, number=k) for k, field in enumerate(arrays)}
    else:
        mapping = {field: _parts(name) for field, name in checked_map(path, columns).items()}
        said: dict[str, dict[str, str]] = {}
        variables, names = _load(path, {parts[0] for parts in mapping.values()}, said)
        arrays = {field: _vector(path, variables, names, own) for field, own in mapping.items()}
        named = {field: ".".join(own) for field, own in mapping.items()}
        headings = {
            field: Heading(name=each, said=said.get(each, {})) for field, each in named.items()
        }
    return Log.of_columns(arrays, headings, units, source=str(path), **properties)


def write_mat(log: Log, path: Path) -> None:
    """Write a log in the thesis's form; a missing velocity column is left out.

    Not compressed: angles and velocities hardly shrink, and to inflate them takes longer than all
    else that is done with a log of a minute.
    """
    with replacing(path) as draft:
        savemat(draft, {_MATRIX: np.column_stack(list(log.columns().values()))})


def _parts(name: str | int) -> list[str]:
    """Split the name of a variable, field or column; a number alone is a column of ``D``."""
    parts = str(name).split(".")
    return [_MATRIX, *parts] if parts[0].isdecimal() else parts


def _matrix(path: Path) -> NDArray[np.float64]:
    variables, names = _load(path, {_MATRIX})
    if _MATRIX not in variables:
        _refuse_objects(path, _MATRIX, variables)
        found = f"no such variable (there are: {', '.join(names) or 'none'})"
        expected = "a matrix D with columns t, u, q[, dq], or --columns time=T,input=U,angle=Q"
        raise InputError(path, _MATRIX, found, expected)
    matrix = variables[_MATRIX]
    if not isinstance(matrix, np.ndarray) or matrix.ndim != 2 or matrix.shape[1] not in (3, 4):  # noqa: PLR2004 - t, u, q[, dq]
        found = matrix if isinstance(matrix, str) else type(matrix).__name__
        found = f"shape {matrix.shape}" if isinstance(matrix, np.ndarray) else found
        raise InputError(path, _MATRIX, found, "shape (n, 3) or (n, 4): t, u, q[, dq]")
    return _real(path, _MATRIX, matrix)


def _real(path: Path, name: str, values: NDArray[Any]) -> NDArray[np.float64]:
    """Return a copy, a column after the other: `values` may lie in the file itself."""
    if values.dtype.kind not in "fiu":
        raise InputError(path, name, f"type {values.dtype}", "real numbers")
    return np.array(values, dtype=np.float64, order="F")


def _vector(
    path: Path, variables: dict[str, Any], names: list[str], parts: list[str]
) -> NDArray[np.float64]:
    """Return a vector by the name of its variable and what follows."""
    wanted = ".".join(parts)
    if parts[0] not in variables:
        _refuse_objects(path, wanted, variables)
        raise InputError(path, wanted, "no such variable", _listing(parts[0], names))
    found: Any = variables[parts[0]]
    for k, part in enumerate(parts[1:], 1):
        width = found.shape[1] if isinstance(found, np.ndarray) and found.ndim == 2 else 0  # noqa: PLR2004 - a matrix
        if isinstance(found, dict) and part in found:
            found = found[part]
        elif part.isdecimal() and int(part) < width:
            found = found[:, int(part)]
        else:
            valid = [*found] if isinstance(found, dict) else [*map(str, range(width))]
            where = ".".join(parts[:k])
            raise InputError(path, wanted, f"no {part} in {where}", _listing(part, valid))
    if isinstance(found, MatlabObject):
        raise InputError(path, wanted, *_OBJECTS)
    if isinstance(found, dict):
        expected = f"one of its fields: {', '.join(f'{wanted}.{each}' for each in found)}"
        raise InputError(path, wanted, "a struct", expected)
    values = _real(path, wanted, np.asarray(found))
    if values.size != max(values.shape, default=0):
        expected = f"a vector, or one of its columns: {wanted}.0, ..."
        raise InputError(path, wanted, f"shape {values.shape}", expected)
    return values.ravel()


def _refuse_objects(path: Path, wanted: str, variables: dict[str, Any]) -> None:
    """Raise InputError if there are objects, which are what is likely to be meant."""
    if any(isinstance(each, MatlabObject) for each in variables.values()):
        raise InputError(path, wanted, *_OBJECTS)


def _listing(wanted: str, valid: list[str]) -> str:
    return (
        nearest(wanted, valid) if valid else "a file that holds it: there is nothing to name here"
    )


class MatlabObject:
    """Stands for an object of MATLAB's, which nobody else can read."""


_HEADER, _VERSION, _ORDER = 128, slice(124, 126), slice(126, 128)
_HDF5 = b"\x00\x02"


def _load(
    path: Path, wanted: Collection[str], said: dict[str, dict[str, str]] | None = None
) -> tuple[dict[str, Any], list[str]]:
    """Return variables, the wanted ones among them if they are there, and the names of all.

    What attributes say of units, which only version 7.3 has, is added to ``said``.
    """
    if not path.is_file():
        raise InputError(path, "path", "no such file", "an existing .mat file")
    try:
        with path.open("rb") as file:
            header = file.read(_HEADER)
            if header[_VERSION] == _HDF5:
                return _load73(path, wanted, {} if said is None else said)
            if len(header) < _HEADER or 0 in header[:4]:  # of level 4
                found = loadmat(path)
            else:
                found = _load5(memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)))
    except InputError:
        raise
    except Exception as error:  # readers meet corrupt bytes with whatever they lead to
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(path, "content", f"unreadable ({reason})", "a whole .mat file") from None
    return found, [name for name in found if not name.startswith("__")]


# Level 5 (MATLAB, MAT-File Format, 2019, chapter 1). SciPy's compiled reader takes the tags of a
# file at their word, and a wrong one can end the process: here each is checked.

_ARRAY, _COMPRESSED = 14, 15  # types of elements
_INT8, _INT32, _UINT32 = 1, 5, 6
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8"}
_NUMBERS |= {13: "u8"}
_NUMERIC, _STRUCT, _OPAQUE, _OBJECTS_OF = range(6, 16), 2, 17, {3, 16}  # classes
_OTHERS = {1: "a cell array", _STRUCT: "an array of structs", 4: "text", 5: "a sparse matrix"}
_COMPLEX = 0x0800
_DEEPEST = 32  # dimensions, and structs within structs

Bytes = memoryview


class _Elements:
    """Elements of a file or of an array, one after the other."""

    def __init__(self, data: Bytes, order: str) -> None:
        self.data, self.order = data, order

    def next(self, what: str, types: Container[int]) -> tuple[int, Bytes]:
        """Return type and data of the next one, which must be of some types."""
        if len(self.data) < 8:  # noqa: PLR2004 - bytes of a tag
            raise ValueError(f"{len(self.data)} bytes where a tag of 8 should be")
        kind, size = struct.unpack_from(f"{self.order}II", self.data)
        begin, room = 8, len(self.data) - 8
        if kind >> 16:  # a short one has its data within the tag
            kind, size, begin, room = kind & 0xFFFF, kind >> 16, 4, 4
        if size > room:
            raise ValueError(f"an element of {size} bytes of which {room} are there")
        if kind not in types:
            raise ValueError(f"{what} of type {kind}")
        found = self.data[begin : begin + size]
        padding = 0 if kind == _COMPRESSED else -(begin + size) % 8
        self.data = self.data[begin + size + padding :]
        return kind, found

    def numbers(self, what: str, kind: int) -> list[int]:
        """Return the whole numbers of the next one."""
        _, data = self.next(what, {kind})
        if len(data) % 4:
            raise ValueError(f"{what} of {len(data)} bytes")
        letter = "i" if kind == _INT32 else "I"
        return list(struct.unpack(f"{self.order}{len(data) // 4}{letter}", data))

    def text(self, what: str) -> str:
        """Return the text of the next one."""
        return bytes(self.next(what, {_INT8})[1]).decode("latin-1")


def _load5(data: Bytes) -> dict[str, Any]:
    """Return the variables of a file of level 5 by their names."""
    order = {b"IM": "<", b"MI": ">"}.get(bytes(data[_ORDER]))
    if order is None:
        raise ValueError("its header names no order of bytes")
    elements, found, most = _Elements(data[_HEADER:], order), {}, most_in(len(data))
    while elements.data:
        kind, variable = elements.next("a variable", {_ARRAY, _COMPRESSED})
        if kind == _COMPRESSED:
            unpacked = _inflated(variable, most)
            most -= len(unpacked)
            _, variable = _Elements(unpacked, order).next("a variable", {_ARRAY})
        name, value = _array(_Elements(variable, order), 0)
        found[name] = value
    found.pop("", None)  # what functions need
    return found


def _inflated(packed: Bytes, most: int) -> Bytes:
    engine = zlib.decompressobj()
    try:
        found = engine.decompress(packed, most + 1)
    except zlib.error as error:
        raise ValueError(f"packed data that cannot be unpacked ({error})") from None
    if len(found) > most:
        raise ValueError(f"packed data of more than {most:,} bytes")
    if not engine.eof:
        raise ValueError("packed data that end too soon")
    return memoryview(found)


def _array(elements: _Elements, depth: int) -> tuple[str, Any]:
    """Return the name and the value of an array: numbers, a struct, or in words what else."""
    if depth > _DEEPEST:
        raise ValueError(f"arrays within arrays, more than {_DEEPEST} deep")
    flags = elements.numbers("flags of an array", _UINT32)
    if len(flags) != 2:  # noqa: PLR2004 - flags and the size of a sparse one
        raise ValueError(f"{4 * len(flags)} bytes of flags")
    kind, parts = flags[0] & 0xFF, 2 if flags[0] & _COMPLEX else 1
    if kind == _OPAQUE:
        return elements.text("the name of an object"), MatlabObject()
    shape = elements.numbers("a shape", _INT32)
    if not 2 <= len(shape) <= _DEEPEST or min(shape) < 0:  # noqa: PLR2004 - rows and columns
        raise ValueError(f"a shape of {len(shape)} numbers, {min(shape, default=0)} the least")
    name = elements.text("a name")
    if kind in _NUMERIC:
        values = [_numbers(elements, shape) for _ in range(parts)]
        return name, values[0] if parts == 1 else values[0] + 1j * values[1]
    if kind in _OBJECTS_OF:
        return name, MatlabObject()
    if kind == _STRUCT and math.prod(shape) == 1:
        return name, {field: _within(elements, depth) for field in _fields(elements)}
    if kind not in _OTHERS:
        raise ValueError(f"an array of class {kind}")
    return name, _OTHERS[kind]


def _numbers(elements: _Elements, shape: list[int]) -> NDArray[Any]:
    kind, data = elements.next("numbers", _NUMBERS)
    form, count = np.dtype(f"{elements.order}{_NUMBERS[kind]}"), math.prod(shape)
    if len(data) != count * form.itemsize:
        raise ValueError(f"{len(data)} bytes of numbers where {count} should be")
    return np.frombuffer(data, form).reshape(shape, order="F")


def _fields(elements: _Elements) -> list[str]:
    """Return the names of a struct's fields, each of the same length, filled up with zeros."""
    lengths = elements.numbers("the length of names", _INT32)
    names = elements.text("names of fields")
    length = lengths[0] if len(lengths) == 1 else 0
    if length <= 0 or len(names) % length:
        raise ValueError(f"{len(names)} bytes of names of {length} each")
    starts = range(0, len(names), length)
    return [names[start : start + length].partition("\0")[0] for start in starts]


def _within(elements: _Elements, depth: int) -> Any:  # noqa: ANN401 - whatever the file holds
    _, data = elements.next("an array within", {_ARRAY})
    if not data:  # one without any bytes is empty
        return np.empty((0, 0))
    return _array(_Elements(data, elements.order), depth + 1)[1]


# Version 7.3 is HDF5.

_UNIT_KEYS = {"unit", "units", "Unit", "Units"}  # attributes
_OWN = "#"  # begins what MATLAB keeps for itself
_PLAIN = {"double", "single", "logical", "char", "struct"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
_OF_NODE = 1 << 14  # bytes that count for a node besides its own: of nodes in a ring is no end


def _load73(
    path: Path, wanted: Collection[str], said: dict[str, dict[str, str]]
) -> tuple[dict[str, Any], list[str]]:
    try:
        import h5py  # noqa: PLC0415 - an extra
    except ImportError:
        expected = "h5py (pip install 'butterfly-testbed[hdf5]'), or a file saved with '-v7'"
        raise InputError(path, "content", "MATLAB v7.3 (HDF5)", expected) from None
    left = most_in(path.stat().st_size)

    def value(node: Any) -> Any:  # noqa: ANN401 - whatever the file holds
        """Return a variable as MATLAB has it: HDF5 keeps its dimensions the other way round."""
        nonlocal left
        for key in _UNIT_KEYS & node.attrs.keys():
            text = node.attrs[key]
            text = text.decode() if isinstance(text, bytes) else str(text)
            said.setdefault(node.name.strip("/").replace("/", "."), {})[f"attribute {key}"] = text
        kind = node.attrs.get("MATLAB_class", b"")
        if "MATLAB_object_decode" in node.attrs or (kind and kind.decode() not in _PLAIN):
            return MatlabObject()
        size = _OF_NODE + getattr(node, "nbytes", 0)
        left -= size
        if size < 0 or left < 0:  # a file may claim any size
            raise ValueError(f"arrays of {size_text(size)} more than there may be")
        if hasattr(node, "items"):
            return {key: value(below) for key, below in node.items()}
        values = np.asarray(node[()])
        return np.asarray("".join(map(chr, values.ravel()))) if kind == b"char" else values.T

    with h5py.File(path, "r") as file:
        found = {name: value(file[name]) for name in wanted if name in file}
        return found, [str(name) for name in file if not name.startswith(_OWN)]
