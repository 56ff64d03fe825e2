"""Another team's pendulum, by a fit that shares nothing with the program, and by the program."""

import json

import numpy as np
import pytest

import butterfly as bf
from tests.independent.kinds import draw
from tests.independent.segments_fit import NAMES, fit, segments

FIRST = {"inertia": 0.15, "viscous": 0.01, "gravity": 3.0, "coulomb": 0.1}
LOGS = ("ddp", "direct_collocation", "ilqr")
LENGTH = 1.0
"""Of a segment in s."""

OURS = ("p1", "p2", "p3", "coulomb")
GEOMETRY = 19.6
"""m g l / J in 1/s^2 of a weight on a rod of 0.5 m, as the drawings have it."""


@pytest.fixture(scope="module")
def folder(logs_folder):
    """Logs of a weight on a rod whose torques were measured."""
    folder = logs_folder.parent / "strangers/dfki"
    if not folder.is_dir():
        pytest.skip(f"the logs of DFKI's pendulum are not there: no folder {folder}")
    return folder


@pytest.fixture(scope="module")
def independent(folder):
    """The fit that shares nothing, to all segments of the three logs."""
    logs = [np.genfromtxt(folder / f"{name}.csv", delimiter=",", names=True) for name in LOGS]
    parts = [segments(log["time"], log["torque"], log["position"], LENGTH) for log in logs]
    return fit([part for log in parts for part in log], FIRST)


def test_it_finds_a_simulated_joint_under_a_law():
    robot = draw("closed-loop", 10, seed=3)
    true = {name: robot.truth[ours] for name, ours in zip(NAMES, OURS, strict=True)}
    log = robot.recordings[0]
    mass, arm = log.mass
    true["inertia"] += mass * arm**2
    true["gravity"] += mass * 9.81 * arm
    torque = robot.truth["p4"] * log.input
    parts = segments(log.time, torque, log.angle - robot.zero, LENGTH)
    found = fit(parts, {name: 1.3 * value for name, value in true.items()})
    for name, value in true.items():
        assert abs(found.values[name] - value) < 4.0 * found.errors[name] < 0.1 * value, name
    assert found.misfits.max() < 2e-3


def test_a_pendulum_is_the_one_that_its_drawings_show(independent):
    """Though not the one whose inertia and moment are published with its logs."""
    inertia, gravity = independent.values["inertia"], independent.values["gravity"]
    assert gravity / inertia == pytest.approx(GEOMETRY, rel=0.03)
    assert inertia == pytest.approx(0.178, abs=0.006)
    assert independent.values["coulomb"] == pytest.approx(0.17, abs=0.04)
    assert np.median(independent.misfits) < 0.01


def test_the_program_finds_the_same_pendulum(folder, independent, tmp_path):
    manifest = {
        "name": "pendulum",
        "root": str(folder),
        "input": "torque",
        "known": {"p4": 1.0},
        "columns": {"time": "time", "input": "torque", "angle": "position"},
        "logs": [{"file": f"{name}.csv"} for name in LOGS],
    }
    (tmp_path / "manifest.yaml").write_text(json.dumps(manifest), encoding="utf-8")
    found = bf.identify(tmp_path)
    estimate = found.estimate
    limits = dict(
        zip(estimate.names, zip(estimate.lower, estimate.upper, strict=True), strict=True)
    )
    for ours, name in zip(OURS, NAMES, strict=True):
        lower, upper = limits[ours]
        own = 2.0 * independent.errors[name]
        assert lower - own <= independent.values[name] <= upper + own, name
    assert estimate.parameters.p1 == pytest.approx(independent.values["inertia"], rel=0.02)
    assert estimate.parameters.p3 == pytest.approx(independent.values["gravity"], rel=0.02)
    assert estimate.parameters.p3 / estimate.parameters.p1 == pytest.approx(GEOMETRY, rel=0.03)
    assert found.fit.median > 98.0
