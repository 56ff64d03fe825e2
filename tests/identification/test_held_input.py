"""A held input over friction is simulated as the independent integrator does, with any delay."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.segments import LONGEST_STEP, Segments
from butterfly.logs.log import Intersample, Log
from butterfly.model.greybox import Columns
from butterfly.model.parameters import LumpedParameters
from tests.independent.drives import clock
from tests.independent.integrator import Joint, Law, motion, tracking

JOINT = Joint(inertia=0.05, viscous=0.04, gravity=0.0, gain=1.0, coulomb=0.2, delay=4.3e-3)
SAME = LumpedParameters(p1=0.05, p2=0.04, p3=0.0, p4=1.0, coulomb=0.2, delay=4.3e-3)
REST = np.zeros((1, 2))


def _in_a_loop():
    """Steps of a set-point, tracked by the readings of a coarse encoder."""
    rng = np.random.default_rng(3)
    time = clock(rng, 8.0, 4e-3, 0.05)
    wanted = rng.uniform(-1.0, 1.0, 40)[(time / 0.7).astype(int)]
    law = Law(stiffness=3.0, damping=0.5, limit=1.0, count=1e-3, share=0.5)
    still = np.zeros_like(time)
    angle, _, inputs, _ = tracking(JOINT, law, (time, wanted, still, still, still))
    return Log(time=time, input=inputs, angle=angle)


def _on_a_relay():
    """A few jumps that fall anywhere between samples of the grid."""
    time = clock(np.random.default_rng(4), 8.0, 7e-3, 0.05)
    inputs = np.where(np.sin(2.6 * time) >= 0.0, 0.5, -0.5)
    return Log(time=time, input=inputs, angle=motion(JOINT, time, inputs)[0])


LOGS = {"in a loop": _in_a_loop, "on a relay": _on_a_relay}


def _errors(segment, joint, names=()):
    return segment.linearised(Columns.of(names, joint), 0.0, REST)


@pytest.mark.parametrize("kind", LOGS)
@pytest.mark.parametrize("guess", [4.3e-3, 0.0, 15e-3])
def test_friction_lets_go_when_a_held_input_jumps_whatever_delay_the_grid_begins_with(kind, guess):
    log = LOGS[kind]()
    errors, _ = _errors(Segments(log, replace(SAME, delay=guess)), SAME)
    assert np.std(errors) < 2e-5
    straight = Segments(replace(log, intersample=Intersample.FIRST_ORDER_HOLD), SAME)
    assert np.std(_errors(straight, SAME)[0]) > 1e-3


@pytest.mark.parametrize("kind", LOGS)
def test_the_derivative_by_the_delay_is_what_differences_are(kind):
    segment, names, short = Segments(LOGS[kind](), SAME), ("p1", "delay"), 1e-7
    _, rows = _errors(segment, SAME, names)
    ends = [_errors(segment, replace(SAME, delay=SAME.delay + x))[0] for x in (short, -short)]
    differences = (ends[0] - ends[1]) / (2 * short)
    np.testing.assert_allclose(rows[:, 1], differences, atol=1e-4 * np.abs(differences).max())


def test_smooth_inputs_keep_long_steps_which_only_jumps_divide():
    time = np.arange(0.0, 6.0, 2e-3)
    smooth = Log(time=time, input=np.sin(5.0 * time), angle=time)
    late = time > 3.0005
    jumping = replace(smooth, input=smooth.input + late)
    grids = [Segments(log, SAME).grid for log in (smooth, jumping)]
    assert all(np.diff(grid).max() < LONGEST_STEP * (1 + 1e-9) for grid in grids)
    assert grids[1].size <= grids[0].size + 2 < 1.02 * 6.0 / LONGEST_STEP
    assert time[late][0] in grids[1]
    assert time[late][0] not in grids[0]


@pytest.mark.parametrize("kind", LOGS)
def test_errors_of_held_and_of_straight_inputs_average_as_many_samples(kind):
    """Else neither is told from the other by their errors, and a wrong one widens intervals."""
    log = LOGS[kind]()
    kinds = (Intersample.ZERO_ORDER_HOLD, Intersample.FIRST_ORDER_HOLD)
    both = [Segments(replace(log, intersample=each), SAME) for each in kinds]
    held, straight = (each.averages(SAME)[0] for each in both)
    np.testing.assert_array_equal(held, straight)


def test_torque_that_is_off_at_times_is_late_once():
    log = _on_a_relay()
    off = (log.time % 2.0 > 1.2).astype(float)
    gated = replace(log, input=log.input, enabled=1.0 - off)
    angle, _ = motion(JOINT, log.time, log.input * (1.0 - off))
    errors, _ = _errors(Segments(replace(gated, angle=angle), SAME), SAME)
    assert np.std(errors) < 2e-2 * np.std(angle)
