"""Damaged .mat files end in one typed line, and never in SciPy's compiled reader."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.sparse import csc_matrix

from butterfly.errors import InputError
from butterfly.logs.mat import read_mat
from butterfly.logs.mat5 import DamagedError, whole
from tests.fuzz.mat import CONTENTS, escapes

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
    monkeypatch.setattr("butterfly.sizes._FREE", 1 << 20)
    path = tmp_path / "bomb.mat"
    packed = zlib.compress(bytes(1 << 22))
    header = b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(header + struct.pack("<II", 15, len(packed)) + packed)
    with pytest.raises(DamagedError, match="more than 1,048,576 bytes"):
        whole(path)


@pytest.mark.parametrize("packed", [False, True])
def test_no_bit_of_a_small_file_ends_in_anything_but_a_log_or_a_line(packed, tmp_path):
    """Every bit, in this process: a crash would end all tests."""
    savemat(tmp_path / "small.mat", {"D": np.arange(12.0).reshape(3, 4)}, do_compression=packed)
    sound = (tmp_path / "small.mat").read_bytes()
    for number in range(8 * 124, 8 * len(sound)):
        flipped = bytearray(sound)
        flipped[number // 8] ^= 1 << number % 8
        assert not escapes(bytes(flipped), tmp_path / "flipped.mat"), number
