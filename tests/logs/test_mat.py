import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from butterfly.errors import InputError
from butterfly.logs.log import InputKind
from butterfly.logs.mat import read_mat
from butterfly.logs.units import Units

KIND = {"input_kind": InputKind.TORQUE}
MATRIX = np.random.default_rng(0).standard_normal((20, 4))


def test_stray_variables_are_ignored_velocity_may_be_missing_and_columns_have_units(tmp_path):
    savemat(tmp_path / "a.mat", {"D": MATRIX[:, :3], "have_genvar_mex": 1})
    log = read_mat(tmp_path / "a.mat", units=Units.of({"time": "ms", "angle": "-deg"}), **KIND)
    assert log.velocity is None
    np.testing.assert_allclose(log.time, MATRIX[:, 0] / 1000)
    np.testing.assert_allclose(log.angle, -np.radians(MATRIX[:, 2]))


@pytest.mark.parametrize(
    ("variables", "message"),
    [
        ({"E": MATRIX}, "D: got no such variable"),
        ({"D": MATRIX[:, :2]}, r"D: got shape \(20, 2\)"),
        ({"D": MATRIX.reshape(5, 4, 4)}, r"D: got shape \(5, 4, 4\)"),
        ({"D": MATRIX[:3]}, "time: got 3 samples"),
        ({"D": MATRIX * 1j}, "D: got type complex"),
        ({"D": "text"}, "D: got"),
        ({"t": MATRIX[:, 0], "theta": 1}, "D: .*there are: t, theta.*--columns time=T"),
    ],
)
def test_a_wrong_content_is_named(tmp_path, variables, message):
    path = tmp_path / "bad.mat"
    with pytest.raises(InputError, match=r"bad\.mat: path: got no such file"):
        read_mat(path, **KIND)
    savemat(path, variables)
    with pytest.raises(InputError, match=rf"bad\.mat: {message}"):
        read_mat(path, **KIND)


def test_without_h5py_the_hdf5_based_format_is_refused_with_two_ways_out(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    path = tmp_path / "v73.mat"
    path.write_bytes(bytes(728))
    _claim73(path)
    with pytest.raises(InputError, match=r"pip install 'butterfly-testbed\[hdf5\]'.*'-v7'"):
        read_mat(path, **KIND)


@settings(max_examples=60)
@given(junk=st.binary(max_size=400))
def test_any_other_bytes_are_one_typed_error(tmp_path, junk):
    (tmp_path / "junk.mat").write_bytes(junk)
    with pytest.raises(InputError):
        read_mat(tmp_path / "junk.mat", **KIND)


RAMP = np.arange(20.0)
NAMED = {"time": "t", "input": "u_volt", "angle": "data.theta"}


def _named():
    return {
        "t": RAMP,
        "u_volt": RAMP[:, None] + 1,
        "data": {"theta": RAMP + 2, "all": np.column_stack([RAMP, RAMP + 5])},
        "D": np.column_stack([RAMP + 6, RAMP + 7, RAMP + 8, RAMP + 9]),
        "note": "bench 2",
    }


def _file73(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        _write73(file, _named())
        thing = file.create_dataset("ts", data=np.zeros((1, 6), dtype=np.uint32))
        thing.attrs["MATLAB_class"] = np.bytes_("timeseries")
        thing.attrs["MATLAB_object_decode"] = 3
        file.create_group("#refs#")
    _claim73(path)


def _claim73(path):
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


@pytest.fixture(params=["v7", "v7.3"])
def named(request, tmp_path):
    """A file with vectors, a struct and a matrix, of either version."""
    path = tmp_path / "named.mat"
    if request.param == "v7":
        savemat(path, _named())
    else:
        _file73(path)
    return path


def _write73(group, variables):
    for name, value in variables.items():
        if isinstance(value, dict):
            below = group.create_group(name)
            below.attrs["MATLAB_class"] = np.bytes_("struct")
            _write73(below, value)
        else:
            text = isinstance(value, str)
            array = np.array([ord(each) for each in value]) if text else np.atleast_2d(value).T
            data = group.create_dataset(name, data=array.astype(np.uint16) if text else array)
            data.attrs["MATLAB_class"] = np.bytes_("char" if text else "double")


@pytest.mark.parametrize(
    ("columns", "offsets"),
    [
        (NAMED, (0, 1, 2)),
        ({**NAMED, "velocity": "data.all.1"}, (0, 1, 2, 5)),
        ({"time": 0, "input": "1", "angle": "D.3"}, (6, 7, 9)),
        (None, (6, 7, 8, 9)),
    ],
)
def test_vectors_structs_and_columns_are_found_by_name(named, columns, offsets):
    log = read_mat(named, columns, **KIND)
    for column, offset in zip(log.columns().values(), offsets, strict=True):
        np.testing.assert_array_equal(column, RAMP + offset)


@pytest.mark.parametrize(
    ("angle", "parts"),
    [
        ("theta", ("theta: got no such variable", "'t'", "'u_volt'", "'data'", "'D'", "'note'")),
        ("data", ("data: got a struct; expected one of its fields", "data.theta", "data.all")),
        ("data.phi", ("data.phi: got no phi in data", "'theta'", "'all'")),
        ("data.all", ("data.all: got shape (20, 2); expected a vector", "data.all.0")),
        ("D.4", ("D.4: got no 4 in D; expected one of '0', '1', '2', '3'",)),
        ("note", ("note: got type", "expected real numbers")),
    ],
)
def test_a_wrong_name_is_told_those_that_there_are(named, angle, parts):
    with pytest.raises(InputError) as caught:
        read_mat(named, {**NAMED, "angle": angle}, **KIND)
    for part in parts:
        assert part in str(caught.value)


def test_an_object_of_matlabs_is_refused_with_a_way_out(tmp_path):
    _file73(tmp_path / "a.mat")
    with pytest.raises(InputError, match=r"ts: got a MATLAB object.*t = x\.Time"):
        read_mat(tmp_path / "a.mat", {**NAMED, "time": "ts"}, **KIND)


def test_a_struct_of_many_signals_is_read_whatever_the_version(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "many.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        _write73(file, {"data": {f"s{k}": RAMP + k for k in range(400)}})
    _claim73(path)
    names = {"time": "data.s0", "input": "data.s1", "angle": "data.s399"}
    assert read_mat(path, names).angle[0] == RAMP[0] + 399
