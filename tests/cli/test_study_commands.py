import json
import re

import numpy as np
import pytest


def test_unseen_masses_and_frequencies_are_predicted(butterfly, quick_data):
    for split in ("mass", "frequency"):
        code, out, err = butterfly("validate", quick_data, "--split", split)
        assert code == 0, err
        assert f"one {split} left out" in out
        assert "above 90 %" in out


def test_a_weighed_hand_and_the_bootstrap(butterfly, quick_data):
    code, out, err = butterfly("identify", quick_data, "--hand-mass", 0.1)
    assert code == 0, err
    assert "centre of mass" in out
    distance = float(re.search(r"centre of mass\s+([\d.]+) ±", out).group(1))
    assert distance == pytest.approx(0.05, rel=0.05)
    assert "weigh the hand" in out
    code, out, err = butterfly("validate", quick_data, "--bootstrap", 20)
    assert code == 0, err
    assert "bootstrap over logs" in out


def test_terms_are_chosen(butterfly, quick_data):
    code, out, err = butterfly(
        "select", quick_data, "--method", "harmonic-balance", "--candidates", "drag,load"
    )
    assert code == 0, err
    assert "Chosen: --terms" in out


def test_a_term_that_is_none_is_one_line(butterfly, quick_data):
    code, _, err = butterfly("validate", quick_data, "--terms", "drug")
    assert code == 2
    assert "did you mean" in err
    assert err.count("\n") == 1


def test_the_residual_torque_is_named_and_drawn(butterfly, quick_data, tmp_path):
    plot = tmp_path / "residual.html"
    code, out, _ = butterfly("residual", quick_data, "--log", 2, "--plot", plot)
    assert code == 0
    assert "looks like" in out
    assert "velocity in rad" in plot.read_text(encoding="utf-8")
    code, _, err = butterfly("residual", quick_data, "--log", 99)
    assert code == 2
    assert "less than 12" in err


def test_next_experiments_are_ranked(butterfly, quick_data):
    code, out, err = butterfly("design", quick_data, "--count", 3)
    assert code == 0, err
    assert "rad/s" in out or "free decay" in out


def test_the_thesis_is_reproduced(butterfly, logs_folder, tmp_path):
    code, out, _ = butterfly("reproduce", "thesis", "--root", logs_folder, "--out", tmp_path)
    assert code == 0
    assert "3.7740" in out
    assert (tmp_path / "figure_12.csv").exists()
    code, _, err = butterfly("reproduce", "everything")
    assert code == 2
    assert "thesis" in err


def test_a_robust_loss_can_be_asked_for(butterfly, quick_data):
    code, out, err = butterfly(
        "identify", quick_data, "--method", "output-error", "--loss", "soft_l1"
    )
    assert code == 0, err
    assert "converged" in out


def test_every_method_identifies_the_simulated_robot(butterfly, quick_data):
    for method in ("harmonic-balance", "output-error", "weak-form", "linear"):
        code, out, err = butterfly("identify", quick_data, "--method", method)
        assert code == 0, err
        assert method.replace("-", " ").split()[0] in out


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


def test_an_orbit_is_calibrated_and_reported(butterfly, tmp_path):
    path = tmp_path / "orbit.yaml"
    path.write_text(ORBIT)
    code, out, err = butterfly("calibrate-orbit", path, "--out", tmp_path / "out")
    assert code == 0, err
    assert "times less" in out
    numbers = json.loads((tmp_path / "out/report.json").read_text())
    assert numbers["amplitudes_rad"][-1] == pytest.approx(1.0472, abs=3.5e-3)
    found = numbers["parameters"]["p3"]
    assert found["value"] == pytest.approx(0.04905 / 0.00325, rel=2e-4)
    assert np.array(numbers["cross_orbit"]["rms_rad"]).shape == (2, 2)
    assert (tmp_path / "out/report-figures/phase-plane.svg").stat().st_size > 1e4
    assert (tmp_path / "out/round0_run2.mat").exists()


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("control:", "method: linear\ncontrol:", "control"),
        ("{amplitude: 1.0472}", "{amplitude: 4.0}", "between 0 and pi"),
        ("p4: 9.0", "p4: -9.0", "believed parameters: p4"),
        ("starts:", "start:", "'starts' (did you mean that?)"),
        ("{amplitude: 1.0472}", "{}", "amplitude, energy, state"),
    ],
)
def test_an_orbit_that_cannot_be_is_refused_in_a_line(butterfly, tmp_path, old, new, part):
    path = tmp_path / "orbit.yaml"
    text = ORBIT.replace(old, new, 1)
    if part == "control":
        text = text[: text.index("control:")] + "excitations: [{omega: 3.0, amplitude: 1.0e-4}]\n"
    path.write_text(text)
    code, _, err = butterfly("calibrate-orbit", path, "--out", tmp_path / "out")
    assert code == 2
    assert part in err
    assert err.count("\n") == 1
