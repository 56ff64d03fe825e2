"""Whatever names the same data gives the same logs."""

import json
import shutil

import pytest

from butterfly.errors import InputError
from butterfly.experiment.data_source import manifest_of, named_data
from butterfly.logs.log import InputKind, Intersample
from butterfly.logs.manifest import MANIFEST_NAME, read_manifest

TOLD = {"arm": 0.1, "input_kind": InputKind.TORQUE, "intersample": Intersample.FIRST_ORDER_HOLD}


def _saved(path, source):
    path.write_text(json.dumps({"data": {"source": str(source)}}))
    return path


@pytest.fixture
def bare_folder(quick_data, tmp_path):
    """One log, named as the thesis does, and no manifest."""
    first = read_manifest(quick_data / MANIFEST_NAME).logs[0].file
    (tmp_path / "bare").mkdir()
    shutil.copy(quick_data / first, tmp_path / "bare/Data_52__3_5__002.mat")
    return tmp_path / "bare"


def test_folder_manifest_and_saved_result_are_the_same_data(quick_data, tmp_path):
    wanted = read_manifest(quick_data / MANIFEST_NAME)
    names = (quick_data, quick_data / MANIFEST_NAME, _saved(tmp_path / "saved.json", quick_data))
    for name in names:
        assert manifest_of(name) == wanted
        assert manifest_of(name, **TOLD) == wanted


def test_a_log_is_what_the_manifest_beside_it_says(quick_data):
    whole = read_manifest(quick_data / MANIFEST_NAME)
    found = manifest_of(quick_data / whole.logs[3].file)
    assert found.logs == whole.logs[3:4]
    assert (found.input, found.arm) == (whole.input, whole.arm)


def test_what_no_manifest_says_is_what_was_told(bare_folder, tmp_path):
    log = bare_folder / "Data_52__3_5__002.mat"
    for name in (bare_folder, log, _saved(tmp_path / "saved.json", bare_folder)):
        found = manifest_of(name, **TOLD)
        (entry,) = found.logs
        assert (entry.added_mass, entry.omega, entry.amplitude) == (0.052, 3.5, 0.02)
        assert (found.arm, found.input, found.intersample) == tuple(TOLD.values())


def test_data_remember_how_they_were_named(quick_data):
    assert named_data(quick_data).source == str(quick_data)


def test_a_folder_without_manifest_and_arm_and_a_result_without_source_are_refused(
    bare_folder, tmp_path
):
    with pytest.raises(InputError, match="--arm"):
        manifest_of(bare_folder)
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(InputError, match=r"data\.source"):
        manifest_of(tmp_path / "other.json")
