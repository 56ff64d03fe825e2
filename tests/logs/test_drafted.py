import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.logs.drafted import manifest_from_names, manifest_of_files, manifest_of_log
from butterfly.logs.log import InputKind, Intersample
from butterfly.logs.mat import write_mat

HOW = {"arm": 0.104, "input_kind": InputKind.TORQUE, "intersample": Intersample.FIRST_ORDER_HOLD}


def test_file_names_tell_mass_frequency_and_amplitude(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/Data_120_5__3_5__0015.mat").touch()
    (tmp_path / "Data_52__10__004.mat").touch()
    (tmp_path / "notes.txt").touch()
    manifest = manifest_from_names(tmp_path, **HOW)
    first, second = manifest.logs
    assert (first.added_mass, first.omega, first.amplitude) == (0.052, 10.0, 0.04)
    assert second.file == "sub/Data_120_5__3_5__0015.mat"
    assert (second.added_mass, second.omega, second.amplitude) == (0.1205, 3.5, 0.015)


def test_the_shipped_manifest_is_what_the_file_names_say(logs_folder, real_manifest):
    generated = manifest_from_names(logs_folder, **HOW)
    assert len(generated.logs) == 41
    assert real_manifest.logs == generated.logs


def test_a_folder_without_logs_or_with_other_names_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        manifest_from_names(tmp_path / "nowhere", **HOW)
    with pytest.raises(InputError, match=r"no .*\.mat, .*file"):
        manifest_from_names(tmp_path, **HOW)
    (tmp_path / "run7.mat").touch()
    with pytest.raises(InputError, match="got run7"):
        manifest_from_names(tmp_path, **HOW)


@given(grams=st.decimals(0, 500, places=1), omega=st.decimals(1, 30, places=2))
def test_any_name_of_the_pattern_is_read_back(tmp_path_factory, grams, omega):
    folder = tmp_path_factory.mktemp("names")
    stem = f"Data_{grams}__{omega}".replace(".", "_")
    (folder / f"{stem}__001.mat").touch()
    (entry,) = manifest_from_names(folder, **HOW).logs
    assert entry.added_mass == pytest.approx(float(grams) / 1e3)
    assert entry.omega == pytest.approx(float(omega))
    assert entry.amplitude == 0.01
