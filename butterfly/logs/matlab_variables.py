"""Variables in MATLAB files of every level: 4, 5, 7.3 (which is HDF5); tables as structs."""

from __future__ import annotations

import math
import re
import struct
import warnings
import zlib
from collections.abc import Collection, Container, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError, size_text
from butterfly.files import most_in, require_file, whole

_SIGNAL = "t = {x}Time; u = squeeze({x}Data); save('log.mat', 't', 'u')"
_CONVERSIONS = {
    "table": "writetable(x, 'log.csv')",
    "timetable": "T = timetable2table(x); T.(1) = seconds(T.(1)); writetable(T, 'log.csv')",
    "Simulink.SimulationData.Dataset": _SIGNAL.format(x="x{1}.Values."),
    "Simulink.SimulationOutput": _SIGNAL.format(x="x.logsout{1}.Values."),
    "Simulink.SimulationData.Signal": _SIGNAL.format(x="x.Values."),
}  # lines of MATLAB that convert an object x; all others are converted as timeseries
_EXTRA = "needs the extra matlab (pip install 'butterfly-testbed[matlab]')"


@dataclass(frozen=True)
class MatlabObject:
    """An object that was not read."""

    kind: str = ""

    def refused(self, path: Path, wanted: str, name: str = "x") -> InputError:
        """Return the error, with a line of MATLAB that converts the object."""
        line = re.sub(r"\bx\b", name, _CONVERSIONS.get(self.kind, _SIGNAL.format(x="x.")))
        kind = f" ({self.kind})" if self.kind else ""
        why = "mat-io does not read" if find_spec("matio") else _EXTRA
        value = f"a MATLAB object{kind}, which {why}"
        return InputError(path, wanted, value, f"plain vectors or a table; in MATLAB: {line}")


def is_skipped(value: Any) -> bool:  # noqa: ANN401 - whatever a file holds
    """Whether anything but objects of known classes was left out; such data may be damaged."""
    unread = [leaf for leaf in _leaves(value) if isinstance(leaf, str | MatlabObject)]
    return not all(isinstance(leaf, MatlabObject) and leaf.kind for leaf in unread)


def _leaves(value: Any) -> list[Any]:  # noqa: ANN401 - whatever a file holds
    below = [*value.values()] if isinstance(value, dict) else value
    return (
        [leaf for part in below for leaf in _leaves(part)] if isinstance(below, list) else [value]
    )


def opened(path: Path, variables: Mapping[str, Any], wanted: Collection[str]) -> dict[str, Any]:
    """Return the wanted variables that hold objects, with these as structs, unless it fails."""
    # only of whole parts, which mat-io takes for granted
    known = [name for name in wanted if name in variables and not is_skipped(variables[name])]
    leaves = {name: _leaves(variables[name]) for name in known}
    names = [n for n in known if any(isinstance(leaf, MatlabObject) for leaf in leaves[n])]
    with warnings.catch_warnings(), suppress(Exception):  # an object that is not read is refused
        warnings.simplefilter("ignore")
        if names:
            from matio import load_from_mat  # noqa: PLC0415 - an extra

            objects = load_from_mat(str(path), variable_names=[*names], add_table_attrs=True)
            return {name: _filled(variables[name], objects[name]) for name in names}
    return {}


def _filled(before: Any, after: Any) -> Any:  # noqa: ANN401 - whatever a file holds
    """Return what was read, its objects as mat-io reads them."""
    if isinstance(before, dict):
        (one,) = np.ravel(after)
        return {name: _filled(part, one[name]) for name, part in before.items()}
    if isinstance(before, list):
        return [_filled(*pair) for pair in zip(before, np.ravel(after, "F"), strict=True)]
    value = _plain(after) if isinstance(before, MatlabObject) else before
    is_clock = isinstance(value, np.ndarray) and value.dtype.kind in "mM"
    return value if is_clock or not isinstance(value, np.ndarray) else before


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever a file holds
    """Return an object as a struct, if it is of a known kind."""
    if hasattr(value, "attrs"):
        return _frame(value)
    if not isinstance(getattr(value, "properties", None), dict):
        return value
    properties = {name.rstrip("_"): _plain(part) for name, part in value.properties.items()}
    known = (
        _series(properties) if value.classname == "timeseries" else MatlabObject(value.classname)
    )
    return properties if value.classname.startswith("tsdata.") else known


