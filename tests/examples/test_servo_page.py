"""docs/servo.md shows what the program says of a servo's logs, which are not shipped."""

import re
from pathlib import Path

import pytest

import butterfly as bf
from butterfly.logs.manifest import read_manifest
from butterfly.report.summary import loop_rows

_CHECKOUT = Path(__file__).parents[2]
PAGE = (_CHECKOUT / "docs/servo.md").read_text(encoding="utf-8")
EXAMPLE = (_CHECKOUT / "examples/servo.yaml").read_text(encoding="utf-8")

_NEAR = 2.0  # per cent of FIT, within which a page is not out of date


@pytest.fixture
def servo(strangers):
    """The folder that the page tells to make."""
    folder = strangers("xl330", "my-servo")
    (folder / "manifest.yaml").write_text(re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[1])
    return folder


def test_the_example_is_the_page_s_manifest(tmp_path):
    (tmp_path / "my-servo").mkdir()
    (tmp_path / "servo.yaml").write_text(EXAMPLE)
    (tmp_path / "my-servo/manifest.yaml").write_text(
        re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[1]
    )
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
    shown = re.search(r"FIT in the loop (\S+) % .* by the drive alone (\S+) %", PAGE)
    rows = loop_rows(found)
    for row, told in zip(rows, shown.groups(), strict=True):
        assert float(row[1]) == pytest.approx(float(told), abs=_NEAR)
    found.save("servo.json")
    for command in re.findall(r"^    butterfly (export .*|design .*)$", PAGE, re.MULTILINE):
        assert butterfly(*command.split())[0] == 0
    for row in loop_rows(bf.identify("my-servo", holdout=["*kp200*"])):
        told = re.search(rf"^ +{row[0]} +(\S+) ", PAGE, re.MULTILINE)[1]
        assert float(row[1]) == pytest.approx(float(told), abs=_NEAR)
