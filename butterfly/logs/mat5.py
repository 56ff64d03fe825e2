"""Whether a .mat file of level 5 is whole, before SciPy's compiled reader sees it.

That reader takes the tags of a file at their word, and a wrong one can end the process. So every
tag is checked first: its type, and that what it promises is there and fits the array it is part of
(MATLAB, MAT-File Format, 2019, chapter 1). What was packed is unpacked on the way, and but once.
"""

from __future__ import annotations

import io
import math
import mmap
import struct
import zlib
from collections.abc import Container, Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from butterfly.files import most_in

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_BYTES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}  # of a number, by its type
_INT8, _INT32, _UINT32 = 1, 5, 6
_TEXT = {*_BYTES, 16, 17, 18}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_NUMERIC = range(6, 16)  # classes
_COMPLEX = 0x0800
_DEEPEST = 32  # arrays within arrays
_AT_A_TIME = 1 << 20  # bytes that are unpacked

Bytes = memoryview


class DamagedError(ValueError):
    """A tag that cannot be."""


def whole(path: Path) -> Path | io.BytesIO:
    """Return what may be read of a file: itself, or all of it, unpacked.

    Files of level 4 are returned as they are. Raises `DamagedError`.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(_HEADER)
        if len(header) < _HEADER or 0 in header[:4]:
            return path
        order = {b"IM": "<", b"MI": ">"}.get(header[126:])
        if order is None:
            raise DamagedError("its header names no order of bytes")
        if size == _HEADER:
            return path
        data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        return _checked(data, order) or path


def _checked(data: Bytes, order: str) -> io.BytesIO | None:
    """Check all variables; return the file unpacked if any was packed."""
    elements = list(_elements(data, order))
    if all(kind != _COMPRESSED for kind, _ in elements):
        for _, element in elements:
            _check_variable(element, order)
        return None
    unpacked, ends = _unpacked(data, elements)
    with unpacked.getbuffer() as content:
        for begin, end in pairwise(ends):
            _check_variable(content[begin:end], order)
    return unpacked


def _elements(data: Bytes, order: str) -> Iterator[tuple[int, Bytes]]:
    """Yield the types of a file's elements, and their bytes, tags included."""
    begin = _HEADER
    while begin < len(data):
        tag = _tag(data[begin:], order)
        yield tag.type, data[begin : begin + 8 + tag.size]
        begin += 8 + tag.size


def _unpacked(data: Bytes, elements: Iterable[tuple[int, Bytes]]) -> tuple[io.BytesIO, list[int]]:
    """Return a file with its variables unpacked, and where each ends; the header does first."""
    most = most_in(len(data))
    found = io.BytesIO()
    ends = [found.write(data[:_HEADER])]
    for kind, element in elements:
        for part in _inflated(element[8:]) if kind == _COMPRESSED else (element,):
            found.write(part)
            if found.tell() > most:
                raise DamagedError(f"packed data of more than {most:,} bytes")
        ends.append(found.tell())
    found.seek(0)
    return found, ends


def _check_variable(variable: Bytes, order: str) -> None:
    tag = _tag(variable, order)
    if tag.type != _MATRIX or 8 + tag.size != len(variable):
        raise DamagedError(f"a variable of type {tag.type} and {tag.size} bytes")
    _check_array(variable[8:], order, 0)


class _Tag(NamedTuple):
    """Type and size in bytes of an element, where its data begin, and where it ends."""

    type: int
    size: int
    begin: int
    end: int


