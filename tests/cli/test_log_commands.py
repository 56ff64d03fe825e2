"""The commands that look at logs."""

import shutil

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from butterfly.logs.manifest import read_manifest
from butterfly.logs.mat import write_mat
from tests.cli.one_line import assert_one_line_error


@pytest.fixture
def log_file(sine_log, tmp_path):
    write_mat(sine_log, tmp_path / "log.mat")
    return tmp_path / "log.mat"


def test_inspect_shows_health_and_draws(butterfly, log_file, tmp_path):
    code, out, _ = butterfly("inspect", log_file, "--plot", tmp_path / "plot.html")
    assert code == 0
    assert "dominant frequency" in out
    assert "40000" in out
    assert (tmp_path / "plot.html").stat().st_size > 1e6


def test_inspect_repairs_what_it_is_told_to(butterfly, log_file):
    matrix = loadmat(log_file)["D"]
    matrix[5, 2] = np.nan
    savemat(log_file, {"D": matrix})
    assert_one_line_error(butterfly("inspect", log_file), log_file, "angle", "sample 5")
    code, out, _ = butterfly("inspect", log_file, "--repair", "non_finite")
    assert code == 0
    assert "1 × sample not finite" in out


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (lambda d: d[:, :2], ("D", "shape (40000, 2)")),
        (lambda d: d[::-1], ("time", "ascending")),
        (lambda d: d * [0, 1, 1, 1] + [2, 0, 0, 0], ("time", "never advances")),
        (lambda d: d * [1, 1, 0, 1], ("angle", "constant 0")),
        (lambda d: d[:4], ("time", "4 samples")),
    ],
    ids=["shape", "unsorted", "stopped clock", "no motion", "too short"],
)
def test_a_bad_log_is_one_line_with_file_field_value_and_exit_code_2(
    butterfly, log_file, change, parts
):
    savemat(log_file, {"D": change(loadmat(log_file)["D"])})
    assert_one_line_error(butterfly("inspect", log_file), log_file, *parts)


def test_several_logs_are_told_in_a_line_each(butterfly, quick_data):
    code, out, err = butterfly("inspect", quick_data)
    assert (code, err) == (0, "")
    for entry in read_manifest(quick_data / "manifest.yaml").logs:
        (line,) = [line for line in out.splitlines() if entry.file in line]
        samples = len(loadmat(quick_data / entry.file)["D"])
        assert line.split()[1] == str(samples)
        assert line.split()[-1] == "none"


def test_of_several_logs_one_is_told_and_drawn_as_if_it_were_alone(butterfly, quick_data, tmp_path):
    plot = tmp_path / "plot.html"
    file = quick_data / read_manifest(quick_data / "manifest.yaml").logs[2].file
    code, out, _ = butterfly("inspect", quick_data, "--log", 2, "--plot", plot)
    assert code == 0
    assert plot.stat().st_size > 1e6
    assert butterfly("inspect", file)[1] in out
    assert_one_line_error(butterfly("inspect", quick_data, "--plot", plot), "12 logs", "--log N")
    assert_one_line_error(butterfly("inspect", quick_data, "--log", 12), "--log", "less than 12")


def test_a_log_that_cannot_be_used_does_not_hide_the_others(butterfly, quick_data, tmp_path):
    folder = shutil.copytree(quick_data, tmp_path / "data")
    bad, good, *_ = [entry.file for entry in read_manifest(folder / "manifest.yaml").logs]
    matrix = loadmat(folder / bad)["D"]
    matrix[5, 2] = np.nan
    savemat(folder / bad, {"D": matrix})
    code, out, err = butterfly("inspect", folder)
    assert code == 2
    assert "sample 5" in out
    assert good in out
    assert "1 that cannot be used" in err
    assert butterfly("inspect", folder, "--repair", "non_finite")[0] == 0


def test_a_csv_file_of_any_columns_is_inspected(butterfly, sine_log, tmp_path):
    path = tmp_path / "log.csv"
    table = np.column_stack([sine_log.time, sine_log.input, sine_log.angle])[::10]
    np.savetxt(path, table, delimiter=",", header="t,volts,phi", comments="")
    assert_one_line_error(butterfly("inspect", path), path)
    code, out, _ = butterfly("inspect", path, "--columns", "time=t,input=volts,angle=phi")
    assert code == 0
    assert "4000" in out
    assert "is a guess" in out  # of a log of which nothing says that it is a sine
    assert "--zero" in out


def test_inspect_says_where_the_hand_hangs_and_how_that_is_known(butterfly, log_file, quick_data):
    assert "hangs at -" in butterfly("inspect", quick_data)[1]
    assert "(steady swing)" in butterfly("inspect", quick_data)[1]
    out = butterfly("inspect", quick_data, "--zero", "0.1+-0.02")[1]
    assert "hangs at 0.1000 ± 0.02 rad (told)" in out
    assert_one_line_error(butterfly("inspect", log_file, "--zero", "left"), "--zero", "left")


def test_a_log_that_a_manifest_beside_it_does_not_list_is_read_all_the_same(
    butterfly, quick_data, tmp_path
):
    folder = shutil.copytree(quick_data, tmp_path / "data")
    first, second, *_ = [entry.file for entry in read_manifest(folder / "manifest.yaml").logs]
    (folder / second).unlink()
    (folder / first).rename(folder / "other.mat")
    assert butterfly("inspect", folder / "other.mat")[0] == 0
