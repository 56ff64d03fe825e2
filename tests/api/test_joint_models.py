"""One joint of the shipped arm, whose file has other values than the arm that made the logs."""

import math

import numpy as np
import pytest
import yaml

import butterfly as bf
from butterfly.api.joint_models import with_heavier_neighbours
from butterfly.errors import InputError
from butterfly.identification.estimators import OutputError
from butterfly.identification.forecast import forecast
from butterfly.identification.identify import identify as identify_data
from butterfly.identification.trust import FindingKind
from butterfly.logs.manifest import read_manifest
from butterfly.model.prior import Known
from butterfly.twin.joint_of_model import coupling
from tests.arm_logs import ARM, TRUTH, write_log, write_logs

OTHERS = ("pan", "shoulder", "wrist", "roll")
POSE = {"pan": 0.0, "shoulder": 0.3, "wrist": 0.4, "roll": 0.0}
TORQUE = {"model": ARM, "of": "elbow", "input": "torque"}
KNOWN = {"known": {"p4": 1.0}}


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """Two logs of the elbow, the others held, without their columns."""
    return write_logs(tmp_path_factory.mktemp("still"), "elbow", [POSE, POSE])


@pytest.fixture(scope="module")
def read_still(still):
    return bf.read(still, **TORQUE, **KNOWN, pose=POSE, clamped=True)


@pytest.fixture(scope="module")
def answer(read_still):
    return bf.identify(read_still)


def _rows(answer):
    return {row["attribute"]: row for row in answer.to_dict()["model"]}


def test_the_model_says_gravity_zero_and_kind_of_the_joint(read_still):
    manifest = read_still.manifest
    assert manifest.facts.joint == "elbow"
    assert manifest.gravity == pytest.approx(9.81)
    moment = 9.81 * math.hypot(0.3 * 0.135 + 0.4 * 0.18, 0.0)  # at least, whatever the wrist does
    assert manifest.facts.poses[0].moment > moment
    assert read_still.given.parameters["p3"].uncertainty == pytest.approx(
        0.05 * manifest.facts.poses[0].moment
    )
    assert manifest.logs[0].columns == {
        "time": "time",
        "input": "elbow_torque",
        "angle": "elbow_position",
    }


@pytest.mark.parametrize("attribute", TRUTH)
def test_the_attributes_of_the_joint_are_found_in_their_intervals(answer, attribute):
    row = _rows(answer)[attribute]
    assert row["lower"] <= TRUTH[attribute] <= row["upper"]
    assert row["upper"] - row["lower"] < 0.2 * TRUTH[attribute]


def test_clamped_joints_are_good_without_columns_and_the_first_line_says_so(answer):
    assert answer.standing == "good"
    assert answer.verdict[0].endswith("Clamped, as you say: pan, shoulder, wrist, roll.")


def test_joints_without_columns_that_nobody_says_are_clamped_are_at_best_use_with_care(still):
    answer = bf.identify(bf.read(still, **TORQUE, **KNOWN, pose=POSE))
    assert answer.standing == "use with care"
    assert "whether pan, shoulder, wrist, roll stood still" in answer.verdict[0]
    assert "--clamped" in answer.verdict[0]


def test_a_log_of_wrist_roll_alone_is_none_of_wrist(tmp_path):
    logs = write_logs(tmp_path, "elbow", [POSE])
    text = (logs / "0.csv").read_text().replace("elbow", "wrist_roll")
    (logs / "0.csv").write_text(text)
    model = tmp_path / "arm.xml"
    model.write_text(ARM.read_text().replace('"roll"', '"wrist_roll"'))
    asked = {"model": model, "input": "torque"}
    with pytest.raises(InputError, match="those of wrist_roll") as refused:
        bf.read(logs, **asked, of="wrist")
    assert refused.value.field == "columns"
    assert (
        bf.read(logs, **asked, of="wrist_roll")
        .manifest.logs[0]
        .columns["angle"]
        .startswith("wrist_roll")
    )


