"""Whatever a user names as data takes the same options, or is refused with what was expected."""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from butterfly.api.sources import manifest_of, read
from butterfly.errors import InputError
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep import run_sweep
from butterfly.logs.log import InputKind
from butterfly.logs.mat import write_mat
from butterfly.model.prior import Known
from tests.experiment.setting import HereEngine, small_plan

THESIS = "Data_52__5__02.mat"


def _names(source, **about):
    return [log.name for log in read(source, **about).logs]


def _saved(path, folder, **changes):
    """Write what a saved identification knows of its data."""
    manifest = manifest_of(folder).model_copy(update=changes)
    path.write_text(json.dumps({"data": {"manifest": manifest.model_dump(mode="json")}}))
    return path


def test_a_manifest_its_folder_and_what_was_identified_from_it_are_the_same_data(
    quick_data, tmp_path
):
    expected = _names(quick_data)
    assert len(expected) == 9
    saved = _saved(tmp_path / "result.json", quick_data)
    gone = _saved(tmp_path / "gone.json", quick_data, root="gone")
    for source in (quick_data / "manifest.yaml", saved):
        assert _names(source) == expected
    with pytest.raises(InputError, match=r"data\.manifest\.root: got .*gone"):
        read(gone)


def test_a_log_is_described_by_the_manifest_beside_it(quick_data):
    data = read(quick_data / "manifest.yaml")
    for log in (data.logs[0], data.logs[-1]):
        (one,) = read(quick_data / log.name).logs
        assert (one.name, one.added_mass) == (log.name, log.added_mass)
        assert one.excitation == log.excitation
        np.testing.assert_array_equal(one.angle, log.angle)


def test_a_log_alone_is_described_by_its_name_and_by_the_user(sine_log, tmp_path):
    path = tmp_path / THESIS
    write_mat(sine_log, path)
    (bare,) = read(path).logs
    assert (bare.added_mass.mass, bare.excitation.omega) == (0.0, 5.0)
    (told,) = read(path, arm=0.1, input_kind=InputKind.TORQUE).logs
    assert (told.added_mass.mass, told.added_mass.arm) == (0.052, 0.1)
    assert told.input_kind is InputKind.TORQUE
    other = tmp_path / "other.mat"
    write_mat(sine_log, other)
    (plain,) = read(other).logs
    assert plain.excitation is None


def test_a_log_that_the_manifest_beside_it_does_not_list_is_a_log_alone(
    quick_data, sine_log, tmp_path
):
    shutil.copy(quick_data / "manifest.yaml", tmp_path)
    for entry in manifest_of(quick_data).logs:
        (tmp_path / entry.file).touch()
    write_mat(sine_log, tmp_path / THESIS)
    assert _names(tmp_path / THESIS) == [THESIS]


def test_a_sweep_s_results_lead_to_the_logs_of_a_run(tmp_path):
    plan = small_plan(tmp_path, keep_signals=True, sweep={"repetitions": 1})
    run_sweep(plan, tmp_path / "kept", HereEngine())
    logs = ResultStore(tmp_path / "kept").files_path(plan.tasks[0].key)
    with pytest.raises(InputError, match=f"one run's logs, such as {logs}"):
        read(tmp_path / "kept")
    assert len(read(logs).logs) == 2


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"data": 1}', '{"data": {"manifest": null}}', '{"data": {"manifest": 3}}'],
)
def test_a_json_that_leads_nowhere_is_refused(tmp_path, text):
    path = tmp_path / "r.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"data\.manifest"):
        read(path)


def test_what_is_no_data_is_told_apart(tmp_path):
    with pytest.raises(InputError, match="got an experiment; expected logs; `butterfly run"):
        read(Path("quickstart"))
    (tmp_path / "a.xls").write_text("1 2 3")
    with pytest.raises(InputError, match=r"file name: got \.xls; expected \.mat"):
        read(tmp_path / "a.xls")
    for source in (f"{tmp_path}/*.csv", "", [], tmp_path / "nowhere.csv"):
        with pytest.raises(InputError):
            read(source)


def test_what_is_told_of_columns_units_and_repairs_goes_before_what_a_manifest_says(
    quick_data, tmp_path
):
    folder = shutil.copytree(quick_data, tmp_path / "data")
    told = yaml.safe_load((folder / "manifest.yaml").read_text())
    assert told["units"] == {"input": "V"}
    told["units"] |= {"time": "ms", "angle": "deg"}
    (folder / "manifest.yaml").write_text(yaml.safe_dump(told))
    manifest = manifest_of(folder, units={"angle": "-rad"}, repair=["unwrap"], columns={"time": 0})
    assert manifest.units == {"input": "V", "time": "ms", "angle": "-rad"}
    assert manifest.repair == {"duplicate", "unwrap"}
    assert manifest.columns == {"time": 0}
    one = manifest_of(folder / manifest.logs[0].file, units={"angle": "rad"})
    assert (one.units["time"], one.units["angle"]) == ("ms", "rad")
    assert len(one.logs) == 1
    with pytest.raises(InputError, match=r"data: units\.angle: got dge"):
        manifest_of(folder, units={"angle": "dge"})


