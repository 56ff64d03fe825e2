"""What docs/others-logs.md says of joints that nothing holds is true of the logs of its example."""

import re
from pathlib import Path

import pytest

import butterfly as bf
from butterfly.verdict import Level
from examples.free_joints import EXAMPLES, main, written

PAGE = (Path(__file__).parents[2] / "docs/others-logs.md").read_text(encoding="utf-8")
SAID = {
    "cart": {"joint": "slide", "known": {"p4": 1.0}},
    "arm": {"known": {"p4": 1.0, "p3": 0.0}},
    "positioner": {"known": {"p4": 1.0, "p3": 0.0}},
    "servo": {"known": {"p4": (1.6, 0.05), "p3": 0.0}},
}
"""What the page's commands say besides the columns."""


@pytest.mark.parametrize(
    "name",
    [pytest.param(each, marks=() if each == "cart" else pytest.mark.slow) for each in SAID],
)
def test_the_page_s_command_finds_the_joint_that_was_simulated(name, tmp_path):
    written(name, tmp_path)
    command = re.search(rf"^    butterfly identify {name} (.*)$", PAGE, re.MULTILINE)[1]
    columns = dict(each.split("=") for each in re.search(r"--columns (\S+)", command)[1].split(","))
    assert list(columns.values()) == EXAMPLES[name].columns.split(",")
    kind = re.search(r"--input (\S+)", command)[1]
    found = bf.identify(bf.read(tmp_path, input_kind=kind, columns=columns, **SAID[name]))
    assert found.judged.level is Level.GOOD
    rows = zip(found.estimate.names, found.estimate.values, strict=True)
    for term, value in rows:
        true = 0.004 if term == "delay" else getattr(EXAMPLES[name].joint, term)
        assert value == pytest.approx(true, rel=0.01)


def test_every_example_is_a_section_s_folder(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("examples.free_joints.written", lambda _, folder: folder.mkdir())
    main(["--out", str(tmp_path)])
    assert len(capsys.readouterr().out.splitlines()) == len(EXAMPLES)
    assert {path.name for path in tmp_path.iterdir()} == set(SAID)
    assert all(f"    butterfly identify {name} " in PAGE for name in SAID)
