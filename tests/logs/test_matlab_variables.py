"""Variables of MATLAB's files of any version, and that nothing else is taken for one."""

import struct
import zlib
from contextlib import nullcontext
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.sparse import csc_matrix

from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from butterfly.logs.matlab_variables import MatlabObject, load_variables
from tests.fuzz.files import log_escapes
from tests.logs.matlab import KIND, LEVEL5, MATRIX, NUMBER, RAMP, array, element, integers
from tests.logs.written import mat73

HOSTILE = Path(__file__).parents[1] / "data/hostile"
SOUND = {
    "matrix": {"D": MATRIX},
    "single": {"D": MATRIX.astype(np.float32)},
    "integers": {"D": (1000 * MATRIX).astype(np.int16)},
    "unsigned": {"D": np.arange(60, dtype=np.uint16).reshape(20, 3)},
    "bytes": {"D": np.arange(60, dtype=np.uint8).reshape(20, 3)},
    "complex": {"D": MATRIX + 1j},
    "three dimensions": {"D": np.zeros((2, 2, 2))},
    "vectors": {"t": RAMP, "u": np.sin(RAMP), "q": np.cos(RAMP), "c": np.array(["a"], "O")},
    "struct": {"data": {"t": RAMP, "u": np.sin(RAMP), "q": np.cos(RAMP), "x": {"y": "z"}}},
    "text": {"s": "hello", "b": np.array([True, False])},
    "sparse": {"D": csc_matrix(np.eye(3))},
    "note": {"s": "hello"},
    "empty": {"D": np.zeros((0, 4)), "c": np.array([], dtype=object)},
}
OF_LEVEL_4 = ("matrix", "single", "integers", "unsigned", "bytes", "complex", "sparse", "note")
WHOLE = [(name, "5", packed) for name in SOUND for packed in (False, True)]
WHOLE += [(name, "4", False) for name in OF_LEVEL_4]


def _same(found, scipys):
    if isinstance(found, dict):
        return all(_same(found[name], scipys[0, 0][name]) for name in scipys.dtype.names)
    if isinstance(found, list):
        return all(map(_same, found, scipys.ravel()))
    if isinstance(found, str) or found.dtype.kind == "U":
        return isinstance(found, str) or found.item() == scipys.item()
    return (found.shape, found.tolist()) == (scipys.shape, scipys.tolist())


@pytest.mark.filterwarnings("ignore:The default value for `spmatrix`:DeprecationWarning")
@pytest.mark.parametrize(("name", "level", "packed"), WHOLE)
def test_what_is_whole_is_read_as_scipy_reads_it(name, level, packed, tmp_path):
    path = tmp_path / "sound.mat"
    savemat(path, SOUND[name], format=level, do_compression=packed)
    found, names = load_variables(path, [])
    assert names == [*SOUND[name]]
    assert all(_same(found[each], loadmat(path)[each]) for each in names)


def test_files_of_the_other_order_of_bytes_are_read(tmp_path):
    matrix = np.arange(48.0).reshape(16, 3)
    data = matrix.T.astype(">f8").tobytes()
    body = struct.pack(">IIII", 6, 8, 6, 0) + struct.pack(">IIii", 5, 8, 16, 3)
    body += struct.pack(">HHc3x", 1, 1, b"D") + struct.pack(">II", 9, len(data)) + data
    path = tmp_path / "big.mat"
    level5 = LEVEL5[:-2] + b"MI" + struct.pack(">II", 14, len(body)) + body
    for content in (level5, struct.pack(">5I", 1000, 16, 3, 0, 2) + b"D\0" + data):
        path.write_bytes(content)
        np.testing.assert_array_equal(read_log(path).angle, matrix[:, 2])


def test_a_flipped_bit_that_ended_the_process_is_refused():
    with pytest.raises(InputError, match=r"unreadable \(numbers of type 8\).*a whole .mat file"):
        read_log(HOSTILE / "segfault_one_bit.mat")


