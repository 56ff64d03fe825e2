"""The commands that run experiments."""

import json
import re

import numpy as np
import pytest

from tests.cli.one_line import assert_one_line_error, assert_tables_fit, done
from tests.experiment.setting import changed


def test_one_added_mass_alone_is_refused_in_one_line(butterfly, quick, tmp_path):
    changed(quick, added_masses=[{"mass": 0.05, "arm": 0.104}])
    result = butterfly("run", quick, "--out", tmp_path / "out")
    assert_one_line_error(result, "common factor", "add a log with another known mass")


def test_a_sine_that_will_swing_wide_is_warned_about(butterfly, quick, tmp_path):
    changed(quick, duration=0.1, excitations=[{"omega": 3.9, "amplitude": 0.9}])
    code, _, err = butterfly("simulate", quick, "--out", tmp_path / "logs")
    assert code == 0
    assert "warning: no added mass, 3.9 rad/s: predicted swing 1.5 rad" in err


ORBIT = """
name: orbit
plant:
  hand: {mass: 0.1, com_distance: 0.05, inertia: 0.003}
  drive: {torque: {gain: 10.0}}
  friction: {viscous: 1.0e-3, coulomb: 4.0e-4}
  encoder: {steps: 8192, noise: 2.0e-4}
  simulator: grey-box
added_masses: [{mass: 0.0, arm: 0.1}]
duration: 10.0
control:
  target: {amplitude: 1.0472}
  believed: {p1: 0.003, p2: 0.0012, p3: 0.045, p4: 9.0}
  duration: 15.0
  starts: [1.05, 0.7, 1.3]
  dither: 0.1
  velocity: {observer: {bandwidth: 100.0}}
  cross_check: [0.9, 1.2]
"""


@pytest.mark.slow
def test_an_orbit_is_calibrated_and_reported(butterfly, tmp_path):
    path = tmp_path / "orbit.yaml"
    path.write_text(ORBIT)
    out = done(butterfly("run", path, "--out", tmp_path / "out", "--figures"))
    assert "times less" in out
    first, second, *_ = out.splitlines()
    assert first.startswith("Held: an orbit of 60°. Reached ")
    assert second.startswith("Good: ")
    numbers = json.loads((tmp_path / "out/orbit.json").read_text())
    assert numbers["verdict"] == "good"
    assert numbers["amplitudes_rad"][-1] == pytest.approx(1.0472, abs=3.5e-3)
    found = numbers["parameters"]["p3"]
    assert found["value"] == pytest.approx(0.04905 / 0.00325, rel=2e-4)
    assert np.array(numbers["cross_orbit"]["rms_rad"]).shape == (2, 2)
    assert (tmp_path / "out/orbit-figures/phase-plane.svg").stat().st_size > 1e4
    assert (tmp_path / "out/round0_run2.mat").exists()


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("{amplitude: 1.0472}", "{amplitude: 4.0}", "between 0 and pi"),
        ("p4: 9.0", "p4: -9.0", "believed parameters: p4"),
        ("starts:", "start:", "'starts' (did you mean that?)"),
        ("{amplitude: 1.0472}", "{}", "amplitude, energy, speed, state"),
        ("{amplitude: 1.0472}", "{speed: 1.0}", "rad/s in either direction"),
    ],
)
def test_an_orbit_that_cannot_be_is_refused_in_a_line(butterfly, tmp_path, old, new, part):
    path = tmp_path / "orbit.yaml"
    path.write_text(ORBIT.replace(old, new, 1))
    assert_one_line_error(butterfly("run", path, "--out", tmp_path / "out"), part)


def test_the_thesis_begins_with_how_much_is_reproduced_and_what_the_rest_needs(
    butterfly, monkeypatch
):
    monkeypatch.setattr("butterfly.thesis.tables.has_real_logs", lambda _: False)
    monkeypatch.setenv("COLUMNS", "80")
    out = done(butterfly("reproduce", "thesis"))
    first, second, *_ = out.splitlines()
    assert re.fullmatch(r"(\d+) of \1 published values are reproduced\.", first)
    assert "Figures 9 to 12 need the real logs: run `butterfly fetch`" in second
    assert out.count("published  ") == int(first.split()[0])  # in one block
    assert_tables_fit(out)
