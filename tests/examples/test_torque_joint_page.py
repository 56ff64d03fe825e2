"""docs/torque-joint.md shows what the example prints and writes."""

import re
from pathlib import Path

import pytest

pytest.importorskip("can", reason="python-can is not installed (extra 'can')")

from examples import record_sines
from examples.odrive_stand_in import ROBOT

PAGE = (Path(__file__).parents[2] / "docs/torque-joint.md").read_text(encoding="utf-8")


def test_the_rehearsal_prints_what_the_page_shows(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command = re.search(r"python -m examples\.record_sines (--rehearse .*)", PAGE)[1]
    record_sines.main([*command.split(), "--omegas", "3"])  # the first of its five logs
    for line in capsys.readouterr().out.splitlines():
        assert f"    {line}\n" in PAGE
    for line in Path("logs/manifest.yaml").read_text(encoding="utf-8").splitlines():
        assert f"{line}\n" in PAGE


def test_the_page_names_the_rehearsal_s_joint():
    p = ROBOT.lumped
    assert f"p1 = {p.p1:.4g}, p2 = {p.p2:g}, p3 = {p.p3:.4g}, Tc = {p.coulomb:g}" in PAGE


def test_every_option_on_the_page_is_one_of_the_program(capsys):
    with pytest.raises(SystemExit):
        record_sines.main(["--help"])
    known = capsys.readouterr().out
    commands = re.findall(r"examples\.record_sines (.*)", PAGE)
    for option in re.findall(r"--[a-z]+", " ".join(commands)):
        assert option in known
