"""Random robots on defective benches: each row does to a log what it says, and no more."""

from dataclasses import replace

import numpy as np
import pytest

from tests.independent import bench, defects
from tests.independent.bodies import Body, Mass, Recording
from tests.independent.integrator import Joint
from tests.independent.scores import Reading, Score

JOINT = Joint(inertia=2.0, viscous=1.0, gravity=9.81, gain=3.0, coulomb=0.5, drag=0.2)
BODY = Body(joint=JOINT, masses=(Mass(), Mass(1.0, 0.5), Mass(2.0, 0.5)), pace=2.0)
TIME = np.arange(0.0, 20.0, 1e-3)
LOG = Recording(time=TIME, input=np.sin(TIME), angle=np.cos(TIME), mass=BODY.masses[1])
DAMPING = ("viscous", "coulomb", "drag")


def _made(row, sizes=(1.0, 2.0, 3.0)):
    return defects.ROWS[row].make(np.random.default_rng(3), BODY, np.array(sizes))


def _changed(row, mass=BODY.masses[1]):
    """What a row makes of a joint with a mass, over what it was, where that differs."""
    before = BODY.carrying(mass)
    pairs = zip(before._asdict().items(), _made(row).joint(before, mass, 20.0), strict=True)
    return {name: new / (old or 1.0) for (name, old), new in pairs if new != old}


def test_a_joint_on_a_defective_bench_is_the_one_that_its_row_describes():
    assert _changed("control") == {}
    assert _changed("own inertia") == {"inertia": pytest.approx(1 + 0.05 * 0.25 / 2.25)}
    factors = _changed("friction by log")
    assert len(set(factors.values())) == 1
    assert set(factors) == set(DAMPING)
    falling = _changed("falling friction")
    ends = np.array([falling["viscous"], falling["viscous"] * (1 + 20.0 * falling["wear"])])
    np.testing.assert_allclose(ends, [1.1, 0.9])
    warm = _changed("resistance", BODY.masses[2])
    assert warm == {"gain": pytest.approx(1 / 1.05), "viscous": pytest.approx(0.5 + 0.5 / 1.05)}
    tilted = _changed("level")
    assert set(tilted) == {"gravity"}
    lost = (1 - tilted["gravity"]) * (JOINT.gravity + 0.5 * 9.81) / (0.5 * 9.81)
    assert 4 < np.degrees(np.arccos(1 - lost)) < 8
    assert _changed("spring")["spring"] == pytest.approx(0.1 * JOINT.gravity)
    base = _changed("base")
    assert base["imbalance"] == pytest.approx(1.0 + 0.5)  # kg m
    assert np.sqrt(base["base_spring"] / base["base"]) > 4 * BODY.pace_of(BODY.masses[0])


def test_drives_and_encoders_are_those_that_their_rows_describe():
    wave = 3.0 * np.sin(TIME)
    dead = _made("dead zone").drive(TIME, wave)
    np.testing.assert_allclose(wave - dead, np.clip(wave, -0.06, 0.06))
    clipped = _made("saturation").drive(TIME, wave)
    np.testing.assert_allclose(clipped, np.clip(wave, -clipped.max(), clipped.max()))
    assert 0.75 <= clipped.max() / 3.0 <= 0.9
    step = _made("lag").drive(TIME, np.ones(TIME.size))
    constants = -TIME[1:8] / np.log1p(-step[:7])
    assert np.ptp(constants) < 1e-12
    assert 2e-3 < constants[0] < 10e-3
    played = np.degrees(_made("backlash").encoder(np.sin(TIME)) - np.sin(TIME))
    moving = np.cos(TIME[500:])
    assert np.abs(played).max() == pytest.approx(0.15)
    np.testing.assert_allclose(played[500:][moving > 0.2], -0.15)  # it follows behind
    turn = _made("eccentric").encoder(TIME) - TIME
    assert np.degrees(turn.max()) == pytest.approx(0.5, rel=1e-5)
    np.testing.assert_allclose(
        turn[TIME < 10] + np.interp(TIME[TIME < 10] + np.pi, TIME, turn), 0, atol=1e-8
    )


def test_notes_are_wrong_by_what_their_rows_say():
    clock = _made("clock").notes(LOG).time / np.maximum(TIME, 1e-9)
    assert 1e-3 < abs(clock[-1] - 1) < 5e-3
    scales = [_made("scale").notes(replace(LOG, mass=mass)).mass.mass for mass in BODY.masses]
    assert abs(scales[1] - 1.0) == pytest.approx(0.03)
    assert scales[2] == pytest.approx(2 * scales[1])
    arms = [_made("arm").notes(replace(LOG, mass=mass)).mass.arm for mass in BODY.masses]
    assert abs(arms[1] / 0.5 - 1.0) == pytest.approx(0.01)
    weighed = [_made("weighed").notes(replace(LOG, mass=mass)).mass.mass for mass in BODY.masses]
    assert weighed[0] == 0
    assert weighed[1] + weighed[2] / 2 == pytest.approx(2.0)
    assert 0 < abs(weighed[1] - 1.0) < 0.03


def test_numbers_determine_a_robot_and_its_masses_and_inputs_are_enough():
    first, again, other = (defects.draw("control", 0, seed) for seed in (3, 3, 4))
    assert first.truth == again.truth != other.truth
    np.testing.assert_array_equal(first.recordings[0].angle, again.recordings[0].angle)
    slow = defects.draw("two rates", 2, 3)
    for robot, sines in ((first, True), (slow, False)):
        assert 9 <= len(robot.logs) <= 12
        assert len({log.added_mass for log in robot.logs}) >= 3
        assert all(bool(log.excitation) is sines for log in robot.logs)
    rates = [np.median(np.diff(log.time)) for log in slow.logs]
    assert rates[1] > 1.5 * rates[0] == pytest.approx(1.5 * rates[2], rel=0.05)


def test_the_table_tells_what_good_answers_hide_and_which_cause_was_named():
    held = Reading(error=1.0, half_width=2.0, covered=True, claimed=True, miss=0.01)
    outside = replace(held, error=-7.0, covered=False)
    named = {"family": "spring", "repeat": 0, "method": "auto", "verdict": "good", "fit": 99.0}
    scores = [
        Score(
            **named,
            number=0,
            readings={"p1": held, "p3": outside},
            text="Good.\nIt misses a spring.",
        ),
        Score(
            **named, number=1, readings={"p1": outside, "p3": outside}, text="Good.\n\nA spring?"
        ),
        Score(**named | {"verdict": "use with care"}, number=2, readings={"p1": outside}),
        Score(**named, number=3, refused="no"),
    ]
    wider = [replace(scores[0], readings={"p1": replace(held, half_width=1.0)})]
    *_, line = bench.table(scores, wider).splitlines()
    assert line.startswith("| spring | 4 | 1 | 33 |  | 0 |")
    assert "| 2.00 |" in line
    assert "| 2/3 | 1, up to 7 % | 1 (2)/2 |" in line