OTHERS = {"columns": {"time": "t", "input": "u", "angle": "q"}, "units": {"time": "ms"}}
GIVEN = OTHERS | {"input_kind": "torque", "intersample": "first_order_hold", "joint": "slide"}
GIVEN |= {"known": {"p4": (0.5, 0.01)}, "zero": (0.1, 0.02), "sign": -1, "repair": ["unwrap"]}


RAMP = np.arange(400.0)
TABLE = {"t": 10 * RAMP, "u": np.sin(RAMP / 7), "q": 0.2 * np.cos(RAMP / 7)}


@pytest.fixture
def tables(tmp_path):
    """A folder of two logs of columns t, u, q, in ms."""
    rows = np.column_stack(list(TABLE.values()))
    for name in ("a.csv", "b.csv"):
        np.savetxt(tmp_path / name, rows, delimiter=",", header="t,u,q", comments="")
    return tmp_path


def _sources(folder):
    """All ways to name the two logs."""
    manifest = folder / "elsewhere/m.yaml"
    manifest.parent.mkdir()
    entries = "[{file: a.csv}, {file: b.csv}]"
    manifest.write_text(f"name: x\nroot: ..\ninput: torque\nlogs: {entries}\n")
    files = [folder / "a.csv", str(folder / "b.csv")]
    ways = {"folder": folder, "files": files, "glob": f"{folder}/*.csv", "manifest": manifest}
    return ways | {"file and table": [files[0], TABLE], "tables": [TABLE, TABLE]}


@pytest.mark.parametrize("way", ["folder", "files", "glob", "manifest", "file and table", "tables"])
def test_every_source_takes_the_same_description(tables, way):
    source = _sources(tables)[way]
    data = read(source, **GIVEN)
    assert len(data.logs) == 2
    assert (data.input_kind, data.joint) == ("torque", "slide")
    assert data.given.to_dict()["p4"] == {"value": 0.5, "uncertainty": 0.01}
    for log in data.logs:
        np.testing.assert_allclose(log.time, RAMP / 100)
        np.testing.assert_allclose(log.input, -TABLE["u"])
        assert log.zero == Known(value=0.1, uncertainty=0.02)
        assert log.intersample == "first_order_hold"
    if "table" not in way:
        held = read(source, **OTHERS, holdout=["b"])
        assert ([log.name for log in held.logs], len(held.test_logs.logs)) == (["a.csv"], 1)
        assert data.manifest.repair == {"duplicate", "unwrap"}


def test_pieces_are_of_each_log_of_files_and_tables(tables):
    sources = _sources(tables)
    for source in (sources["files"], sources["file and table"], sources["tables"][0]):
        for log in read(source, **OTHERS, piece=(0.5, 2.0)).logs:
            assert (log.time[0], log.time[-1]) == (0.5, 2.0)
            assert log.lead is not None


def test_several_files_are_remembered_by_one_manifest(tables):
    (tables / "sub").mkdir()
    shutil.move(tables / "b.csv", tables / "sub/b.csv")
    data = read([tables / "a.csv", tables / "sub/b.csv"], **OTHERS, name="two")
    assert (data.name, data.manifest.root) == ("two", str(tables))
    assert [log.name for log in data.logs] == ["a.csv", "sub/b.csv"]
    saved = tables / "r.json"
    saved.write_text(json.dumps({"data": {"manifest": data.manifest.model_dump(mode="json")}}))
    assert _names(saved) == ["a.csv", "sub/b.csv"]


def test_a_log_of_a_manifest_is_used_even_if_its_neighbours_are_held_out(quick_data, tmp_path):
    folder = shutil.copytree(quick_data, tmp_path / "data")
    text = (folder / "manifest.yaml").read_text()
    (folder / "manifest.yaml").write_text(text + "holdout: [run001*]\n")
    first, second, *_ = (entry.file for entry in manifest_of(folder).logs)
    assert _names(folder / first) == [first]
    assert _names([folder / first, folder / second]) == [first, second]
    assert read(folder).test_logs is not None
    assert len(read(folder, holdout=["run000*"]).test_logs.logs) == 2


