"""Files as others have them: NumPy's, Excel's, MATLAB's objects, and binary ones of any kind."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

import butterfly as bf
from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from tests.logs.columns import COLUMNS, TABLE, TIME
from tests.logs.written import MARK73, write_objects, write_sheets

SHARED = Path(__file__).parents[3] / "shared/data/cases/strangers/not_text_files"


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