def _series(properties: dict[str, Any]) -> dict[str, Any]:
    """Return the columns of a timeseries, whose times may be a start and an increment."""
    about = properties["TimeInfo"]
    time = np.ravel(properties.get("Time", about.get("Time", ())))
    if not time.size:
        start, step, count = (np.ravel(about[key])[0] for key in ("Start", "Increment", "Length"))
        time = start + step * np.arange(min(int(count), np.size(properties["Data"])))
    units = {"Time": about.get("Units"), "Data": properties.get("DataInfo", {}).get("Units")}
    return {"Time": time, "Data": np.squeeze(properties["Data"]), "Properties": {"units": units}}


def _frame(frame: Any) -> dict[str, Any]:  # noqa: ANN401 - pandas'
    """Return the columns of a table, or of a timetable with its row times first."""
    units, texts = (
        frame.attrs.get(f"Variable{key}") or frame.attrs.get(f"var{key}") or [""] * frame.shape[1]
        for key in ("Units", "Descriptions")
    )
    headings = [
        {"name": name, "unit": "" if column.dtype.kind in "mM" else unit, "description": text}
        for (name, column), unit, text in zip(frame.items(), units, texts, strict=True)
    ]
    frame = frame if frame.index.name is None else frame.reset_index()
    columns = {str(name): column.to_numpy() for name, column in frame.items()}
    return columns | {"Properties": {"columns": headings}}


_HEADER, _SYSTEM, _VERSION, _ORDER = 128, slice(116, 124), slice(124, 126), slice(126, 128)
_HDF5 = b"\x00\x02"


def load_variables(
    path: Path, wanted: Collection[str], attributes: dict[str, Mapping[str, Any]] | None = None
) -> tuple[dict[str, Any], list[str]]:
    """Return variables, including the wanted ones if present, and the names of all.

    The attributes of variables, which only version 7.3 has, are added to ``attributes``. Variables
    named like units are always wanted. Objects in wanted ones are structs, if mat-io reads them.
    """
    require_file(path, "an existing .mat file")
    with whole(path, "a whole .mat file"), path.open("rb") as file:
        header = file.read(_HEADER)
        if header[_VERSION] == _HDF5:
            variables, names = _load73(path, wanted, {} if attributes is None else attributes)
            openable = True
        else:
            data = memoryview(header + file.read())  # mapped, a truncation now would crash us
            variables = _load4(data) if 0 in header[:4] else _load5(data)
            openable = not is_skipped(variables.pop("", MatlabObject()))
            names = [*variables]
    return variables | (opened(path, variables, wanted) if openable else {}), names


# Level 4 (MATLAB, MAT-File Format, 2019, chapter 1, appendix): arrays one after the other, each
# after five numbers.

_OF_4 = ("f8", "f4", "i4", "i2", "u2", "u1")
_OTHERS_OF_4 = {2: "a sparse matrix"}
_MACHINES = "numbers in VAX or Cray format, not IEEE floats"


def _load4(data: Bytes) -> dict[str, Any]:
    """Return the variables of a file of level 4 by their names."""
    variables: dict[str, Any] = {}
    while data:
        if len(data) < 20:  # noqa: PLR2004 - bytes of five numbers
            raise ValueError(f"{len(data)} bytes instead of five numbers")
        order = "<" if struct.unpack_from("<I", data)[0] < 10_000 else ">"  # noqa: PLR2004
        kind, rows, columns, imaginary, length = struct.unpack_from(f"{order}5I", data)
        machine, rest = divmod(kind, 1000)
        form, text = divmod(rest, 10)
        if machine in {2, 3, 4}:
            raise ValueError(_MACHINES)
        if machine != (order == ">") or form >= len(_OF_4):
            raise ValueError(f"an array of type {kind}")
        numbers = np.dtype(f"{order}{_OF_4[form]}")
        begin, count = 20 + length, rows * columns * (2 if imaginary else 1)
        end = begin + count * numbers.itemsize
        if end > len(data):
            raise ValueError(f"an array of {end} bytes, {len(data)} present")
        name = bytes(data[20:begin]).partition(b"\0")[0].decode("latin-1")
        parts = np.frombuffer(data[begin:end], numbers).reshape((-1, columns, rows))
        values = parts[0].T if not imaginary else parts[0].T + 1j * parts[1].T
        if text == 1:
            lines = ["".join(chr(int(code) % 0x110000) for code in line) for line in values]
            values, text = _texts(lines or [""]), 0
        variables[name] = (
            values if text == 0 else _OTHERS_OF_4.get(text, f"an array of type {kind}")
        )
        data = data[end:]
    return variables


# Level 5 (the same, chapter 1). SciPy's compiled reader takes the tags of a
# file at their word, and a wrong one can end the process: here each is checked.