SLIPS = {"input_kind": ["force"], "intersample": ["third"], "joint": ["ball"], "gravity": [-1.0]}
SLIPS |= {"sign": [2], "arm": ["long", -0.1, float("nan")], "columns": [3, "time=t"], "zero": ["x"]}
SLIPS |= {"units": [{"angle": ["deg"]}, {"angel": "deg"}], "known": [{"p9": 1.0}, {"p4": "x"}]}
SLIPS |= {"repair": [["turn"]], "holdout": [[3], ["nobody"]], "colums": [{"time": 0}]}
SLIPS |= {"piece": [(3.0, 2.0), (1.0,), (1, 2, 3), 3.0]}


@pytest.mark.parametrize(("field", "value"), [(k, v) for k, own in SLIPS.items() for v in own])
def test_a_slip_in_a_description_is_named_with_field_value_and_expectation(tables, field, value):
    name = {"input_kind": "input", "piece": "from" if value == (3.0, 2.0) else "piece"}
    for source in (tables / "a.csv", TABLE):
        with pytest.raises(InputError) as caught:
            read(source, **OTHERS | {field: value})
        assert caught.value.field.startswith(name.get(field, field))
        assert caught.value.expected


def test_what_a_manifest_says_of_input_hold_and_arm_goes_before_options(tables):
    path = tables / "manifest.yaml"
    entries = "[{file: a.csv, added_mass: 0.05}]"
    path.write_text(f"name: x\ninput: torque\narm: 0.1\nlogs: {entries}\n")
    manifest = manifest_of(tables, arm=0.2, input_kind="voltage", intersample="first_order_hold")
    assert (manifest.arm, manifest.input) == (0.1, "torque")
    assert manifest.intersample == "first_order_hold"  # of which it says nothing
    path.write_text(f"name: x\ninput: torque\nlogs: {entries}\n")
    assert manifest_of(tables, arm=0.2).arm == 0.2
    with pytest.raises(InputError, match=r"arm in m, since a\.csv has an added mass"):
        manifest_of(tables)


def test_what_only_unread_logs_take_is_refused_beside_logs_that_are_read(tables):
    data = read([tables / "a.csv", tables / "b.csv"], **OTHERS)
    one = data.recorded[0]
    for source in (data, one, [one], [one, data.recorded[1]], [data, one]):
        with pytest.raises(InputError) as caught:
            read(source, units={"angle": "deg"})
        assert caught.value.field == "units"
        assert read(source, name="mine", known={"p4": 2.0}).name == "mine"


FORMS = [TABLE, pd.DataFrame(TABLE), np.rec.fromarrays(list(TABLE.values()), names=list(TABLE))]


@pytest.mark.parametrize("table", FORMS, ids=["mapping", "frame", "named columns"])
def test_tables_are_read_by_the_names_of_their_columns(table):
    units = {"time": "ms", "angle": "deg"}
    data = read(table, columns=OTHERS["columns"], units=units, input_kind="torque")
    (log,) = data.logs
    assert data.input_kind == "torque"
    np.testing.assert_allclose(log.time, RAMP / 100)
    np.testing.assert_array_equal(log.input, TABLE["u"])
    np.testing.assert_allclose(log.angle, np.radians(TABLE["q"]))
    with pytest.raises(InputError, match="table: time: got no such column"):
        read(table)


def test_a_plain_array_has_the_columns_of_a_matrix_or_those_that_are_told():
    array = np.column_stack([RAMP, TABLE["u"], TABLE["q"], RAMP])
    (log,) = read(array).logs
    np.testing.assert_array_equal(log.angle, TABLE["q"])
    np.testing.assert_array_equal(log.velocity, RAMP)
    (other,) = read(array, columns={"time": 3, "input": 1, "angle": 2}).logs
    assert other.velocity is None
    with pytest.raises(InputError, match=r"an array of shape \(400,\)"):
        read(RAMP)


def test_what_only_files_have_is_refused_for_a_table():
    with pytest.raises(InputError, match=r"arm: got 0\.1; expected no such option with a table"):
        read(TABLE, **OTHERS, arm=0.1)


def test_repairs_are_allowed_by_name():
    wrapped = {**TABLE, "q": (0.3 * RAMP) % (2 * np.pi)}
    with pytest.raises(InputError, match="--repair unwrap"):
        read(wrapped, **OTHERS)
    data = read(wrapped, **OTHERS, repair=["unwrap"])
    np.testing.assert_allclose(data.logs[0].angle, 0.3 * RAMP)
    log = data.recorded[0]
    assert read(log, repair=["unwrap"]).health[0].wraps > 1
    assert read([log, log], repair=["unwrap"]).health[1].wraps > 1
    with pytest.raises(InputError, match=r"repair.*got 'turn'; expected 'duplicate'"):
        read(log, repair=["turn"])
    with pytest.raises(InputError, match="repair: got 'unwrap'; expected a list"):
        read(log, repair="unwrap")
    with pytest.raises(InputError, match="no repair: these logs are already read"):
        read(data, repair=["unwrap"])
