"""A joint driven with a recorded log, against an independent integrator."""

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.parameters import TorqueDrive
from butterfly.model.terms import DriveTerms
from butterfly.plant.joints import GreyBoxJoint
from butterfly.plant.rollout import replay_input
from tests.independent.integrator import Joint, motion
from tests.plant.setting import ADDED, JOINTS, robot

ROBOT = robot(TorqueDrive(gain=0.025), viscous=1e-3)
ZERO, FIRST = Intersample.ZERO_ORDER_HOLD, Intersample.FIRST_ORDER_HOLD


def _log(intersample, step, inputs, jitter=0.0):
    """A log that begins at rest and with an input of 0, at stamps of its own."""
    steps = step * (1 + jitter * np.random.default_rng(0).uniform(-1, 1, inputs.size - 1))
    time, how = 3.0 + np.concatenate([[0.0], np.cumsum(steps)]), {"intersample": intersample}
    return Log(time, inputs, np.zeros(inputs.size), input_kind=InputKind.TORQUE, **how)


def _integrated(log, delay):
    """Angle at the stamps; a continuous input is held at its mean over twentieths of a step."""
    p, parts = ROBOT.lumped.with_added_mass(ADDED), 20 if log.intersample is FIRST else 1
    count = log.time.size
    time = np.interp(np.arange(parts * (count - 1) + 1) / parts, np.arange(count), log.time)
    middles = time + 0.5 * np.diff(time, append=time[-1])
    inputs = np.interp(middles, log.time, log.input) if parts > 1 else log.input
    joint = Joint(p.p1, p.p2, p.p3, p.p4, delay=delay)
    return motion(joint, time, inputs)[0][::parts]


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("delay", [0.0, 0.0023, 0.01])
@pytest.mark.parametrize("intersample", [ZERO, FIRST])
def test_a_replayed_input_moves_the_joint_as_an_independent_integrator_does(
    joint, delay, intersample
):
    """A held mean in place of the input's course within an interval costs its square."""
    inputs = 0.3 * np.sin(4.0 * 0.002 * np.arange(500))
    log = _log(intersample, 0.002, inputs, jitter=0.3)
    exact = _integrated(log, delay)
    assert np.ptp(exact) > 0.1
    angle = replay_input(joint(ROBOT, ADDED), log, delay)
    np.testing.assert_allclose(angle, exact, atol=1e-5)
    if delay == 0.0 and intersample is ZERO:
        np.testing.assert_allclose(angle, exact, atol=1e-9)


@pytest.mark.parametrize("joint", JOINTS)
def test_a_compressing_drive_with_a_dead_zone_delivers_less(joint):
    log = _log(ZERO, 0.002, np.full(500, 0.35))
    weak = replay_input(joint(ROBOT, ADDED), log, 0.0, DriveTerms(dead_zone=0.05, compression=0.5))
    less = _log(ZERO, 0.002, np.full(500, 0.3 / 1.15))
    np.testing.assert_allclose(weak, replay_input(joint(ROBOT, ADDED), less), atol=1e-12)


@pytest.mark.parametrize("joint", JOINTS)
def test_a_replay_starts_at_rest_where_the_joint_was_put_and_can_be_repeated(joint):
    log, put = _log(ZERO, 0.002, np.zeros(50)), joint(ROBOT, ADDED, angle=0.2)
    first = replay_input(put, log)
    assert first[0] == 0.2
    assert abs(first[1] - 0.2) < 1e-3
    np.testing.assert_array_equal(replay_input(put, log), first)


def test_a_joint_that_diverges_is_said_to():
    log = _log(ZERO, 0.002, np.full(500, 1e308))
    with (
        np.errstate(all="ignore"),
        pytest.raises(InputError, match=r"log: angle: got a joint that diverged"),
    ):
        replay_input(GreyBoxJoint(ROBOT, ADDED), log)