def test_the_answer_shows_the_file_beside_it(answer):
    (table,) = [table for table in answer.tables() if table.name == "model"]
    assert table.title == "Joint 'elbow' of arm.xml"
    assert [row[0] for row in table.rows] == ["armature", "damping", "frictionloss"]
    assert [row[2] for row in table.rows] == ["0.02", "0.08", "0.2"]
    assert {row[4] for row in table.rows} == {"the file differs"}


def test_a_saved_answer_knows_its_model_and_reads_its_logs_again(answer, tmp_path):
    answer.save(tmp_path / "elbow.json")
    loaded = bf.load(tmp_path / "elbow.json")
    assert loaded.to_dict()["model"] == answer.to_dict()["model"]
    for one, other in zip(loaded.data.logs, answer.data.logs, strict=True):
        assert np.array_equal(one.input, other.input)


def test_no_json_holds_the_place_of_the_model(answer):
    assert answer.to_dict()["data"]["manifest"]["model"] == "arm.xml"


def test_two_poses_set_the_scale_of_an_unknown_drive(tmp_path):
    poses = [POSE | {"wrist": 0.0}, POSE | {"wrist": 1.6}] * 2
    logs = write_logs(tmp_path / "poses", "elbow", poses, columns=OTHERS, gain=0.8)
    answer = bf.identify(bf.read(logs, **TORQUE))
    gain = answer.estimate.parameters.p4
    assert len(answer.data.masses) == 2
    assert [str(mass) for mass in answer.data.masses] == ["pose wrist 1.6", "pose wrist 0"]
    half = answer.estimate.farther[answer.estimate.names.index("p4")]
    assert abs(gain - 0.8) < half < 0.25
    row = _rows(answer)["armature"]
    assert row["lower"] <= TRUTH["armature"] <= row["upper"]


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    """A log in which motors move the other joints by about .1 rad, with their columns."""
    folder = tmp_path_factory.mktemp("moving")
    return write_logs(folder, "elbow", [POSE, POSE], columns=OTHERS, swing=0.15)


def test_the_torque_of_moving_neighbours_is_taken_off_the_drives(moving):
    answer = bf.identify(bf.read(moving, **TORQUE, **KNOWN))
    (said,) = [f for f in answer.estimate.findings if f.kind is FindingKind.NEIGHBOURS_CORRECTED]
    assert set(said.parameters) <= set(OTHERS)
    assert said.number > 0.05
    for attribute, row in _rows(answer).items():
        assert row["lower"] <= TRUTH[attribute] <= row["upper"], attribute


def test_the_forecast_is_made_without_the_torque_of_moving_neighbours(moving):
    inspected = bf.inspect(moving, **TORQUE, **KNOWN)
    rows = {row["name"]: row for row in inspected.content["before_fit"]}
    data = bf.read(moving, **TORQUE, **KNOWN)
    corrected = {row.name: row for row in forecast(data.logs, data.given)}
    for name in ("p1", "p3", "coulomb"):
        assert rows[name]["word"] == "identifiable"
        assert rows[name]["expected"] == pytest.approx(corrected[name].expected, rel=0.05)


def test_moving_neighbours_without_a_known_torque_are_at_best_for_use_with_care(moving):
    answer = bf.identify(bf.read(moving, **TORQUE))
    assert answer.standing != "good"
    kinds = {finding.kind for finding in answer.estimate.findings}
    assert FindingKind.NEIGHBOURS_MOVED in kinds


