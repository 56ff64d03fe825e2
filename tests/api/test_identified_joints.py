"""Several joints of the shipped arm, from logs with columns of all of them."""

from pathlib import Path

import pytest

import butterfly as bf
from butterfly.api import joint_models
from butterfly.api.sources import manifest_of
from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from butterfly.twin.joint_of_model import alike_joints, compiled
from tests.arm_logs import ARM, TRUTH, write_log

NAMES = ("pan", "shoulder", "elbow", "wrist", "roll")
POSE = {"pan": 0.0, "shoulder": 0.9, "elbow": 0.3, "wrist": 0.4, "roll": 0.0}
TORQUE = {"model": ARM, "description": {"input": "torque", "known": {"p4": 1.0}}}


def _write(folder, joint, name="", seed=0):
    pose = {other: angle for other, angle in POSE.items() if other != joint}
    force = 0.2 if joint == "wrist" else 0.6
    path = folder / f"{name or joint}.csv"
    write_log(path, joint, pose, seed=seed, columns=[*pose], force=force)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    _write(folder, "elbow")
    _write(folder, "wrist")
    return folder


@pytest.fixture(scope="module")
def answer(logs):
    return bf.identify_joints(logs, **TORQUE)


def test_each_joint_with_a_command_of_its_own_is_identified(answer):
    assert {*answer.identifications} == {"elbow", "wrist"}
    for identification in answer.identifications.values():
        (row,) = [
            row for row in identification.to_dict()["model"] if row["attribute"] == "armature"
        ]
        assert row["lower"] <= TRUTH["armature"] <= row["upper"]


def test_the_answer_begins_with_how_many_are_known_and_has_a_row_each(answer):
    assert answer.summary[0] == "Joints of arm.xml: 2 good."
    assert [row["joint"] for row in answer.rows()] == ["elbow", "wrist"]
    first, *_ = answer.tables()
    assert first.headers[:3] == ["joint", "verdict", "armature"]
    assert [row[1] for row in first.rows] == ["good", "good"]
    assert answer._repr_html_().count('<span class="chip good">good</span>') == 2


def test_a_saved_answer_is_loaded_with_its_table(answer, tmp_path):
    answer.save(tmp_path / "joints.json")
    loaded = bf.load(tmp_path / "joints.json")
    assert loaded.rows() == answer.rows()
    assert loaded.summary == answer.summary
    loaded.report(tmp_path / "joints.html")
    assert "frictionloss" in (tmp_path / "joints.html").read_text()


def test_joints_may_be_chosen(logs):
    assert {*bf.identify_joints(logs, of=["wrist"], **TORQUE).identifications} == {"wrist"}


def test_a_joint_that_cannot_be_identified_leads_and_says_why(logs, tmp_path):
    for path in logs.iterdir():
        (tmp_path / path.name).write_text(path.read_text())
    _write(tmp_path, "shoulder")
    header, *lines = (tmp_path / "shoulder.csv").read_text().splitlines()
    turned = [line.split(",") for line in lines]
    rows = [",".join([a, b, str(float(c) + 5.0), *rest]) for a, b, c, *rest in turned]
    (tmp_path / "shoulder.csv").write_text("\n".join([header, *rows]))
    answer = bf.identify_joints(tmp_path, **TORQUE)
    assert answer.rows()[0]["joint"] == "shoulder"
    assert answer.rows()[0]["verdict"] == "no answer"
    assert answer.summary[0].endswith("1 without an answer.")
    assert any("the range of 'shoulder'" in line for line in answer.summary)


def test_a_manifest_says_which_log_is_of_which_joint(logs, tmp_path):
    path = tmp_path / "manifest.yaml"
    entries = ", ".join(
        f"{{file: {joint}.csv, of: {joint}, "
        f"columns: {{time: time, input: {joint}_torque, angle: {joint}_position}}}}"
        for joint in ("elbow", "wrist")
    )
    path.write_text(
        f"name: arm\nroot: {logs}\ninput: torque\nknown: {{p4: 1}}\nmodel: {ARM}\n"
        f"logs: [{entries}]\n"
    )
    answer = bf.identify_joints(path, model=ARM)
    assert {*answer.identifications} == {"elbow", "wrist"}
    assert [entry.file for entry in bf.read(path, of="wrist").manifest.logs] == ["wrist.csv"]
    with pytest.raises(InputError, match="the name of the joint in the model, or all") as refused:
        bf.read(path)
    assert refused.value.value == "elbow, wrist"


