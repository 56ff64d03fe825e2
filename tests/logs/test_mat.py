import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from butterfly.errors import InputError
from butterfly.logs.log import InputKind
from butterfly.logs.mat import read_mat, write_mat

KIND = {"input_kind": InputKind.TORQUE}
MATRIX = np.random.default_rng(0).standard_normal((20, 4))


def test_a_log_survives_writing_and_reading_bit_for_bit(sine_log, tmp_path):
    write_mat(sine_log, tmp_path / "log.mat")
    read = read_mat(tmp_path / "log.mat", **KIND)
    for name, column in sine_log.columns().items():
        np.testing.assert_array_equal(getattr(read, name), column)
    assert [path.name for path in tmp_path.iterdir()] == ["log.mat"]


def test_stray_variables_are_ignored_and_velocity_may_be_missing(tmp_path):
    savemat(tmp_path / "a.mat", {"D": MATRIX[:, :3], "have_genvar_mex": 1})
    log = read_mat(tmp_path / "a.mat", **KIND)
    assert log.velocity is None
    np.testing.assert_array_equal(log.angle, MATRIX[:, 2])


@pytest.mark.parametrize(
    ("variables", "message"),
    [
        ({"E": MATRIX}, "D: got no such variable"),
        ({"D": MATRIX[:, :2]}, r"D: got shape \(20, 2\)"),
        ({"D": MATRIX.reshape(5, 4, 4)}, r"D: got shape \(5, 4, 4\)"),
        ({"D": MATRIX[:3]}, "time: got 3 samples"),
        ({"D": MATRIX * 1j}, "D: got type complex"),
        ({"D": "text"}, "D: got"),
    ],
)
def test_a_wrong_content_is_named(tmp_path, variables, message):
    path = tmp_path / "bad.mat"
    savemat(path, variables)
    with pytest.raises(InputError, match=message) as caught:
        read_mat(path, **KIND)
    assert str(path) in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.mat: path: got no such file"):
        read_mat(tmp_path / "nowhere.mat", **KIND)


def test_without_h5py_the_hdf5_based_format_is_refused_with_two_ways_out(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    path = tmp_path / "v73.mat"
    header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    path.write_bytes(header + bytes(600))
    with pytest.raises(InputError, match=r"pip install 'butterfly-testbed\[hdf5\]'.*'-v7'"):
        read_mat(path, **KIND)


@pytest.fixture
def whole(sine_log, tmp_path):
    """Bytes of a file that can be read."""
    write_mat(sine_log, tmp_path / "whole.mat")
    return (tmp_path / "whole.mat").read_bytes()


@settings(max_examples=60)
@given(share=st.floats(0, 0.999))
def test_a_truncated_file_is_one_typed_error_wherever_it_ends(tmp_path, whole, share):
    (tmp_path / "part.mat").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError):
        read_mat(tmp_path / "part.mat", **KIND)


@settings(max_examples=60)
@given(junk=st.binary(max_size=400))
def test_any_other_bytes_are_one_typed_error(tmp_path, junk):
    (tmp_path / "junk.mat").write_bytes(junk)
    with pytest.raises(InputError):
        read_mat(tmp_path / "junk.mat", **KIND)
