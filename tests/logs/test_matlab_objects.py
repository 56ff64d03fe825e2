"""Tables, timetables and timeseries of MATLAB's."""

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from tests.logs.columns import COLUMNS, FACTORS, MATRIX, TIME, assert_read
from tests.logs.written import write_objects


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_objects_of_matlabs_are_read(tmp_path, version):
    path, frame = tmp_path / "log.mat", pd.DataFrame(COLUMNS)
    write_objects(path, {"T": frame}, version)
    assert_read(path)
    stamps = pd.to_timedelta((1e9 * TIME).round().astype(np.int64), unit="ns").rename("Time")
    series = {"u": (MATRIX[:, 1], "mV", TIME), "q": (MATRIX[:, 2], "deg", (0.0, 0.02))}
    timed = frame[["input", "angle"]].set_index(stamps)
    write_objects(path, {"TT": timed, "s": {"T": frame}, **series}, version)
    assert_read(path)
    assert_read(path, ("s.T.time", "s.T.input", "TT.angle"))
    np.testing.assert_allclose(read_log(path, at="TT").time, TIME)
    log = assert_read(path, ("q.Time", "u.Data", "q.Data"), factors=(1, 1e-3, np.pi / 180))
    assert log.reading.columns["input"].unit == "mV"
    write_objects(path, {"T": frame}, version, units=["ms", "mV", "deg"])
    assert_read(path, factors=FACTORS)
    write_objects(path, {"T": frame, "TT": timed}, version)
    with pytest.raises(InputError, match=r"got tables T, TT; expected columns of one of them"):
        read_log(path)
    savemat(path, {"run": COLUMNS, "other": {"time": TIME}})
    assert_read(path)
