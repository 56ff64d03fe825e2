"""docs/others-logs.md shows what the program says of logs that are not shipped."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

import butterfly as bf

PAGE = (Path(__file__).parents[2] / "docs/others-logs.md").read_text(encoding="utf-8")


@pytest.fixture
def pendulum(strangers):
    """The folder that the page tells to make."""
    return strangers("dfki", "pendulum")


def _write_manifests(folder):
    first, others = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    (folder / "manifest.yaml").write_text(first)
    (folder / "others.yaml").write_text(others)


def test_what_the_page_identifies_is_near_what_the_weak_form_tells(pendulum):
    _write_manifests(pendulum)
    found = re.search(r"p1 +(\S+) .*\n.*\n +p3 +(\S+) ", PAGE)
    shown = np.array([float(found[1]), float(found[2])])
    logs = bf.read(pendulum, known={"delay": 0.0})
    result = bf.identify(logs, method="weak-form", terms=())
    values = np.array([result.parameters.p1, result.parameters.p3])
    np.testing.assert_allclose(values, shown, rtol=0.1)
    assert values[1] / values[0] == pytest.approx(9.81 / 0.5, rel=0.08)


def test_the_manifests_on_the_page_name_logs_of_the_folder(pendulum):
    for text in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL):
        assert all((pendulum / each["file"]).is_file() for each in yaml.safe_load(text)["logs"])
