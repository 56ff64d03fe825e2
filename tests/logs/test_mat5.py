"""Damaged .mat files end in one typed line, and never in SciPy's compiled reader."""

import io
import struct
import zlib
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.sparse import csc_matrix

from butterfly.errors import InputError
from butterfly.logs.mat import read_mat
from butterfly.logs.mat5 import DamagedError, whole
from tests.fuzz.files import CONTENTS, mat_escapes

HOSTILE = Path(__file__).parents[1] / "data/hostile"
SOUND = {
    **CONTENTS,
    "text": {"s": "hello", "b": np.array([True, False])},
    "sparse": {"D": csc_matrix(np.eye(3))},
    "empty": {"D": np.zeros((0, 4)), "c": np.array([], dtype=object)},
}


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("name", SOUND)
def test_what_is_whole_is_read_as_scipy_reads_it(name, packed, tmp_path):
    path = tmp_path / "sound.mat"
    savemat(path, SOUND[name], do_compression=packed)
    checked = whole(path)
    assert isinstance(checked, io.BytesIO) is packed
    expected, found = loadmat(path), loadmat(checked)
    assert expected.keys() == found.keys()
    for key in SOUND[name]:
        assert repr(found[key]) == repr(expected[key])


def test_files_of_the_other_order_of_bytes_are_read(tmp_path):
    matrix = np.arange(12.0).reshape(4, 3)
    data = matrix.T.astype(">f8").tobytes()
    body = struct.pack(">IIII", 6, 8, 6, 0) + struct.pack(">IIii", 5, 8, 4, 3)
    body += struct.pack(">HHc3x", 1, 1, b"D") + struct.pack(">II", 9, len(data)) + data
    path = tmp_path / "big.mat"
    header = b"MATLAB 5.0".ljust(124) + struct.pack(">H", 0x0100) + b"MI"
    path.write_bytes(header + struct.pack(">II", 14, len(body)) + body)
    np.testing.assert_array_equal(loadmat(whole(path))["D"], matrix)


def test_a_flipped_bit_that_ended_the_process_is_refused():
    with pytest.raises(InputError, match=r"unreadable \(numbers of type 8\).*a whole .mat file"):
        read_mat(HOSTILE / "segfault_one_bit.mat")


def test_packed_data_are_not_unpacked_without_end(tmp_path, monkeypatch):
    monkeypatch.setattr("butterfly.files._FREE", 1 << 20)
    packed = zlib.compress(bytes(1 << 22))
    with pytest.raises(DamagedError, match="more than 1,048,576 bytes"):
        whole(_file(tmp_path / "bomb.mat", struct.pack("<II", 15, len(packed)) + packed))