_ARRAY, _COMPRESSED = 14, 15  # types of elements
_INT8, _INT32, _UINT32 = 1, 5, 6
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8"}
_NUMBERS |= {13: "u8"}
_NUMERIC, _STRUCT, _OPAQUE, _OBJECTS_OF = range(6, 16), 2, 17, {3, 16}  # classes
_OTHERS, _CELL, _TEXT = {5: "a sparse matrix"}, 1, 4
_TEXTS = {1: "utf-8", 2: "utf-8", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_COMPLEX = 0x0800
_LONGEST_EMPTY = 1 << 20
_DEEPEST = 32  # dimensions, and structs within structs

Bytes = memoryview


class _Elements:
    """The elements of a file or an array, in sequence."""

    def __init__(self, data: Bytes, order: str) -> None:
        self.data, self.order = data, order

    def next(self, what: str, types: Container[int]) -> tuple[int, Bytes]:
        """Return type and data of the next element, of one of the given types."""
        if len(self.data) < 8:  # noqa: PLR2004 - bytes of a tag
            raise ValueError(f"{len(self.data)} bytes instead of a tag of 8")
        kind, size = struct.unpack_from(f"{self.order}II", self.data)
        begin, room = 8, len(self.data) - 8
        if kind >> 16:  # a small element has its data in the tag
            kind, size, begin, room = kind & 0xFFFF, kind >> 16, 4, 4
        if size > room:
            raise ValueError(f"an element of {size} bytes, {room} present")
        if kind not in types:
            raise ValueError(f"{what} of type {kind}")
        content = self.data[begin : begin + size]
        padding = 0 if kind == _COMPRESSED else -(begin + size) % 8
        self.data = self.data[begin + size + padding :]
        return kind, content

    def numbers(self, what: str, kind: int) -> list[int]:
        """Return the integers of the next element."""
        _, data = self.next(what, {kind})
        if len(data) % 4:
            raise ValueError(f"{what} of {len(data)} bytes")
        letter = "i" if kind == _INT32 else "I"
        return list(struct.unpack(f"{self.order}{len(data) // 4}{letter}", data))

    def text(self, what: str) -> str:
        """Return the text of the next element."""
        return bytes(self.next(what, {_INT8})[1]).decode("latin-1")


def _load5(data: Bytes) -> dict[str, Any]:
    """Return the variables of a file of level 5 by their names, the values of objects without."""
    order = {b"IM": "<", b"MI": ">"}.get(bytes(data[_ORDER]))
    if order is None:
        raise ValueError("no byte order in its header")
    elements, variables, most = _Elements(data[_HEADER:], order), {}, most_in(len(data))
    system: Any = None  # what objects and functions need, where the header says
    while elements.data:
        at = struct.pack(f"{order}q", len(data) - len(elements.data))
        kind, variable = elements.next("a variable", {_ARRAY, _COMPRESSED})
        if kind == _COMPRESSED:
            unpacked = _inflated(variable, most)
            most -= len(unpacked)
            _, variable = _Elements(unpacked, order).next("a variable", {_ARRAY})
        name, value = _array(_Elements(variable, order), 0)
        variables[name] = value
        system = value if at == data[_SYSTEM] and not name else system
    variables.pop("", None)
    with suppress(ValueError):
        content = memoryview(np.asarray(system).tobytes())
        if content[2:4] == data[_ORDER]:
            _, values = _Elements(content[8:], order).next("values of objects", {_ARRAY})
            variables[""] = _array(_Elements(values, order), 0)[1]
    return variables


def _inflated(packed: Bytes, most: int) -> Bytes:
    engine = zlib.decompressobj()
    try:
        content = engine.decompress(packed, most + 1)
    except zlib.error as error:
        raise ValueError(f"damaged compressed data ({error})") from None
    if len(content) > most:
        raise ValueError(f"compressed data that expand to more than {most:,} bytes")
    if not engine.eof:
        raise ValueError("truncated compressed data")
    return memoryview(content)


def _array(elements: _Elements, depth: int) -> tuple[str, Any]:
    """Return the name and value of an array: numbers, a struct, or a description of others."""
    if depth > _DEEPEST:
        raise ValueError(f"arrays nested more than {_DEEPEST} deep")
    flags = elements.numbers("flags of an array", _UINT32)
    if len(flags) != 2:  # noqa: PLR2004 - flags and the size of a sparse one
        raise ValueError(f"{4 * len(flags)} bytes of flags")
    kind, parts = flags[0] & 0xFF, 2 if flags[0] & _COMPLEX else 1
    if kind == _OPAQUE:
        name = elements.text("the name of an object")
        elements.text("the system of an object")
        named = elements.text("the class of an object")
        return name, MatlabObject("" if is_skipped(_within(elements, depth)) else named)
    shape = elements.numbers("a shape", _INT32)
    if not 2 <= len(shape) <= _DEEPEST or min(shape) < 0:  # noqa: PLR2004 - rows and columns
        raise ValueError(f"a shape of {len(shape)} numbers, the smallest {min(shape, default=0)}")
    if 0 in shape and max(shape) > _LONGEST_EMPTY:  # over which mat-io counts
        raise ValueError(f"an empty array of shape {shape}")
    name = elements.text("a name")
    if kind in _NUMERIC:
        values = [_numbers(elements, shape) for _ in range(parts)]
        return name, values[0] if parts == 1 else values[0] + 1j * values[1]
    if kind in _OBJECTS_OF:
        return name, MatlabObject()
    if kind == _STRUCT:
        fields, count = _fields(elements), math.prod(shape)
        if count > 1 + len(elements.data):
            raise ValueError(f"{count} structs in {len(elements.data)} bytes")
        structs = [{field: _within(elements, depth) for field in fields} for _ in range(count)]
        return name, structs[0] if count == 1 else structs
    return name, _other(elements, kind, shape, depth)


def _other(elements: _Elements, kind: int, shape: list[int], depth: int) -> Any:  # noqa: ANN401 - whatever the file holds
    """Return a text or several, the list of a cell array, or a description of another array."""
    count = math.prod(shape)
    if kind == _TEXT:
        form, text = elements.next("a text", _TEXTS)
        order = "" if _TEXTS[form] == "utf-8" else "-le" if elements.order == "<" else "-be"
        letters = bytes(text).decode(_TEXTS[form] + order, "replace")
        rows = shape[0] if len(letters) == count else 1
        return _texts([letters[k::rows] for k in range(rows)] or [""])
    if kind == _CELL and count > 1 + len(elements.data):
        raise ValueError(f"{count} cells in {len(elements.data)} bytes")
    if kind == _CELL:
        return [_within(elements, depth) for _ in range(count)]
    if kind not in _OTHERS:
        raise ValueError(f"an array of class {kind}")
    return _OTHERS[kind]


def _numbers(elements: _Elements, shape: list[int]) -> NDArray[Any]:
    kind, data = elements.next("numbers", _NUMBERS)
    form, count = np.dtype(f"{elements.order}{_NUMBERS[kind]}"), math.prod(shape)
    if len(data) != count * form.itemsize:
        raise ValueError(f"{len(data)} bytes of data for {count} numbers")
    return np.frombuffer(data, form).reshape(shape, order="F")


def _texts(rows: list[str]) -> Any:  # noqa: ANN401 - whatever the file holds
    """Return an array of characters as a text, or as the texts in its rows."""
    return np.asarray(rows[0]) if len(rows) == 1 else np.asarray([row.rstrip() for row in rows])


def _fields(elements: _Elements) -> list[str]:
    """Return the field names of a struct, stored zero-padded at one length."""
    lengths = elements.numbers("the length of field names", _INT32)
    names = elements.text("field names")
    length = lengths[0] if len(lengths) == 1 else 0
    if length <= 0 or len(names) % length:
        raise ValueError(f"{len(names)} bytes of field names of {length} bytes each")
    starts = range(0, len(names), length)
    return [names[start : start + length].partition("\0")[0] for start in starts]


def _within(elements: _Elements, depth: int) -> Any:  # noqa: ANN401 - whatever the file holds
    _, data = elements.next("a nested array", {_ARRAY})
    if not data:  # one without any bytes is empty
        return np.empty((0, 0))
    return _array(_Elements(data, elements.order), depth + 1)[1]


# Version 7.3 is HDF5.

_OWN = "#"  # begins what MATLAB keeps for itself
_PLAIN = {"double", "single", "logical", "char", "cell", "struct"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
_OF_ROW = 1 << 7  # bytes of a row that is a list, besides its numbers
_LONGEST_TEXT = 10_000  # characters
_OF_NODE = 1 << 14  # bytes that count for a node besides its own: of nodes in a ring is no end


def _load73(
    path: Path, wanted: Collection[str], attributes: dict[str, Mapping[str, Any]]
) -> tuple[dict[str, Any], list[str]]:
    try:
        import h5py  # noqa: PLC0415 - an extra
    except ImportError:
        expected = "h5py (pip install 'butterfly-testbed[hdf5]'), or a file saved with '-v7'"
        raise InputError(path, "content", "MATLAB v7.3 (HDF5)", expected) from None
    room = most_in(path.stat().st_size)

    def value(node: Any) -> Any:  # noqa: ANN401 - whatever the file holds
        """Return a variable with MATLAB's order of dimensions, which HDF5 reverses."""
        nonlocal room
        attributes[node.name.strip("/").replace("/", ".")] = dict(node.attrs)
        kind = node.attrs.get("MATLAB_class", b"")
        is_object = "MATLAB_object_decode" in node.attrs or kind.decode() not in {*_PLAIN, ""}
        sizes = [_OF_NODE + getattr(node, "nbytes", 0)]
        if is_object:  # its values may be anywhere
            file.visititems(lambda _, part: sizes.append(getattr(part, "nbytes", 0)))
        room -= sum(sizes)
        if min(sizes) < 0 or room < 0:  # a file may claim any size
            raise ValueError(f"an array of {size_text(sum(sizes))}, more than the file can hold")
        if is_object:
            return MatlabObject(kind.decode())
        if hasattr(node, "items"):
            fields = {key: value(_own_node(path, node, key)) for key in node}
            lists = [field for field in fields.values() if isinstance(field, list)]
            if not lists or len(lists) < len(fields):
                return fields
            return [dict(zip(fields, row, strict=True)) for row in zip(*lists, strict=True)]
        _require_written(path, node)
        values = _stored(node, room)
        if h5py.check_ref_dtype(values.dtype) and kind in {b"", b"cell"}:  # or a field of structs
            return [value(file[reference]) for reference in values.ravel(order="F")]
        return _texts_of(values) if kind == b"char" else values.T

    with h5py.File(path, "r") as file:
        names, attributes[""] = list(file), dict(file.attrs)
        chosen = [name for name in names if name in wanted or _is_of_texts(file, name)]
        variables = {name: value(_own_node(path, file, name)) for name in chosen}
        return variables, [name for name in names if not name.startswith(_OWN)]


def _stored(node: Any, most: int) -> NDArray[Any]:  # noqa: ANN401 - h5py's
    """Return the values of a node; its lists may take at most ``most`` bytes."""
    import h5py  # noqa: PLC0415 - an extra

    if h5py.check_string_dtype(node.dtype):
        return np.asarray(node.asstr(errors="replace")[()])
    if not h5py.check_vlen_dtype(node.dtype):
        return np.asarray(node[()])
    rows = np.empty(node.shape, dtype=object)
    for place in np.ndindex(node.shape):
        rows[place] = node[place]
        most -= _OF_ROW + rows[place].nbytes
        if most < 0:  # many lists may be one place of the file
            raise ValueError("lists of more numbers than the file can hold")
    return rows


def _texts_of(codes: NDArray[Any]) -> Any:  # noqa: ANN401 - as of `_texts`
    lines = codes.T if codes.ndim == 2 else codes[None]  # noqa: PLR2004 - rows
    return _texts(["".join(map(chr, line.ravel())) for line in lines] or [""])


def _is_of_texts(parent: Any, name: str) -> bool:  # noqa: ANN401 - h5py's
    """Whether a variable may say something about others: units, or a few texts."""
    if type(parent.get(name, getlink=True)).__name__ != "HardLink":
        return False
    kind, size = parent[name].attrs.get("MATLAB_class", b""), getattr(parent[name], "size", 0)
    return "unit" in name.lower() or (kind in {b"char", b"cell"} and size <= _LONGEST_TEXT)


def _own_node(path: Path, parent: Any, name: str) -> Any:  # noqa: ANN401 - h5py's
    """Return a node stored in the file itself; MATLAB writes no links."""
    if type(parent.get(name, getlink=True)).__name__ != "HardLink":
        raise InputError(path, name, "a link", "all numbers written in this file")
    return parent[name]


def _require_written(path: Path, data: Any) -> None:  # noqa: ANN401 - h5py's
    """Refuse numbers in other files, and those never written, which HDF5 reads as zeros."""
    if data.external or data.is_virtual:
        problem = "numbers stored in another file"
    elif data.chunks:
        counts = [-(-n // chunk) for n, chunk in zip(data.shape, data.chunks, strict=True)]
        written = data.id.get_num_chunks()
        problem = f"{written} of {math.prod(counts)} chunks" if written < math.prod(counts) else ""
    else:
        problem = "numbers never written" if data.nbytes and not data.id.get_storage_size() else ""
    if problem:
        raise InputError(path, data.name.strip("/"), problem, "all numbers written in this file")
