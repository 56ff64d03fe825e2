"""Files as others have them: NumPy's, Excel's, MATLAB's objects, and binary ones of any kind."""

import datetime
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

import butterfly as bf
from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from tests.logs.written import MARK73, write_objects, write_sheets

SHARED = Path(__file__).parents[3] / "shared/data/cases/strangers/not_text_files"
TIME = 0.02 * np.arange(60)
MATRIX = np.column_stack([TIME, np.sin(TIME), np.cos(TIME)])
NAMES = ("time", "input", "angle")
COLUMNS = dict(zip(NAMES, MATRIX.T, strict=True))
RECORDS = np.rec.fromarrays(MATRIX.T, names=",".join(NAMES))


def _assert_read(path, columns=None, *, factors=(1, 1, 1)):
    log = read_log(path, columns and dict(zip(NAMES, columns, strict=True)))
    for name, factor in zip(NAMES, factors, strict=True):
        np.testing.assert_allclose(getattr(log, name), factor * COLUMNS[name], rtol=1e-12)
    return log


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared cases are not there")
def test_the_files_of_strangers_are_read_or_named():
    columns = {"time": "time", "input": "des_dof_pos", "angle": "dof_pos"}
    assert bf.read(SHARED / "log.npz", columns=columns).logs[0].time.size == 800
    with pytest.raises(InputError, match=r"got a WPILib data log; expected CSV \(Advantage"):
        bf.inspect(SHARED / "data.wpilog")


KINDS = {  # how files begin, and what is said of them
    b"PK\3\4": "a zip file; .*in .xlsx or .npz",
    b"\x93NUMPY\1\0": "NumPy's; .*in .npy",
    b"PAR1\x15\4": "Parquet .*in .parquet",
    b"\x89MCAP0\r\n": "MCAP .*in .mcap",
    b"MATLAB 7.3 MAT-file, Platform": "MATLAB .*in .mat",
    b"\xd0\xcf\x11\xe0\xa1\xb1": "Excel .*as .xlsx or CSV",
    b"\x1f\x8b\x08": "a packed file; expected it unpacked",
    b"\x89HDF\r\n\x1a\n": "HDF5 .*numpy.savetxt",
    b"ARROW1\0\0": "Feather .*to_csv",
    b"WPILOG\0\1": "WPILib .*AdvantageScope",
    b"#ROSBAG V2.0\n": "ROS 1 .*rostopic echo -b FILE -p TOPIC",
    b"SQLite format 3\0": "SQLite .*ros2 bag convert",
    b"MDF     4.10    ": "MDF .*asammdf",
    b"TDSm\x0e\0": "TDMS .*nptdms",
    b"ULog\1\x12\x35\1": "ULog .*ulog2csv",
    b"\xa3\x95\x80\x80": "ArduPilot; .*mavlogdump",
    b"\x80\4\x95": "pickle, which may run any code",
    b"\x89PNG\r\n": "a picture",
    b"\x7fELF\2\1\1\0": "binary data that begin with 7f 45 4c 46 02 01 01 00; expected CSV",
}


@pytest.mark.parametrize("beginning", KINDS)
def test_another_binary_file_is_named_by_how_it_begins_with_a_way_to_a_table(tmp_path, beginning):
    for ending in ("", ".bin", ".yaml", *([] if b"ELF" in beginning else [".csv", ".txt"])):
        path = tmp_path / f"log{ending}"
        path.write_bytes(beginning + bytes(range(200)) * 20_000)
        for look in (bf.read, bf.inspect, read_log) if ending != ".yaml" else (bf.read,):
            with pytest.raises(InputError, match=f"log{ending}: content: got .*{KINDS[beginning]}"):
                look(path)