@pytest.mark.slow
@pytest.mark.parametrize("packed", [False, True])
def test_no_bit_of_a_small_file_ends_in_anything_but_a_log_or_a_line(packed, tmp_path):
    """Every bit, in this process: a crash would end all tests."""
    savemat(tmp_path / "small.mat", {"D": np.arange(12.0).reshape(3, 4)}, do_compression=packed)
    sound = (tmp_path / "small.mat").read_bytes()
    for number in range(8 * 124, 8 * len(sound)):
        flipped = bytearray(sound)
        flipped[number // 8] ^= 1 << number % 8
        assert not mat_escapes(bytes(flipped), tmp_path / "flipped.mat"), number


def _element(kind, data, *, size=None):
    told = len(data) if size is None else size
    return struct.pack("<II", kind, told) + data + bytes(-len(data) % 8)


def _numbers(kind, *values):
    return _element(kind, struct.pack(f"<{len(values)}i", *values))


def _array(array_class, shape, *parts, flags=0, count=2):
    flagged = _numbers(6, *[array_class | flags, 0, 0][:count])
    body = flagged + _numbers(5, *shape) + _element(1, b"D") + b"".join(parts)
    return _element(14, body)


def _file(path, array):
    path.write_bytes(b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM" + array)
    return path


DOUBLES = _element(9, bytes(16))
NUMBER = _array(6, (1, 1), _element(9, bytes(8)))


def _sparse(rows, ends, size=16, shape=(3, 2)):
    return _array(5, shape, _numbers(5, *rows), _numbers(5, *ends), _element(9, bytes(size)))


def _struct(length, names, *values):
    return _array(2, (1, 1), _numbers(5, length), _element(1, names), *values)


WHOLE = {
    "two numbers": _array(6, (2, 1), DOUBLES),
    "complex ones": _array(6, (2, 1), DOUBLES, DOUBLES, flags=0x0800),
    "small ones": _array(6, (2, 1), _element(2, b"ab")),
    "sparse ones": _sparse((0, 2), (0, 1, 2)),
    "sparse ones with room left": _sparse((0, 2, 9), (0, 1, 2), 24),
    "a row of sparse ones": _sparse((2,), (0, 0, 1), 8),
    "two cells": _array(1, (2, 1), NUMBER, NUMBER),
    "an empty cell": _array(1, (1, 1), _element(14, b"")),
    "a struct": _struct(4, b"a\0\0\0b\0\0\0", NUMBER, NUMBER),
    "a function": _array(16, (1, 1), NUMBER),
    "32 dimensions": _array(6, (1,) * 32, _element(9, bytes(8))),
}
DAMAGED = {
    "a number too few": (_array(6, (3, 1), DOUBLES), "16 bytes of numbers where 3 should be"),
    "a number too many": (_array(6, (1, 1), DOUBLES), "16 bytes of numbers where 1 should be"),
    "no imaginary part": (_array(6, (2, 1), DOUBLES, flags=0x0800), "0 bytes where a tag"),
    "one dimension": (_array(6, (2,), DOUBLES), "a shape of 1 numbers"),
    "33 dimensions": (_array(6, (1,) * 33, _element(9, bytes(8))), "a shape of 33 numbers"),
    "fewer than no rows": (_array(6, (-1, 2), b""), "-1 the least"),
    "one flag": (_array(6, (2, 1), DOUBLES, count=1), "4 bytes of flags"),
    "three flags": (_array(6, (2, 1), DOUBLES, count=3), "12 bytes of flags"),
    "class 19": (_array(19, (1, 1), NUMBER), "an array of class 19"),
    "a row beyond the last": (_sparse((0, 3), (0, 1, 2)), "rows of a sparse"),
    "a row before the first": (_sparse((-1, 2), (0, 1, 2)), "rows of a sparse"),
    "ends that fall back": (_sparse((0, 1), (0, 2, 1)), "columns of a sparse"),
    "ends that begin late": (_sparse((0, 1), (1, 1, 2)), "columns of a sparse"),
    "an end too few": (_sparse((0, 1), (0, 2)), "columns of a sparse"),
    "more ends than rows": (_sparse((0,), (0, 1, 2)), "rows of a sparse"),
    "a sparse number too few": (_sparse((0, 2), (0, 1, 2), 8), "8 bytes of numbers where 2"),
    "cells that are not there": (_array(1, (99, 99), NUMBER), "9801 arrays within"),
    "a cell that is a number": (_array(1, (1, 1), DOUBLES), "an array within of type 9"),
    "a struct without a name's length": (_struct(0, b"", NUMBER), "0 bytes of names of 0"),
    "names cut off": (_struct(4, b"a\0\0\0b", NUMBER, NUMBER), "5 bytes of names of 4"),
    "a struct without its values": (_struct(4, b"a\0\0\0", b""), "0 bytes where a tag"),
    "an element that runs out": (_element(14, b"", size=64), "an element of 64 bytes of which 0"),
    "a short one of five bytes": (struct.pack("<HHI", 14, 5, 0), "a short element of 5 bytes"),
    "no array": (_element(9, bytes(8)), "a variable of type 9"),
}


@pytest.mark.parametrize("name", WHOLE)
def test_every_kind_of_array_is_whole_as_matlab_writes_it(name, tmp_path):
    path = _file(tmp_path / "made.mat", WHOLE[name])
    assert whole(path) == path


@pytest.mark.parametrize("name", DAMAGED)
def test_every_tag_must_fit_what_it_is_part_of(name, tmp_path):
    array, message = DAMAGED[name]
    with pytest.raises(DamagedError, match=message):
        whole(_file(tmp_path / "made.mat", array))


@pytest.mark.parametrize(("depth", "fits"), [(32, True), (33, False)])
def test_arrays_are_within_each_other_to_a_depth(depth, fits, tmp_path):
    array = NUMBER
    for _ in range(depth):
        array = _array(1, (1, 1), array)
    path = _file(tmp_path / "made.mat", array)
    with nullcontext() if fits else pytest.raises(DamagedError, match="more than 32 deep"):
        assert whole(path) == path