@pytest.mark.parametrize(
    ("of", "field", "expected"),
    [
        (["elbo"], "joint", "'elbow'"),
        (["shoulder"], "of", "columns named after shoulder"),
    ],
)
def test_joints_without_logs_are_refused(logs, of, field, expected):
    with pytest.raises(InputError) as refused:
        bf.identify_joints(logs, of=of, **TORQUE)
    assert refused.value.field == field
    assert expected in refused.value.expected


def test_logs_without_names_of_joints_are_refused(tmp_path):
    (tmp_path / "log.csv").write_text("time,input,angle\n0,0,0\n1,0,0\n2,0,0\n")
    with pytest.raises(InputError, match="columns named after one of pan, shoulder"):
        bf.identify_joints(tmp_path, **TORQUE)


def test_the_command_saves_each_joint_and_says_how_to_write_them_back(logs, tmp_path, butterfly):
    options = ("--model", ARM, "--of", "all", "--input", "torque", "--known", "p4=1")
    code, out, _ = butterfly("identify", logs, *options, "--save", tmp_path / "arm.json")
    assert code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"arm_elbow.json", "arm_wrist.json"}
    assert "--into" in out
    files = sorted(tmp_path.glob("*.json"))
    code, out, _ = butterfly("export", *files, "--into", ARM, "--out", tmp_path / "out.xml")
    assert code == 0
    assert "joint 'elbow'" in out
    assert "joint 'wrist'" in out


@pytest.fixture(scope="module")
def commands_of_all(logs, tmp_path_factory):
    """The same logs with a command of each joint, as a robot writes that holds the others."""
    folder = tmp_path_factory.mktemp("commands")
    for path in logs.iterdir():
        header, *lines = path.read_text().splitlines()
        held = [name for name in NAMES if f"{name}_torque" not in header]
        head = ",".join([header, *(f"{name}_torque" for name in held)])
        rows = [f"{line}{',0.1' * len(held)}" for line in lines]
        (folder / path.name).write_text("\n".join([head.replace("time", "timestamp"), *rows]))
    return folder


def test_a_log_with_commands_of_all_joints_is_of_the_one_that_moves(commands_of_all):
    again = bf.identify_joints(commands_of_all, **TORQUE)
    assert again.summary[0] == "Joints of arm.xml: 2 good."
    used = {n: [log.name for log in one.data.logs] for n, one in again.identifications.items()}
    assert used == {"elbow": ["elbow.csv"], "wrist": ["wrist.csv"]}
    with pytest.raises(InputError, match="a log in which it moves"):
        bf.read(commands_of_all, model=ARM, of="pan", input="torque")


def test_each_joint_s_motion_in_a_log_is_read_once_to_find_whose_it_is(
    commands_of_all, monkeypatch
):
    read = []

    def counting(path, **options):
        read.append((path.name, options["columns"]["angle"]))
        return read_log(path, **options)

    monkeypatch.setattr(joint_models, "read_log", counting)
    manifest = manifest_of(commands_of_all, model=ARM, input="torque")
    model = compiled(Path(ARM))[1]
    alike = {joint: alike_joints(model, joint) for joint in NAMES}
    logs = joint_models.logs_of_joints(manifest, alike)
    assert {joint: [entry.file for entry in of] for joint, of in logs.items() if of} == {
        "elbow": ["elbow.csv"],
        "wrist": ["wrist.csv"],
    }
    assert sorted(read) == sorted({*read})
    assert len(read) == len(NAMES) * len(manifest.logs)


def test_a_draft_of_logs_of_a_model_says_the_joint_of_each(commands_of_all, butterfly, tmp_path):
    for path in commands_of_all.iterdir():
        (tmp_path / path.name).write_text(path.read_text())
    code, out, _ = butterfly("manifest", tmp_path, "--model", ARM, "--known", "p4=1")
    assert code == 0
    assert "torque by the name of 'elbow_torque'" in out
    assert "added_mass" not in out
    logs = bf.read(tmp_path, of="wrist")
    assert [(entry.file, entry.of) for entry in logs.manifest.logs] == [("wrist.csv", "wrist")]
    code, out, _ = butterfly("inspect", tmp_path, "--of", "elbow")
    assert code == 0
    assert "p4 known" in out
    code, _, err = butterfly("inspect", tmp_path)
    assert code == 2
    assert "one joint at a time, such as --of elbow" in err
