"""What was identified, written into the arm's own file: its text, its fields, its motion."""

import json
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import butterfly as bf
from butterfly.errors import InputError
from butterfly.twin.robot_text import Edit, with_attributes
from butterfly.twin.written_back import write_back
from tests.arm_logs import ARM, SERVO, TRUTH, write_logs, write_servo_log

POSE = {"pan": 0.0, "shoulder": 0.3, "wrist": 0.4, "roll": 0.0}


def _read(logs, model):
    """The logs of the elbow, as of this model."""
    about = {"of": "elbow", "pose": POSE, "input": "torque", "known": {"p4": 1.0}}
    return bf.read(logs, model=model, clamped=True, **about)


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    logs = write_logs(tmp_path_factory.mktemp("elbow"), "elbow", [POSE, POSE])
    return bf.identify(_read(logs, ARM))


@pytest.fixture(scope="module")
def written(answer, tmp_path_factory):
    path = tmp_path_factory.mktemp("out") / "arm_identified.xml"
    return path, answer.write_back(ARM, path)


def test_the_joint_has_what_was_identified(written):
    joint = mujoco.MjModel.from_xml_path(str(written[0])).joint("elbow")
    assert joint.armature[0] == pytest.approx(TRUTH["armature"], rel=0.02)
    assert np.ravel(joint.damping)[0] == pytest.approx(TRUTH["damping"], rel=0.02)
    assert joint.frictionloss[0] == pytest.approx(TRUTH["frictionloss"], rel=0.02)


def test_every_other_byte_stays(written):
    path, back = written
    before, after = ARM.read_text().splitlines(), path.read_text().splitlines()
    assert len(before) == len(after)
    changed = [k for k, pair in enumerate(zip(before, after, strict=True), 1) if len({*pair}) > 1]
    assert changed == sorted({change.line for change in back.changes})
    assert len(changed) == 1


def test_the_changes_name_file_line_element_and_values(written):
    changes = {change.attribute: change for change in written[1].changes}
    assert {*changes} == {
        *TRUTH,
        "solreffriction",
        "solimpfriction",
    }
    assert changes["armature"].element == "joint 'elbow'"
    assert changes["armature"].before is None  # its class says it, not the element
    assert any("armature: its default to" in line for line in written[1].sentences)
    assert float(changes["armature"].after) == pytest.approx(TRUTH["armature"], rel=0.02)
    assert 'name="elbow"' in ARM.read_text().splitlines()[changes["armature"].line - 1]


def test_the_written_model_follows_the_logs_as_the_answer_does(written):
    fits = written[1].fits
    assert {*fits} == {"elbow, 0.csv", "elbow, 1.csv"}
    for ours, theirs in fits.values():
        assert ours > 99
        assert theirs > ours - 0.5


def test_the_file_as_it_was_follows_them_less_well(answer, tmp_path):
    """So the figure says something."""
    path = tmp_path / "unchanged.xml"
    other = replace(answer.estimate, values=answer.estimate.values.copy())
    back = write_back([replace(answer, estimate=other)], ARM, path)
    path.write_text(ARM.read_text())
    from butterfly.twin.written_back import _fits  # noqa: PLC0415 - of that file

    assert min(theirs for _, theirs in _fits(answer, path).values()) < 97
    assert min(theirs for _, theirs in back.fits.values()) > 98


def test_an_attribute_that_the_file_has_right_stays(answer, tmp_path):
    near = tmp_path / "near.xml"
    value = answer.to_dict()["model"][0]["value"]
    with_attributes(ARM, [Edit("joint", "elbow", {"armature": f"{value}"})]).write(near)
    data = _read(answer.data.manifest.root, near)
    back = bf.identify(data).write_back(near, tmp_path / "out.xml")
    assert "armature" not in {change.attribute for change in back.changes}
    assert any("armature stays" in note for note in back.notes)


def test_the_original_is_never_written(answer):
    with pytest.raises(InputError, match="another path"):
        answer.write_back(ARM, ARM, overwrite=True)


def test_two_results_of_one_joint_are_refused(answer, tmp_path):
    with pytest.raises(InputError, match="each joint once"):
        answer.write_back(ARM, tmp_path / "arm.xml", others=[answer])


