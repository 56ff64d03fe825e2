"""Joints as others log them: logs obey the joint, and the bound is what a closed form says."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.benchmarks.strangers import Answer, Meeting, summary
from tests.independent import bodies
from tests.independent.integrator import Joint, motion
from tests.independent.kinds import RobotOfKind
from tests.independent.strangers import FRICTION, KINDS, bound, draw

ROBOTS = [("free", 5), ("free", 9), ("free", 10), ("balanced", 3), ("relay", 3)]


@pytest.mark.parametrize(("kind", "number"), ROBOTS)
def test_readings_are_what_the_recorded_input_alone_makes_of_the_joint(kind, number):
    robot = draw(kind, number)
    assert robot.body.joint == draw(kind, number).body.joint
    noise = math.hypot(robot.encoder.spread, robot.encoder.count / math.sqrt(12.0))
    for log in robot.recordings:
        joint = robot.body.carrying(log.mass)
        error = log.angle - motion(joint, log.time, log.input, log.angle[0])[0]
        assert np.std(error) == pytest.approx(noise, rel=0.15)


@pytest.mark.parametrize("number", range(12))
def test_friction_at_rest_stays_under_its_share_of_the_drive(number):
    robot = draw("free", number)
    joint, drive = robot.body.joint, max(np.abs(log.input).max() for log in robot.recordings)
    at_rest = (joint.coulomb + joint.excess) * (1.0 + joint.uneven) + joint.bias
    assert 0.01 * drive < at_rest
    if "cart" in robot.kind:  # others need not reach the drive's limit
        assert at_rest <= FRICTION * drive


def test_the_bound_of_a_mass_that_is_pushed_is_what_a_line_fit_to_time_squared_says():
    """Its place is start + force t^2/2 inertia; of N even instants t^2 varies by T^4 4/45."""
    inertia, force, duration, count, spread = 0.3, 0.6, 4.0, 4001, 1e-3
    time = np.linspace(0.0, duration, count)
    body = bodies.Body(
        joint=Joint(inertia=inertia, viscous=0.0, gravity=0.0, gain=1.0),
        masses=(bodies.Mass(),),
        pace=1.0,
    )
    encoder = bodies.Encoder(count=1e-9, spread=spread, zero=0.0)
    angle = motion(body.joint, time, np.full(count, force))[0]
    log = bodies.Recording(time, np.full(count, force), angle, bodies.Mass())
    robot = RobotOfKind(body, encoder, [log], 100.0, {"known": {"p4": 1.0, "p3": 0.0}})
    slope = 0.5 * force / inertia * duration**2 * math.sqrt(4.0 / 45.0)
    assert bound(robot) == pytest.approx(1.96 * spread / (slope * math.sqrt(count)), rel=1e-3)
    twice = replace(robot, recordings=[log, log])
    assert bound(twice) == pytest.approx(bound(robot) / math.sqrt(2.0), rel=1e-6)


def test_what_is_not_answered_though_the_weak_form_is_right_is_named():
    right = Answer(level="GOOD", error=1.0, half_width=2.0, seconds=1.0)
    wrong = replace(right, level="CARE", error=12.0)
    named = {"kind": "free", "what": "arm", "logs": 1, "duration": 10.0, "bound": 0.1}
    met = [
        Meeting(number=0, answer=right, weak=None, **named),
        Meeting(number=1, answer=wrong, weak=None, **named),
        Meeting(number=2, answer=Answer(refused="no"), weak=right, **named),
        Meeting(number=3, answer=replace(right, level="WARNING"), weak=wrong, **named),
    ]
    text = summary(met)
    assert "bound under 20 %: 4; of these answered: 2 (50 %)" in text
    assert "p1 inside: 1 of 2 answers, 2 of 3 with those not to be used" in text
    assert "off: 1 by more than 10 %, 1 by more than 5 %" in text
    assert "where the weak form is right: 1 (numbers 2)\n" in text


def test_every_kind_is_drawn_by_number_and_seed():
    for kind in KINDS:
        first, other = draw(kind, 0), draw(kind, 0, 2)
        assert first.body.joint != other.body.joint