@pytest.mark.parametrize(
    ("content", "columns"),
    [
        ({"D": MATRIX}, None),
        ({"D": MATRIX.T}, ("0", 1, "2")),
        (COLUMNS | {"gains": 3.0, "note": "bench 2"}, None),
        ({"time": TIME[:, None], "M": MATRIX.T, "k": MATRIX[:, :2]}, ("time", "M.1", "M.2")),
        ({"log": RECORDS}, None),
        (MATRIX, None),
        (RECORDS, NAMES),
    ],
)
def test_arrays_of_numpy_are_read(tmp_path, content, columns):
    path = tmp_path / f"log.np{'z' if isinstance(content, dict) else 'y'}"
    np.savez(path, **content) if isinstance(content, dict) else np.save(path, content)
    _assert_read(path, columns)


def test_what_is_no_plain_array_of_numpy_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", **COLUMNS, meta=np.array({"units": "deg"}, dtype=object))
    np.savez_compressed(tmp_path / "b.npz", time=np.zeros(40 << 20))
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (%d,), }" % 10**16
    (tmp_path / "c.npy").write_bytes(b"\x93NUMPY\1\0v\0" + head.ljust(117) + b"\n")
    (tmp_path / "d.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:-90])
    told = {"a.npz": "meta: got a pickle, .*dtype != object", "b.npz": "parts of 335"}
    for name, said in (told | {"c.npy": "Unable to allocate", "d.npz": "got unreadable"}).items():
        with pytest.raises(InputError, match=rf"{name}: .*{said}"):
            read_log(tmp_path / name)


TABLE = [["time", "input", "angle"], *MATRIX.tolist()]
UNITS = [TABLE[0], ["ms", "mV", "deg"], *TABLE[1:]]
FACTORS = (1e-3, 1e-3, np.pi / 180)


def test_a_sheet_of_excels_is_read_as_a_text_is(tmp_path):
    path = tmp_path / "log.xlsx"
    above = [[None], [None, "Bench 2"], [None, "# input: mV"]]
    write_sheets(path, {"Run 3": above + [[None, *row] for row in UNITS], "Notes": [["hello", 5]]})
    log = _assert_read(path, factors=FACTORS)
    assert log.reading.layout == ("sheet Run 3", "comment lines: 1", "lines above the table: 1")
    write_sheets(path, {"a": TABLE, "b": UNITS})
    with pytest.raises(InputError, match=r"got sheets a, b; expected one sheet with these"):
        read_log(path)
    write_sheets(path, {"a": TABLE, "b": [["time", "x", "y"], *TABLE[1:]]})
    _assert_read(path)
    bad = {
        "got '2024-05-01T10:00:00' in line 62": [*TABLE, [datetime.datetime(2024, 5, 1, 10), 1, 2]],
        "got '#DIV/0!' in line 62": [*TABLE, [1.0, "#DIV/0!", 2]],
        "16384 cells; expected at most 10000": [*TABLE, [None] * 16_383 + [1.0]],
        "no row of numbers": [["hello"]],
    }
    for said, rows in bad.items():
        write_sheets(path, {"a": rows})
        with pytest.raises(InputError, match=said):
            read_log(path)


def test_dates_times_and_durations_of_excels_are_a_clock(tmp_path):
    spans = [datetime.timedelta(seconds=each) for each in TIME]
    instants = [datetime.datetime(2024, 5, 1, 10) + each for each in spans]
    for clock in (instants, [each.time() for each in instants], spans):
        rows = [NAMES, *zip(clock, *MATRIX.T[1:].tolist(), strict=True)]
        write_sheets(tmp_path / "log.xlsx", {"a": rows})
        _assert_read(tmp_path / "log.xlsx")


WRITTEN = {  # frames by name
    "log.npz": lambda p, told: np.savez(p, **told),
    "log.xlsx": lambda p, x: write_sheets(p, {k: [[*x[k]], *x[k].to_numpy().tolist()] for k in x}),
    "log.mat": lambda p, told: savemat(p, {k: v.to_numpy() for k, v in told.items()}),
    "struct.mat": savemat,
}


@pytest.mark.parametrize("name", WRITTEN)
def test_a_known_interval_is_a_clock_and_at_is_a_table_in_any_file(tmp_path, name):
    path, frame, write = tmp_path / name, pd.DataFrame(COLUMNS), WRITTEN[name]
    write(path, {"D": 1e6 * frame[["input", "angle"]]})
    data = bf.read(tmp_path, interval=0.02)
    np.testing.assert_allclose(data.logs[0].time, TIME)
    assert data.health[0].contradiction[0].endswith("faster than any joint")
    write(path, {"a": 2 * frame, "b": frame})
    np.testing.assert_allclose(read_log(path, at="b").angle, COLUMNS["angle"], rtol=1e-12)
    with pytest.raises(InputError, match=r"got c; expected|c: got no such"):
        read_log(path, at="c")


def test_a_folder_of_logs_may_hold_other_tables_and_arrays(tmp_path):
    np.savez(tmp_path / "a.npz", **COLUMNS)
    np.savez(tmp_path / "gains.npz", kp=1.0)
    write_sheets(tmp_path / "b.xlsx", {"a": TABLE})
    write_sheets(tmp_path / "notes.xlsx", {"a": [["hello"]]})
    data = bf.read(tmp_path, known={"p4": 1.0})
    assert [log.name for log in data.logs] == ["a.npz", "b.xlsx"]


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_objects_of_matlabs_are_read(tmp_path, version):
    path, frame = tmp_path / "log.mat", pd.DataFrame(COLUMNS)
    write_objects(path, {"T": frame}, version)
    _assert_read(path)
    stamps = pd.to_timedelta((1e9 * TIME).round().astype(np.int64), unit="ns").rename("Time")
    series = {"u": (MATRIX[:, 1], "mV", TIME), "q": (MATRIX[:, 2], "deg", (0.0, 0.02))}
    timed = frame[["input", "angle"]].set_index(stamps)
    write_objects(path, {"TT": timed, "s": {"T": frame}, **series}, version)
    _assert_read(path)
    _assert_read(path, ("s.T.time", "s.T.input", "TT.angle"))
    np.testing.assert_allclose(read_log(path, at="TT").time, TIME)
    log = _assert_read(path, ("q.Time", "u.Data", "q.Data"), factors=(1, 1e-3, np.pi / 180))
    assert log.reading.columns["input"].unit == "mV"
    write_objects(path, {"T": frame}, version, units=["ms", "mV", "deg"])
    _assert_read(path, factors=FACTORS)
    write_objects(path, {"T": frame, "TT": timed}, version)
    with pytest.raises(InputError, match=r"got tables T, TT; expected columns of one of them"):
        read_log(path)
    savemat(path, {"run": COLUMNS, "other": {"time": TIME}})
    _assert_read(path)


EXTRAS = {  # and what is said to be installed without them
    "b.mat": "matlab",
    "v73.mat": "hdf5",
    "bag.mcap": "mcap",
    "logs/a.xlsx": "excel",
    "logs": "excel",
}


@pytest.mark.parametrize("name", EXTRAS)
def test_without_an_extra_it_is_named(tmp_path, monkeypatch, name):
    write_objects(tmp_path / "b.mat", {"D": pd.DataFrame(COLUMNS)}, "v7")
    (tmp_path / "v73.mat").write_bytes(MARK73 + bytes(600))
    (tmp_path / "bag.mcap").write_bytes(b"\x89MCAP0\r\n")
    (folder := tmp_path / "logs").mkdir()
    write_sheets(folder / "a.xlsx", {"a": TABLE})
    for package in ("openpyxl", "matio", "h5py", "mcap.reader"):
        monkeypatch.setitem(sys.modules, package, None)
    way = ".*'-v7'" if EXTRAS[name] == "hdf5" else ""
    said = rf"pip install 'butterfly-testbed\[{EXTRAS[name]}\]'{way}"
    with pytest.raises(InputError, match=said):
        bf.read(tmp_path / name)