def test_a_manifest_has_the_model_the_joint_and_a_pose_per_log(still, tmp_path):
    path = tmp_path / "manifest.yaml"
    path.write_text(
        f"name: arm\nroot: {still}\ninput: torque\nmodel: {ARM}\nof: elbow\n"
        "pose: {shoulder: 0.3}\n"
        "link_masses: {uncertainty: 0.1, independent: true}\n"
        "logs: [{file: 0.csv, pose: {wrist: 0.4}}, {file: 1.csv, pose: {wrist: 0.4}}]\n"
    )
    data = bf.read(path)
    assert data.manifest.logs[0].pose == pytest.approx(POSE)
    moment = data.manifest.facts.poses[0].moment
    assert data.given.parameters["p3"] == Known(value=moment, uncertainty=0.1 * moment)
    assert read_manifest(path).facts is None


def test_manifests_of_a_model_that_differ_are_not_joined_without_it(still, tmp_path):
    for wrist in (0.4, 0.5):
        (tmp_path / f"{wrist}.yaml").write_text(
            f"name: arm\nroot: {still}\ninput: torque\nmodel: {ARM}\nof: elbow\n"
            f"pose: {{wrist: {wrist}}}\nlogs: [{{file: 0.csv}}]\n"
        )
    paths = sorted(tmp_path.glob("*.yaml"))
    for sources in (paths, [bf.read(path) for path in paths]):
        with pytest.raises(InputError, match=r"model.*one manifest with all logs.*pose"):
            bf.read(sources)
    assert len(bf.read([paths[0], paths[0]]).logs) == 2


@pytest.mark.parametrize(
    ("options", "field", "expected"),
    [
        ({"of": "elbo"}, "joint", "'elbow' (did you mean that?)"),
        ({"pose": {"rist": 0.1}}, "pose.rist", "wrist"),
        ({"model": None}, "of", "model as well"),
        ({"of": None}, "of", "the name of the joint in the model"),
        ({"gravity": 3.7}, "gravity", "9.81, as arm.xml has it"),
        ({"joint": "slide"}, "joint", "hinge, as arm.xml has it"),
    ],
)
def test_what_the_model_does_not_have_is_refused(still, options, field, expected):
    with pytest.raises(InputError) as refused:
        bf.read(still, **(TORQUE | options))
    assert refused.value.field == field
    assert expected in refused.value.expected


def test_a_model_that_does_not_compile_is_refused_with_mujocos_line(still, tmp_path):
    model = tmp_path / "bad.xml"
    model.write_text("<mujoco><worldbody><body><joint name='elbow'/></body></worldbody></mujoco>")
    with pytest.raises(InputError, match="mass and inertia of moving bodies") as refused:
        bf.read(still, **(TORQUE | {"model": model}))
    assert refused.value.field == "model"


def test_an_angle_beyond_the_joints_range_is_refused(tmp_path):
    write_log(tmp_path / "0.csv", "elbow", POSE, seconds=1.0)
    text = (tmp_path / "0.csv").read_text().splitlines()
    table = np.loadtxt(text[1:], delimiter=",")
    table[:, 2] += 3.0
    np.savetxt(tmp_path / "0.csv", table, delimiter=",", header=text[0], comments="")
    with pytest.raises(InputError, match=r"the range of 'elbow' in arm\.xml"):
        bf.read(tmp_path / "0.csv", **TORQUE)


def test_a_turned_sign_is_named_where_the_range_shows_it(tmp_path):
    text = ARM.read_text().replace('axis="0 1 0" range="-2.4 2.4"', 'axis="0 1 0" range="0.5 2.4"')
    model = tmp_path / "arm.xml"
    model.write_text(text)
    write_log(tmp_path / "0.csv", "elbow", POSE | {"shoulder": 0.0}, seconds=1.0)
    lines = (tmp_path / "0.csv").read_text().splitlines()
    table = np.loadtxt(lines[1:], delimiter=",")
    table[:, 2] *= -1
    np.savetxt(tmp_path / "0.csv", table, delimiter=",", header=lines[0], comments="")
    with pytest.raises(InputError, match="is its sign reversed"):
        bf.read(tmp_path / "0.csv", **(TORQUE | {"model": model}))


