"""Pages of docs/ on logs that are not shipped, or that take minutes, show what the program says."""

import os
import re
import shutil
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import yaml

import butterfly as bf
from butterfly.logs.manifest import read_manifest
from butterfly.report.summary import loop_table

CHECKOUT = Path(__file__).parents[2]
OTHERS, SERVO, TORQUE = (
    (CHECKOUT / f"docs/{name}.md").read_text(encoding="utf-8")
    for name in ("others-logs", "servo", "torque-joint")
)
NEAR = 2.0  # per cent of FIT, within which a page is not out of date


@pytest.fixture
def strangers(tmp_path, monkeypatch):
    """Puts the logs of a robot into a folder where the program then runs."""

    def copied(robot, name):
        shared = CHECKOUT.parent / "shared/data/strangers"
        source = Path(os.environ.get("BUTTERFLY_STRANGERS") or shared) / robot
        if not source.is_dir():
            pytest.skip(f"logs are not there: no folder {source} (BUTTERFLY_STRANGERS)")
        folder = tmp_path / name
        folder.mkdir()
        for path in source.glob("*.csv"):
            shutil.copyfile(path, folder / path.name)
        monkeypatch.chdir(tmp_path)
        return folder

    return copied


def _manifests(page):
    return re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)


@pytest.fixture
def pendulum(strangers):
    """The folder that the page tells to make."""
    return strangers("dfki", "pendulum")


def test_what_the_page_identifies_is_near_what_the_weak_form_tells(pendulum):
    for name, text in zip(("manifest", "others"), _manifests(OTHERS), strict=True):
        (pendulum / f"{name}.yaml").write_text(text)
    found = re.search(r"p1 +(\S+) .*\n.*\n +p3 +(\S+) ", OTHERS)
    shown = np.array([float(found[1]), float(found[2])])
    logs = bf.read(pendulum, known={"delay": 0.0})
    result = bf.identify(logs, method="weak-form", terms=())
    values = np.array([result.parameters.p1, result.parameters.p3])
    np.testing.assert_allclose(values, shown, rtol=0.1)
    assert values[1] / values[0] == pytest.approx(9.81 / 0.5, rel=0.08)


def test_the_manifests_on_the_page_name_logs_of_the_folder(pendulum):
    for text in _manifests(OTHERS):
        assert all((pendulum / each["file"]).is_file() for each in yaml.safe_load(text)["logs"])


@pytest.fixture
def servo(strangers):
    """The folder that the page tells to make."""
    folder = strangers("xl330", "my-servo")
    (folder / "manifest.yaml").write_text(_manifests(SERVO)[0])
    return folder


def test_the_example_is_the_page_s_manifest(tmp_path):
    (tmp_path / "my-servo").mkdir()
    (tmp_path / "servo.yaml").write_bytes((CHECKOUT / "examples/servo.yaml").read_bytes())
    (tmp_path / "my-servo/manifest.yaml").write_text(_manifests(SERVO)[0])
    example = read_manifest(tmp_path / "servo.yaml")
    assert example == read_manifest(tmp_path / "my-servo/manifest.yaml")
    gains = [example.properties(entry)["servo"].kp.value for entry in example.logs]
    assert sorted(set(gains)) == [100, 200, 800]


def test_a_log_s_page_says_when_the_drive_was_off(servo, butterfly):
    assert "drive off" in butterfly("inspect", servo.name, "--log", 3)[1]


@pytest.mark.slow
@pytest.mark.usefixtures("servo")
def test_what_the_page_identifies_and_foretells_follows_as_it_says(butterfly):
    found = bf.identify("my-servo")
    shown = re.search(r"FIT in the loop (\S+) % .* by the drive alone (\S+) %", SERVO)
    rows = loop_table(found).rows
    for row, told in zip(rows, shown.groups(), strict=True):
        assert float(row[1]) == pytest.approx(float(told), abs=NEAR)
    found.save("servo.json")
    for command in re.findall(r"^    butterfly (export .*|design .*)$", SERVO, re.MULTILINE):
        assert butterfly(*command.split())[0] == 0
    for row in loop_table(bf.identify("my-servo", holdout=["*kp200*"])).rows:
        told = re.search(rf"^ +{row[0]} +(\S+) ", SERVO, re.MULTILINE)[1]
        assert float(row[1]) == pytest.approx(float(told), abs=NEAR)


@pytest.fixture
def record_sines():
    """The example's program."""
    pytest.importorskip("can", reason="python-can is not installed (extra 'can')")
    return import_module("examples.record_sines")


def test_the_rehearsal_prints_what_the_page_shows(record_sines, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command = re.search(r"python -m examples\.record_sines (--rehearse .*)", TORQUE)[1]
    record_sines.main([*command.split(), "--omegas", "3"])  # the first of its five logs
    for line in capsys.readouterr().out.splitlines():
        assert f"    {line}\n" in TORQUE
    for line in Path("logs/manifest.yaml").read_text(encoding="utf-8").splitlines():
        assert f"{line}\n" in TORQUE


@pytest.mark.usefixtures("record_sines")
def test_the_page_names_the_rehearsal_s_joint():
    p = import_module("examples.odrive_stand_in").ROBOT.lumped
    assert f"p1 = {p.p1:.4g}, p2 = {p.p2:g}, p3 = {p.p3:.4g}, Tc = {p.coulomb:g}" in TORQUE


def test_every_option_on_the_page_is_one_of_the_program(record_sines, capsys):
    with pytest.raises(SystemExit):
        record_sines.main(["--help"])
    known = capsys.readouterr().out
    commands = re.findall(r"examples\.record_sines (.*)", TORQUE)
    for option in re.findall(r"--[a-z]+", " ".join(commands)):
        assert option in known