def test_a_result_without_a_model_is_refused(answer, tmp_path):
    manifest = answer.origin["manifest"] | {"facts": None}
    other = replace(answer, origin=answer.origin | {"manifest": manifest})
    with pytest.raises(InputError, match=r"--model robot\.xml --of JOINT"):
        other.write_back(ARM, tmp_path / "arm.xml")


def test_a_file_without_the_joint_is_refused(answer, tmp_path):
    other = tmp_path / "leg.xml"
    other.write_text(ARM.read_text().replace('"elbow"', '"knee"'))
    with pytest.raises(InputError, match="'knee'"):
        answer.write_back(other, tmp_path / "out.xml")


def test_links_of_another_weight_are_said(answer, tmp_path):
    heavy = tmp_path / "heavy.xml"
    heavy.write_text(ARM.read_text().replace('mass="0.3" dia', 'mass="0.34" dia'))
    data = _read(answer.data.manifest.root, heavy)
    notes = bf.identify(data).write_back(heavy, tmp_path / "out.xml").notes
    assert any("% less than that of the file's links" in note for note in notes)


def test_the_command_writes_what_the_method_does(answer, tmp_path, butterfly):
    answer.save(tmp_path / "elbow.json")
    out = tmp_path / "arm_identified.xml"
    code, printed, _ = butterfly("export", tmp_path / "elbow.json", "--into", ARM, "--out", out)
    assert code == 0
    assert re.match(rf"{out}: 5 attributes .*\. Ready to use\.\nGood: ", printed)
    assert "the written model has a median FIT of 99" in " ".join(printed.split())
    assert mujoco.MjModel.from_xml_path(str(out)).joint("elbow").armature[0] > 0.025
    assert json.loads((tmp_path / "elbow.json").read_text())["data"]["manifest"]["of"] == "elbow"


SERVO_POSE = {"pan": 0.0, "shoulder": 0.3, "elbow": 0.5, "roll": 0.0}


@pytest.fixture(scope="module")
def servo(tmp_path_factory):
    """The wrist, whose position actuator follows set-points; its gains are guesses."""
    logs = tmp_path_factory.mktemp("servo")
    for k in range(2):
        write_servo_log(logs / f"{k}.csv", SERVO_POSE, seed=k)
    gains = {name: {"value": value, "uncertainty": value} for name, value in _GUESSED.items()}
    loop = {"law": "pid-torque", "limit": SERVO["forcerange"], "clock": 5e-4, **gains}
    about = {"of": "wrist", "pose": SERVO_POSE, "clamped": True, "known": {"p4": 1.0}}
    return bf.identify(bf.read(logs, model=ARM, input="setpoint", loop=loop, **about))


_GUESSED = {"kp": 20.0, "kd": 0.4}


@pytest.fixture(scope="module")
def written_servo(servo, tmp_path_factory):
    path = tmp_path_factory.mktemp("out") / "arm.xml"
    return path, servo.write_back(ARM, path)


def test_gains_of_a_servo_are_found_and_written_into_its_actuator(servo, written_servo):
    path, back = written_servo
    rows = {row["attribute"]: row for row in servo.to_dict()["model"]}
    for name in ("kp", "kv"):
        # the law holds its output for .5 ms, which MuJoCo's actuator does not
        assert rows[name]["value"] == pytest.approx(SERVO[name], rel=0.01)
        assert rows[name]["upper"] - rows[name]["lower"] < 0.05 * SERVO[name]
    actuator = mujoco.MjModel.from_xml_path(str(path)).actuator("wrist")
    assert actuator.gainprm[0] == pytest.approx(SERVO["kp"], rel=0.01)
    assert actuator.biasprm[2] == pytest.approx(-SERVO["kv"], rel=0.03)
    assert actuator.forcerange == pytest.approx([-SERVO["forcerange"], SERVO["forcerange"]])
    assert not any("loop_k" in note for note in back.notes)


def test_the_written_servo_follows_its_set_points_as_the_answer_does(written_servo):
    for ours, theirs in written_servo[1].fits.values():
        assert ours > 99
        assert theirs > ours - 0.5


def test_set_points_are_not_played_in_a_file_without_a_position_actuator(servo, tmp_path):
    facts = servo.origin["manifest"]["facts"] | {"actuators": []}
    origin = servo.origin | {"manifest": servo.origin["manifest"] | {"facts": facts}}
    back = replace(servo, origin=origin).write_back(ARM, tmp_path / "out.xml")
    assert not back.fits
    assert any("has no position actuator" in note for note in back.notes)
