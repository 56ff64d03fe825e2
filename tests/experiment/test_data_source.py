"""Whatever a user names as data is found, or refused with what was expected."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.experiment.data_source import manifest_of, named_data
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep_runner import run_sweep
from butterfly.logs.log import InputKind
from butterfly.logs.mat import write_mat
from tests.experiment.setting import HereEngine, small_plan

THESIS = "Data_52__5__02.mat"


def _names(source, **about):
    return [log.name for log in named_data(source, **about).logs]


def _saved(path, folder, **changes):
    """Write what a saved identification knows of its data."""
    manifest = manifest_of(folder).model_copy(update=changes)
    path.write_text(json.dumps({"data": {"manifest": manifest.model_dump(mode="json")}}))
    return path


def test_a_manifest_its_folder_and_what_was_identified_from_it_are_the_same_data(
    quick_data, tmp_path
):
    saved = _saved(tmp_path / "result.json", quick_data)
    expected = _names(quick_data)
    assert len(expected) == 12
    for source in (quick_data / "manifest.yaml", saved):
        assert _names(source) == expected


def test_a_result_finds_its_logs_beside_it_wherever_both_are_moved(quick_data, tmp_path):
    shutil.copytree(quick_data, tmp_path / "there/logs")
    saved = _saved(tmp_path / "there/result.json", quick_data, root="logs")
    assert _names(saved) == _names(quick_data)


def test_a_log_is_described_by_the_manifest_beside_it(quick_data):
    data = named_data(quick_data / "manifest.yaml")
    for log in (data.logs[0], data.logs[-1]):
        (one,) = named_data(quick_data / log.name).logs
        assert (one.name, one.added_mass, one.excitation) == (
            log.name,
            log.added_mass,
            log.excitation,
        )
        np.testing.assert_array_equal(one.angle, log.angle)


def test_a_log_alone_is_described_by_its_name_and_by_the_user(sine_log, tmp_path):
    path = tmp_path / THESIS
    write_mat(sine_log, path)
    (bare,) = named_data(path).logs
    assert (bare.added_mass.mass, bare.excitation.omega) == (0.0, 5.0)
    (told,) = named_data(path, arm=0.1, input_kind=InputKind.TORQUE).logs
    assert (told.added_mass.mass, told.added_mass.arm) == (0.052, 0.1)
    assert told.input_kind is InputKind.TORQUE
    other = tmp_path / "other.mat"
    write_mat(sine_log, other)
    (plain,) = named_data(other).logs
    assert plain.excitation is None


def test_a_log_that_the_manifest_beside_it_does_not_list_is_a_log_alone(
    quick_data, sine_log, tmp_path
):
    shutil.copy(quick_data / "manifest.yaml", tmp_path)
    for entry in manifest_of(quick_data).logs:
        (tmp_path / entry.file).touch()
    write_mat(sine_log, tmp_path / THESIS)
    assert _names(tmp_path / THESIS) == [THESIS]


def test_a_folder_of_logs_needs_an_arm(sine_log, tmp_path):
    write_mat(sine_log, tmp_path / THESIS)
    with pytest.raises(InputError, match="a manifest, or --arm"):
        named_data(tmp_path)
    assert _names(tmp_path, arm=0.1) == [THESIS]


def test_a_sweep_s_results_lead_to_the_logs_of_a_run(folder):
    plan = small_plan(folder, keep_signals=True, sweep={"repetitions": 1})
    run_sweep(plan, folder / "kept", HereEngine())
    logs = ResultStore(folder / "kept").files_path(plan.tasks[0].key)
    with pytest.raises(InputError, match=f"the logs of one run, as {logs}"):
        named_data(folder / "kept")
    assert len(named_data(logs).logs) == 2


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"data": 1}', '{"data": {"manifest": null}}', '{"data": {"manifest": 3}}'],
)
def test_a_json_that_leads_nowhere_is_refused(tmp_path, text):
    path = tmp_path / "r.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"data\.manifest"):
        named_data(path)


def test_logs_that_are_gone_are_asked_for(quick_data, tmp_path):
    saved = _saved(tmp_path / "r.json", quick_data, root="gone")
    with pytest.raises(InputError, match=r"data\.manifest\.root: got .*gone"):
        named_data(saved)
    assert _names(saved, root=quick_data) == _names(quick_data)


def test_a_file_of_another_ending_is_no_data(tmp_path):
    (tmp_path / "a.xls").write_text("1 2 3")
    with pytest.raises(InputError, match=r"file name: got \.xls; expected \.mat"):
        named_data(tmp_path / "a.xls")


def test_an_experiment_is_no_data_and_says_so():
    with pytest.raises(InputError, match="got an experiment; expected data, as `butterfly run"):
        named_data(Path("quickstart"))


@pytest.mark.parametrize("arm", [-0.1, float("nan"), "x"])
def test_an_arm_that_is_none_is_refused(sine_log, tmp_path, arm):
    write_mat(sine_log, tmp_path / THESIS)
    for source in (tmp_path, tmp_path / THESIS):
        with pytest.raises(InputError, match="arm: got"):
            named_data(source, arm=arm)
    with pytest.raises(InputError, match="columns: got"):
        named_data(tmp_path / THESIS, columns="time=t")


def test_what_is_told_of_columns_units_and_repairs_goes_before_what_a_manifest_says(
    quick_data, tmp_path
):
    folder = shutil.copytree(quick_data, tmp_path / "data")
    text = (folder / "manifest.yaml").read_text()
    (folder / "manifest.yaml").write_text(text + "units: {time: ms, angle: deg}\n")
    manifest = manifest_of(folder, units={"angle": "-rad"}, repair=["unwrap"], columns={"time": 0})
    assert manifest.units == {"time": "ms", "angle": "-rad"}
    assert manifest.repair == {"duplicate", "unwrap"}
    assert manifest.columns == {"time": 0}
    one = manifest_of(folder / manifest.logs[0].file, units={"angle": "rad"})
    assert (one.units["time"], one.units["angle"]) == ("ms", "rad")
    assert len(one.logs) == 1
    with pytest.raises(InputError, match=r"data: units\.angle: got dge"):
        manifest_of(folder, units={"angle": "dge"})