def test_packed_data_are_not_unpacked_without_end(tmp_path, monkeypatch):
    monkeypatch.setattr("butterfly.files._FREE", 1 << 20)
    packed = zlib.compress(bytes(1 << 22))
    with pytest.raises(InputError, match="more than 1,048,576 bytes"):
        _read(struct.pack("<II", 15, len(packed)) + packed, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("packed", [False, True])
def test_no_bit_of_a_small_file_ends_in_anything_but_a_log_or_a_line(packed, tmp_path):
    """Every bit, in this process: a crash would end all tests."""
    savemat(tmp_path / "small.mat", {"D": np.arange(12.0).reshape(3, 4)}, do_compression=packed)
    sound = (tmp_path / "small.mat").read_bytes()
    for number in range(8 * 124, 8 * len(sound)):
        flipped = bytearray(sound)
        flipped[number // 8] ^= 1 << number % 8
        assert not log_escapes(".mat", None, bytes(flipped), tmp_path / "flipped.mat"), number


def _read(array, folder):
    path = folder / "made.mat"
    path.write_bytes(LEVEL5 + array)
    return load_variables(path, [])[0]["D"]


def _struct(length, names, *values):
    return array(2, (1, 1), integers(5, length), element(1, names), *values)


DOUBLES = element(9, bytes(16))
DAMAGED = {
    "a number too few": (array(6, (3, 1), DOUBLES), "16 bytes of data for 3 numbers"),
    "a number too many": (array(6, (1, 1), DOUBLES), "16 bytes of data for 1 numbers"),
    "no imaginary part": (array(6, (2, 1), DOUBLES, flags=0x0800), "0 bytes instead of a tag"),
    "one dimension": (array(6, (2,), DOUBLES), "a shape of 1 numbers"),
    "33 dimensions": (array(6, (1,) * 33, element(9, bytes(8))), "a shape of 33 numbers"),
    "fewer than no rows": (array(6, (-1, 2), b""), "the smallest -1"),
    "one flag": (array(6, (2, 1), DOUBLES, count=1), "4 bytes of flags"),
    "three flags": (array(6, (2, 1), DOUBLES, count=3), "12 bytes of flags"),
    "class 19": (array(19, (1, 1), NUMBER), "an array of class 19"),
    "a field that is a number": (_struct(4, b"a\0\0\0", DOUBLES), "a nested array of type 9"),
    "a struct without a name's length": (_struct(0, b"", NUMBER), "0 bytes of field names of 0"),
    "names cut off": (_struct(4, b"a\0\0\0b", NUMBER, NUMBER), "5 bytes of field names of 4"),
    "a struct without its values": (_struct(4, b"a\0\0\0", b""), "0 bytes instead of a tag"),
    "an element that runs out": (element(14, b"", size=64), "an element of 64 bytes, 0 present"),
    "a short one of five bytes": (struct.pack("<HHI", 14, 5, 0), "5 bytes, 4 present"),
    "no array": (element(9, bytes(8)), "a variable of type 9"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_every_tag_must_fit_what_it_is_part_of(name, tmp_path):
    array, message = DAMAGED[name]
    with pytest.raises(InputError, match=rf"unreadable \(.*{message}"):
        _read(array, tmp_path)


def test_short_elements_empty_fields_and_objects_are_read_as_what_they_are(tmp_path):
    assert _read(array(6, (2, 1), element(2, b"ab")), tmp_path).tolist() == [[97], [98]]
    assert _read(_struct(4, b"a\0\0\0", element(14, b"")), tmp_path)["a"].size == 0
    assert isinstance(_read(array(16, (1, 1), NUMBER), tmp_path), MatlabObject)


@pytest.mark.parametrize(("depth", "fits"), [(32, True), (33, False)])
def test_structs_are_within_each_other_to_a_depth(depth, fits, tmp_path):
    array = NUMBER
    for _ in range(depth):
        array = _struct(4, b"a\0\0\0", array)
    with nullcontext() if fits else pytest.raises(InputError, match="more than 32 deep"):
        _read(array, tmp_path)


@pytest.mark.parametrize("kind", [2000, 3000, 4000, 1000, 60])
def test_floats_of_vax_and_cray_and_types_that_are_none_are_refused(tmp_path, kind):
    path = tmp_path / "four.mat"
    savemat(path, {"D": MATRIX}, format="4")
    path.write_bytes(struct.pack("<I", kind) + path.read_bytes()[4:])
    said = "not IEEE" if kind > 1000 else f"type {kind}"
    with pytest.raises(InputError, match=f"unreadable .*{said}"):
        read_log(path, **KIND)


def test_level_4_cut_anywhere_or_without_the_matrix_is_one_line(tmp_path):
    path = tmp_path / "four.mat"
    savemat(path, {"D": MATRIX}, format="4")
    whole = path.read_bytes()
    for end in range(len(whole)):
        path.write_bytes(whole[:end])
        with pytest.raises(InputError):
            read_log(path, **KIND)
    savemat(path, {"t": RAMP}, format="4")
    with pytest.raises(InputError, match=r"D: got no such variable \(there are: t\)"):
        read_log(path, **KIND)


def _elsewhere(folder):
    """Files of v7.3 whose angle is not their own, or was never written."""
    secret = folder / "secret"
    secret.write_bytes(b"root:x:0:0:root:/root:/bin/bash\n" * 5)
    other = folder / "other.h5"
    with h5py.File(other, "w") as file:
        file["q"] = RAMP
    layout = h5py.VirtualLayout(shape=(20,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(other), "q", shape=(20,))
    gone = h5py.VirtualLayout(shape=(20,), dtype="f8")
    gone[:] = h5py.VirtualSource("gone.h5", "q", shape=(20,))

    def some(file):
        file.create_dataset("q", (20,), "f8", chunks=(5,))[:10] = 1.0

    return {
        "external storage": lambda f: f.create_dataset(
            "q", (20,), "f8", external=[(str(secret), 0, 160)]
        ),
        "external link": lambda f: f.update(q=h5py.ExternalLink(str(other), "q")),
        "soft link": lambda f: f.update(q=h5py.SoftLink("/t")),
        "virtual": lambda f: f.create_virtual_dataset("q", layout),
        "virtual, gone": lambda f: f.create_virtual_dataset("q", gone, fillvalue=0.0),
        "never written": lambda f: f.create_dataset("q", (20,), "f8"),
        "chunks never written": some,
    }


@pytest.mark.parametrize("within", [False, True])
@pytest.mark.parametrize("name", range(7))
def test_numbers_that_a_file_does_not_hold_itself_are_refused(tmp_path, name, within):
    path = tmp_path / "a.mat"
    write = [*_elsewhere(tmp_path).values()][name]
    with mat73(path) as file:
        file["t"] = RAMP
        write(file.create_group("data") if within else file)
    columns = {"time": "t", "input": "t", "angle": "data.q" if within else "q"}
    with pytest.raises(InputError, match=r"q: got .*; expected all numbers written in this file"):
        read_log(path, columns, **KIND)