def _tag(data: Bytes, order: str) -> _Tag:
    """Read the tag with which some bytes begin; a short one has its data within."""
    if len(data) < 8:  # noqa: PLR2004 - bytes of a tag
        raise DamagedError(f"{len(data)} bytes where a tag of 8 should be")
    kind, size = struct.unpack_from(f"{order}II", data)
    if kind >> 16:
        kind, size = kind & 0xFFFF, kind >> 16
        if size > 4:  # noqa: PLR2004 - bytes that a short one has
            raise DamagedError(f"a short element of {size} bytes")
        return _Tag(kind, size, 4, 8)
    if 8 + size > len(data):
        raise DamagedError(f"an element of {size} bytes of which {len(data) - 8} are there")
    return _Tag(kind, size, 8, min(8 + (size + 7) // 8 * 8, len(data)))


def _inflated(packed: Bytes) -> Iterator[bytes]:
    """Yield what was packed, in parts."""
    engine = zlib.decompressobj()
    for begin in range(0, len(packed), _AT_A_TIME):
        left: bytes | Bytes = packed[begin : begin + _AT_A_TIME]
        while left and not engine.eof:
            try:
                yield engine.decompress(left, _AT_A_TIME)
            except zlib.error as error:
                raise DamagedError(f"packed data that cannot be unpacked ({error})") from None
            left = engine.unconsumed_tail
    yield engine.flush()
    if not engine.eof:
        raise DamagedError("packed data that end too soon")


class _Elements:
    """The elements of an array, one after the other."""

    def __init__(self, data: Bytes, order: str) -> None:
        self._data, self.order = data, order

    def next(self, what: str, types: Container[int]) -> tuple[int, Bytes]:
        """Return type and data of the next one, which must be of some types."""
        tag = _tag(self._data, self.order)
        if tag.type not in types:
            raise DamagedError(f"{what} of type {tag.type}")
        found = self._data[tag.begin : tag.begin + tag.size]
        self._data = self._data[tag.end :]
        return tag.type, found

    def numbers(self, what: str, kind: int) -> list[int]:
        """Return the whole numbers of the next one."""
        _, data = self.next(what, {kind})
        if len(data) % 4:
            raise DamagedError(f"{what} of {len(data)} bytes")
        letter = "i" if kind == _INT32 else "I"
        return list(struct.unpack(f"{self.order}{len(data) // 4}{letter}", data))


def _check_array(data: Bytes, order: str, depth: int) -> None:
    """Check an array, and those within."""
    if depth > _DEEPEST:
        raise DamagedError(f"arrays within arrays, more than {_DEEPEST} deep")
    elements = _Elements(data, order)
    flags = elements.numbers("flags of an array", _UINT32)
    if len(flags) != 2:  # noqa: PLR2004 - flags and the size of a sparse one
        raise DamagedError(f"{4 * len(flags)} bytes of flags")
    kind, parts = flags[0] & 0xFF, 2 if flags[0] & _COMPLEX else 1
    if kind == _OPAQUE:
        for _ in range(3):
            elements.next("a name in an object", {_INT8})
        _check_arrays(elements, 1, depth)
        return
    shape = elements.numbers("a shape", _INT32)
    if not 2 <= len(shape) <= _DEEPEST or min(shape) < 0:  # noqa: PLR2004 - rows and columns
        raise DamagedError(f"a shape of {len(shape)} numbers, {min(shape, default=0)} the least")
    elements.next("a name", {_INT8})
    if kind in _NUMERIC:
        _check_numbers(elements, parts, math.prod(shape), exactly=True)
    elif kind == _CHAR:
        elements.next("text", _TEXT)
    elif kind == _SPARSE:
        _check_sparse(elements, parts, shape)
    else:
        count = _arrays_within(elements, kind, math.prod(shape))
        if 8 * count > len(data):
            raise DamagedError(f"{count} arrays within {len(data)} bytes")
        _check_arrays(elements, count, depth)


def _check_arrays(elements: _Elements, count: int, depth: int) -> None:
    for _ in range(count):
        _, data = elements.next("an array within", {_MATRIX})
        if len(data):  # one without any bytes is empty
            _check_array(data, elements.order, depth + 1)


def _check_numbers(elements: _Elements, parts: int, count: int, *, exactly: bool) -> None:
    """Check real and imaginary parts of numbers."""
    for _ in range(parts):
        kind, data = elements.next("numbers", _BYTES)
        needed = count * _BYTES[kind]
        if len(data) < needed or (exactly and len(data) > needed):
            raise DamagedError(f"{len(data)} bytes of numbers where {count} should be")


def _check_sparse(elements: _Elements, parts: int, shape: list[int]) -> None:
    """Check that rows and columns are some that there are."""
    rows = elements.numbers("rows", _INT32)
    ends = elements.numbers("ends of columns", _INT32)
    if len(ends) != shape[1] + 1 or ends[0] or any(a > b for a, b in pairwise(ends)):
        raise DamagedError("columns of a sparse array that cannot be")
    used = rows[: ends[-1]]
    if len(used) < ends[-1] or any(not 0 <= row < shape[0] for row in used):
        raise DamagedError("rows of a sparse array that cannot be")
    _check_numbers(elements, parts, len(used), exactly=False)


def _arrays_within(elements: _Elements, kind: int, count: int) -> int:
    """Return how many arrays follow in a cell, a structure, an object or a function."""
    if kind == _FUNCTION:
        return 1
    if kind == _CELL:
        return count
    if kind not in {_STRUCT, _OBJECT}:
        raise DamagedError(f"an array of class {kind}")
    if kind == _OBJECT:
        elements.next("the name of a class", {_INT8})
    lengths = elements.numbers("the length of names", _INT32)
    _, names = elements.next("names of fields", {_INT8})
    length = lengths[0] if len(lengths) == 1 else 0
    if length <= 0 or len(names) % length:
        raise DamagedError(f"{len(names)} bytes of names of {length} each")
    return count * (len(names) // length)
