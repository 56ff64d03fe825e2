import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.logs.log import InputKind, Intersample
from butterfly.logs.manifest_draft import draft, has_thesis_names, with_columns
from tests.logs.test_formats import write_log

HOW = {"arm": 0.104, "input": InputKind.TORQUE, "intersample": Intersample.FIRST_ORDER_HOLD}


def test_file_names_tell_mass_frequency_and_amplitude(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/Data_120_5__3_5__0015.mat").touch()
    (tmp_path / "Data_52__10__004.mat").touch()
    (tmp_path / "notes.txt").touch()
    manifest = draft(tmp_path, HOW)
    first, second = manifest.logs
    assert (first.added_mass, first.omega, first.amplitude) == (0.052, 10.0, 0.04)
    assert second.file == "sub/Data_120_5__3_5__0015.mat"
    assert (second.added_mass, second.omega, second.amplitude) == (0.1205, 3.5, 0.015)


def test_the_shipped_manifest_is_what_the_file_names_say(logs_folder, real_manifest):
    generated = draft(logs_folder, HOW)
    assert len(generated.logs) == 41
    assert real_manifest.logs == generated.logs


def test_a_folder_without_logs_or_with_other_names_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        has_thesis_names(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"no .*\.mat, .*file"):
        draft(tmp_path, HOW)
    (tmp_path / "run7.mat").touch()
    (tmp_path / "Data_52__10__004.mat").touch()
    with pytest.raises(InputError, match="got run7"):
        draft(tmp_path, HOW)


@given(grams=st.decimals(0, 500, places=1), omega=st.decimals(1, 30, places=2))
def test_any_name_of_the_pattern_is_read_back(tmp_path_factory, grams, omega):
    folder = tmp_path_factory.mktemp("names")
    stem = f"Data_{grams}__{omega}".replace(".", "_")
    (folder / f"{stem}__001.mat").touch()
    (entry,) = draft(folder, HOW).logs
    assert entry.added_mass == pytest.approx(float(grams) / 1e3)
    assert entry.omega == pytest.approx(float(omega))
    assert entry.amplitude == 0.01


def test_numbers_in_names_are_written_in_the_units_that_are_told(tmp_path):
    (tmp_path / "Data_120_5__6__0015.mat").touch()
    units = {"mass": "g", "omega": "rpm"}
    manifest = draft(tmp_path, HOW | {"units": units})
    (entry,) = manifest.logs
    assert (entry.added_mass, entry.omega) == (120.5, pytest.approx(6 * 60 / (2 * math.pi)))
    assert manifest.added_mass(entry).mass == pytest.approx(0.1205)
    assert manifest.excitation(entry).omega == pytest.approx(6.0)
    alone = draft(tmp_path / "Data_120_5__6__0015.mat", HOW | {"units": units})
    assert alone.logs == manifest.logs


def test_all_logs_of_a_folder_are_found_whatever_their_names(tmp_path, sine_log):
    for name in ("b.mat", "sub/a.csv", "c.dat"):
        write_log(sine_log.take(np.arange(20)), tmp_path / name)
    (tmp_path / "notes.txt").write_text("Tuesday, bench 2\n")
    (tmp_path / "scales.txt").write_text("52 53 54\n" * 15)
    manifest = draft(tmp_path, HOW | {"columns": {"time": 0}})
    assert [entry.file for entry in manifest.logs] == ["b.mat", "c.dat", "sub/a.csv"]
    assert manifest.columns == {"time": 0}
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"no .*file with a table"):
        draft(tmp_path / "empty", HOW)


@pytest.mark.parametrize(
    ("head", "columns"),
    [
        *(("a,b,c", (0, 1, 2)), (",a,b,c", (1, 2, 3)), ("Unnamed: 0,a,b,c", (1, 2, 3))),
        *(("", (0, 1, 2)), ("t,u,q", ("t", "u", "q")), ("secs,counts,note,volts", None)),
    ],
)
def test_columns_are_known_by_usual_words_or_are_the_first_three(tmp_path, head, columns):
    width = max(3, 1 + head.count(","))
    rows = [
        ",".join([str(k), f"{0.1 * k}", f"{k % 7}.5", f"{k % 5}.25"][:width]) for k in range(40)
    ]
    (tmp_path / "a.csv").write_text("\n".join([*([head] if head else []), *rows, ""]))
    drafted = with_columns(draft(tmp_path, {}))
    if columns is None:
        assert drafted.columns == {"time": "secs", "input": "volts", "angle": "counts"}
    else:
        assert tuple(drafted.columns.values()) == columns


def test_a_mass_within_a_name_is_taken_with_an_arm(tmp_path, sine_log):
    names = ("run000_100g_3rads.csv", "run001_0g_signal.csv", "a_120_5g.csv")
    for name in names:
        write_log(sine_log.take(np.arange(20)), tmp_path / name)
    masses = ([e.added_mass for e in draft(tmp_path, g).logs] for g in ({}, {"arm": 0.1}))
    assert list(masses) == [[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]]
