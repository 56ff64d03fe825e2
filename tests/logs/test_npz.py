"""Arrays of NumPy's, by name or alone."""

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from tests.logs.columns import COLUMNS, MATRIX, NAMES, TIME, assert_read

RECORDS = np.rec.fromarrays(MATRIX.T, names=",".join(NAMES))


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
    assert_read(path, columns)


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