@pytest.mark.filterwarnings("ignore:.*(Ranges|Isaac Lab|Events)")
def test_its_ranges_are_the_intervals_of_the_model_s_attributes(answer, tmp_path):
    written = answer.model.export(tmp_path / "elbow.yaml", to="randomisation")
    ranges = {row["attribute"]: row for row in yaml.safe_load(written.text)["ranges"]}
    for attribute in TRUTH:
        row, told = ranges[attribute], _rows(answer)[attribute]
        assert (row["element"], row["name"]) == ("joint", "elbow")
        assert (row["lower"], row["upper"]) == pytest.approx((told["lower"], told["upper"]), 1e-4)
    text = answer.model.export(tmp_path / "elbow.py", to="randomisation").text
    assert '"elbow_armature": EventTermCfg(\n            func=dr.joint_armature' in text
    assert 'joint_names=("elbow",)' in text
    assert '"add"' not in text


def test_intervals_hold_what_heavier_links_would_have_taken_off(moving):
    data = bf.read(moving, **TORQUE, **KNOWN)
    plain, whole = identify_data(data), bf.identify(data)
    heavier = OutputError()(with_heavier_neighbours(data))
    for name in ("p1", "p2", "coulomb"):
        lower, upper = whole.estimate.limits_of(name, 0.0)
        assert lower <= heavier.named[name] <= upper
        assert upper - lower >= np.ptp(plain.estimate.limits_of(name, 0.0)) * (1 - 1e-9)


def test_the_torque_of_other_joints_is_worked_out_once_for_each_log(moving, monkeypatch):
    worked_out = []

    def counting(robot, driven, others, pose):
        worked_out.append(others)
        return coupling(robot, driven, others, pose)

    monkeypatch.setattr("butterfly.twin.joint_of_model.coupling", counting)
    data = bf.read(moving, **TORQUE, **KNOWN)
    bf.identify(data, "weak-form")
    assert len(worked_out) == len(data.logs)
    for log, recorded in zip(data.logs, data.recorded, strict=True):
        assert log.input + data.taken_off[log.name] == pytest.approx(recorded.input, abs=1e-12)


def test_logs_without_moving_neighbours_have_nothing_else_to_hold(read_still):
    assert with_heavier_neighbours(read_still) is None


@pytest.mark.parametrize(("ending", "factor"), [("position", 1.0), ("position_deg", math.pi / 180)])
def test_a_joint_that_is_called_like_a_unit_is_none(tmp_path, ending, factor):
    model = tmp_path / "arm.xml"
    model.write_text(ARM.read_text().replace('"elbow"', '"turn"'))
    write_log(tmp_path / "0.csv", "elbow", POSE, seconds=1.0)
    text = (tmp_path / "0.csv").read_text()
    header, rows = text.split("\n", 1)
    header = header.replace("elbow_position", f"turn_{ending}").replace("elbow", "turn")
    (tmp_path / "0.csv").write_text(f"{header}\n{rows}")
    data = bf.read(tmp_path / "0.csv", **(TORQUE | {"model": model, "of": "turn"}), pose=POSE)
    read = np.loadtxt(rows.splitlines(), delimiter=",")
    assert data.logs[0].angle == pytest.approx(factor * read[:, 2])
    assert data.logs[0].input == pytest.approx(read[:, 1])


def test_an_axis_that_a_files_digits_leave_nearly_vertical_has_no_gravity(tmp_path):
    model = tmp_path / "arm.xml"
    model.write_text(ARM.read_text().replace('axis="0 0 1"', 'axis="1e-6 0 1"'))
    others = {name: angle for name, angle in POSE.items() if name != "pan"}
    write_log(tmp_path / "0.csv", "pan", others, seconds=1.0)
    manifest = bf.read(tmp_path / "0.csv", **(TORQUE | {"model": model, "of": "pan"})).manifest
    assert manifest.gravity == 0.0
    assert manifest.facts.poses[0].moment == 0.0
