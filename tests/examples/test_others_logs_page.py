"""docs/others-logs.md shows what the program says of logs that are not shipped."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

import butterfly as bf

PAGE = (Path(__file__).parents[2] / "docs/others-logs.md").read_text(encoding="utf-8")


@pytest.fixture
def pendulum(strangers, monkeypatch):
    """The folder that the page tells to make, and the program where it lies."""
    monkeypatch.setenv("COLUMNS", "200")
    return strangers("dfki", "pendulum")


def _commands(start):
    return re.findall(rf"^    butterfly ({start}.*)$", PAGE, re.MULTILINE)


def _write_manifests(folder):
    first, others = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    (folder / "manifest.yaml").write_text(first)
    (folder / "others.yaml").write_text(others)


def _assert_shown(printed):
    for line in printed:
        assert " ".join(line.split()) in " ".join(PAGE.split()), line


def test_looking_at_the_files_prints_what_the_page_shows(pendulum, butterfly):
    alone, all_of_them = _commands("inspect")
    code, _, said = butterfly(*alone.split())
    assert code == 2
    _assert_shown([said.replace(str(pendulum.parent.resolve()) + "/", "")])
    code, out, _ = butterfly(*all_of_them.split())
    assert code == 0
    _assert_shown(line for line in out.splitlines() if ".csv" in line)


@pytest.mark.usefixtures("pendulum")
def test_what_is_missing_is_said_as_the_page_shows(butterfly):
    refused, *_ = _commands("identify")
    code, _, said = butterfly(*refused.split())
    assert code == 2
    _assert_shown([said])


def test_given_values_move_as_the_page_shows(pendulum, butterfly):
    _write_manifests(pendulum)
    (command,) = (each for each in _commands("predict") if "coulomb" in each)
    code, out, _ = butterfly(*command.split())
    assert code == 3
    shown = ("Do not use", ".csv")
    _assert_shown(line for line in out.splitlines() if any(each in line for each in shown))


def test_what_the_page_identifies_is_near_what_the_weak_form_tells(pendulum):
    _write_manifests(pendulum)
    found = re.search(r"p₁ +(\S+) .*\n.*\n +p₃ +(\S+) ", PAGE)
    shown = np.array([float(found[1]), float(found[2])])
    logs = bf.read(pendulum, known={"delay": 0.0})
    result = bf.identify(logs, method="weak-form", terms=())
    values = np.array([result.parameters.p1, result.parameters.p3])
    np.testing.assert_allclose(values, shown, rtol=0.1)
    assert values[1] / values[0] == pytest.approx(9.81 / 0.5, rel=0.08)


def test_the_manifests_on_the_page_name_logs_of_the_folder(pendulum):
    for text in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL):
        assert all((pendulum / each["file"]).is_file() for each in yaml.safe_load(text)["logs"])
