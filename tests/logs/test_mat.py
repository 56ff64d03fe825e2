import re

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from butterfly.logs.units import Units
from tests.logs.matlab import KIND, LEVEL5, MATRIX, NUMBER, RAMP, element, integers
from tests.logs.written import mat73, put73


def test_stray_variables_are_ignored_velocity_may_be_missing_and_columns_have_units(tmp_path):
    savemat(tmp_path / "a.mat", {"D": MATRIX[:, :3], "have_genvar_mex": 1})
    log = read_log(tmp_path / "a.mat", units=Units.of({"time": "ms", "angle": "-deg"}), **KIND)
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
    savemat(path, variables)
    with pytest.raises(InputError, match=rf"bad\.mat: {message}"):
        read_log(path, **KIND)


NAMED = {"time": "t", "input": "u_cmd", "angle": "data.theta"}


def _named():
    data = {"theta": RAMP + 2, "all": np.column_stack([RAMP, RAMP + 5])}
    matrix = np.column_stack([RAMP + 6, RAMP + 7, RAMP + 8, RAMP + 9])
    return {"t": RAMP, "u_cmd": RAMP[:, None] + 1, "data": data, "D": matrix, "note": "bench 2"}


def _file73(path):
    with mat73(path) as file:
        put73(file, _named())
        thing = file.create_dataset("ts", data=np.zeros((1, 6), dtype=np.uint32))
        thing.attrs["MATLAB_class"] = np.bytes_("timeseries")
        thing.attrs["MATLAB_object_decode"] = 3
        file.create_group("#refs#")


@pytest.fixture(params=["v7", "v7.3"])
def named(request, tmp_path):
    """A file with vectors, a struct and a matrix, of either version."""
    path = tmp_path / "named.mat"
    if request.param == "v7":
        savemat(path, _named())
    else:
        _file73(path)
    return path


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
    log = read_log(named, columns, **KIND)
    for column, offset in zip(log.columns().values(), offsets, strict=True):
        np.testing.assert_array_equal(column, RAMP + offset)


@pytest.mark.parametrize(
    ("angle", "parts"),
    [
        ("theta", ("theta: got no such variable", "'t'", "'u_cmd'", "'data'", "'D'", "'note'")),
        ("data", ("data: got a struct; expected one of its fields", "data.theta", "data.all")),
        ("data.phi", ("data.phi: got no phi in data", "'theta'", "'all'")),
        ("data.all", ("data.all: got shape (20, 2); expected a vector", "data.all.0")),
        ("D.4", ("D.4: got no 4 in D; expected one of '0', '1', '2', '3'",)),
        ("note", ("note: got type", "expected real numbers")),
    ],
)
def test_a_wrong_name_is_told_those_that_there_are(named, angle, parts):
    with pytest.raises(InputError) as caught:
        read_log(named, {**NAMED, "angle": angle}, **KIND)
    for part in parts:
        assert part in str(caught.value)


def test_an_object_of_matlabs_is_refused_with_the_line_that_converts_it(tmp_path):
    _file73(tmp_path / "a.mat")
    for name in ("ts", "ts.Time"):
        with pytest.raises(InputError, match=r"got a MATLAB object \(timeseries\).*t = x\.Time; u"):
            read_log(tmp_path / "a.mat", {**NAMED, "time": name}, **KIND)
    path = tmp_path / "out.mat"
    system = [element(1, text) for text in (b"out", b"MCOS", b"Simulink.SimulationOutput")]
    path.write_bytes(LEVEL5 + element(14, integers(6, 17, 0) + b"".join([*system, NUMBER])))
    line = r"MATLAB: t = out\.logsout\{1\}\.Values\.Time; .*; save\('log\.mat', 't', 'u'\)"
    for columns in (None, NAMED):
        with pytest.raises(InputError, match=line):
            read_log(path, columns, **KIND)


def test_a_struct_of_many_signals_is_read_whatever_the_version(tmp_path):
    path = tmp_path / "many.mat"
    with mat73(path) as file:
        put73(file, {"data": {f"s{k}": RAMP + k for k in range(400)}})
    names = {"time": "data.s0", "input": "data.s1", "angle": "data.s399"}
    assert read_log(path, names).angle[0] == RAMP[0] + 399


def _simulink():
    """What Simulink saves as a structure with time, of one signal and of two, and as arrays."""
    both = np.array([({"values": RAMP + 1, "label": "u"},), ({"values": RAMP + 2, "label": "q"},)])
    one = {"time": RAMP, "signals": {"values": np.column_stack([RAMP, RAMP + 2]), "label": "q"}}
    records = np.zeros((1, 2), dtype=[("values", object), ("label", object)])
    for k, (each,) in enumerate(both):
        records[0, k] = (each["values"][:, None], each["label"])
    return {"one": one, "out": {"time": RAMP, "signals": records}, "tout": RAMP, "D": MATRIX[:, :3]}


@pytest.fixture(params=["v7", "v7.3"])
def simulink(request, tmp_path):
    path = tmp_path / "simulink.mat"
    if request.param == "v7":
        savemat(path, _simulink())
        return path
    with mat73(path) as file:
        put73(file, {"one": _simulink()["one"], "tout": RAMP, "out": {"time": RAMP}})
        hidden, signals = file.create_group("#refs#"), file["out"].create_group("signals")
        signals.attrs["MATLAB_class"] = np.bytes_("struct")
        values = {f"v{k}": RAMP + 1 + k for k in (0, 1)}
        put73(hidden, {**values, "l0": "u", "l1": "q"})
        for field in ("values", "label"):
            refs = [hidden[f"{field[0]}{k}"].ref for k in (0, 1)]
            signals.create_dataset(field, data=np.array(refs, h5py.ref_dtype)[:, None])
    return path


@pytest.mark.parametrize(
    "names",
    [
        ("out.time", "out.signals.0.values", "out.signals.1.values"),
        ("tout", "one.signals.values.0", "one.signals.values.1"),
    ],
)
def test_what_simulink_saves_as_structs_and_arrays_is_read_by_name(simulink, names):
    log = read_log(simulink, dict(zip(("time", "input", "angle"), names, strict=True)), **KIND)
    np.testing.assert_array_equal(log.time, RAMP)
    np.testing.assert_array_equal(log.input, RAMP + names[1].startswith("out"))
    np.testing.assert_array_equal(log.angle, RAMP + 2)


def test_of_an_array_of_structs_its_numbers_and_fields_are_named(simulink):
    for name, said in [
        ("out.signals", "a struct; expected one of its fields: out.signals.0, out.signals.1"),
        ("out.signals.2", "no 2 in out.signals; expected one of '0', '1'"),
        ("out.signals.1.value", "no value in out.signals.1; expected 'values'"),
    ]:
        with pytest.raises(InputError, match=re.escape(said)):
            read_log(simulink, {"time": "tout", "input": "tout", "angle": name}, **KIND)


@pytest.mark.parametrize("columns", [None, {"time": 0, "input": "D.1", "angle": 2}])
@pytest.mark.parametrize("level", ["4", "5"])
def test_a_matrix_that_lies_on_its_side_is_turned(tmp_path, columns, level):
    savemat(tmp_path / "a.mat", {"D": MATRIX.T}, format=level)
    log = read_log(tmp_path / "a.mat", columns, **KIND)
    np.testing.assert_array_equal(log.angle, MATRIX[:, 2])
