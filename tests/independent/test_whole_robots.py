"""Logs of whole robots: the plant obeys its equation, and robots are what is said of them."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import butterfly as bf
from tests.benchmarks.robots import Case, Claim, summary
from tests.independent.integrator import Joint, motion
from tests.independent.robot_plants import STEP, Encoder, Hidden, Hold, Plant, Timing
from tests.independent.whole_robots import FILES, draw, file_of

EXACT = Encoder(count=1e-12, spread=1e-15)
HIDDEN = Hidden(armature=0.03, damping=0.05, frictionloss=0.1, masses=1.04)
POSE = {"pan": 0.3, "shoulder": 0.2, "elbow": 0.0, "wrist": -0.4, "roll": 0.1}


@pytest.fixture(scope="module")
def arm():
    return mujoco.MjModel.from_xml_path(str(file_of("arm")))


def _gravity(plant):
    at_zero, at_quarter = plant.torque(0.0), plant.torque(math.pi / 2.0)
    return math.hypot(at_zero, at_quarter), math.atan2(-at_zero, at_quarter)


def _law(sample, _):
    time = max(sample, 0) * 4e-3
    return 0.8 * math.sin(5.0 * time) + 0.4 * math.sin(13.0 * time)


@pytest.mark.parametrize("delay", [0, 5, 11])
def test_a_joint_among_held_ones_moves_as_integrated_between_stick_and_slip(arm, delay):
    plant = Plant(arm, POSE, "elbow", HIDDEN)
    moment, hanging = _gravity(plant)
    log = plant.run(
        np.random.default_rng(0), _law, hanging, EXACT, Timing(period=8, delay=delay, samples=1000)
    )
    joint = Joint(
        inertia=plant.inertias()["elbow"],
        viscous=HIDDEN.damping,
        gravity=moment,
        gain=1.0,
        coulomb=HIDDEN.frictionloss,
        delay=delay * STEP,
    )
    own = hanging + motion(joint, log.time, log.input, log.true[0] - hanging)[0]
    assert np.ptp(own) > 1.0
    assert np.max(np.abs(log.true - own)) < 2e-4 * np.ptp(own)


def test_all_masses_are_off_by_their_factor(arm):
    bare = Hidden(armature=0.0, damping=0.0, frictionloss=0.0)
    inertias = [
        Plant(arm, POSE, "elbow", replace(bare, masses=factor)).inertias()["elbow"]
        for factor in (1.0, 1.04)
    ]
    assert inertias[1] == pytest.approx(1.04 * inertias[0], rel=1e-12)


def test_a_stiffer_hold_moves_less(arm):
    reach = []
    for stiffness in (20.0, 200.0):
        holds = {
            "shoulder": Hold(
                stiffness=stiffness, damping=0.1 * math.sqrt(stiffness), place=lambda _: 0.2
            )
        }
        plant = Plant(arm, POSE, "elbow", HIDDEN, holds=holds)
        log = plant.run(
            np.random.default_rng(0), _law, 1.0, EXACT, Timing(period=8, delay=0, samples=500)
        )
        reach.append(np.ptp(log.others["shoulder"]) / 2.0)
    assert reach[1] == pytest.approx(reach[0] / 10.0, rel=0.5)
    assert 1e-3 < reach[1] < 0.05


@pytest.mark.parametrize(
    ("joint", "number"), [pytest.param("abduction", 1, marks=pytest.mark.slow), ("knee", 4)]
)
def test_a_robot_stays_in_its_range_and_is_read_as_its_owner_tells(tmp_path, joint, number):
    robot = draw("leg", joint, number)
    low, high = np.radians([-45.0, 45.0] if joint == "abduction" else [-150.0, -10.0])
    assert all(low < log.true.min() < log.true.max() < high for log in robot.recordings)
    assert all(np.ptp(log.true) > 0.2 for log in robot.recordings)
    assert robot.others == ("soft" if number == 1 else "fixed")
    assert (1e-3 / 2 < robot.motion < 0.08) == (number == 1)
    data = bf.read(tmp_path, **robot.write(tmp_path))
    assert len(data.logs) == 4
    assert data.manifest.facts.joint == joint
    if robot.known == "poses":
        assert len(data.manifest.facts.poses) == 2


def test_a_robot_of_others_is_missing_where_it_is_not_installed(monkeypatch, tmp_path):
    monkeypatch.setattr("tests.independent.whole_robots.INSTALLED", tmp_path)
    assert [name for name in FILES if file_of(name) is None] == ["so101", "panda"]


def test_a_summary_counts_what_is_inside_and_what_is_good_and_far_off():
    near = Claim(true=1.0, value=1.05, half_width=0.1)
    far = replace(near, value=1.2)
    right = Case(
        model="arm", joint="pan", number=0, others="fixed", known="gain", level="GOOD",
        claims={"p1": near, "damping": near},
    )  # fmt: skip
    wrong = replace(right, number=1, claims={"p1": far, "damping": near})
    careful = replace(wrong, number=2, level="CARE")
    refused = replace(right, number=3, level="", claims={}, refused="why")
    first, *_, last = summary([right, wrong, careful, refused]).splitlines()[2:]
    cells = [cell.strip() for cell in first.split("|")[1:-1]]
    assert cells[:6] == ["all with stiff friction", "1/3", "–", "3/3", "–", "67"]
    assert cells[6:12] == ["4", "2", "1", "0", "1", "1"]
    assert last.startswith("  arm pan 1, ")
    assert "FALSE GOOD" in last
