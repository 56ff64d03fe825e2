"""What an input does between its samples, which nobody says: SciPy moves joints by either."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from butterfly.identification.data import DataSet
from butterfly.identification.identify import identify
from butterfly.identification.trust import FindingKind
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.prior import Prior
from butterfly.model.servo import ServoLoop
from butterfly.verdict import Level

HELD, STRAIGHT = Intersample.ZERO_ORDER_HOLD, Intersample.FIRST_ORDER_HOLD
STEP = 0.01
TIME = np.arange(0.0, 6.0, STEP)
JOINT = {"p1": 0.02, "p2": 0.05, "p3": 0.4}
KP, KD = 20.0, 0.5
NOISE = 2e-5


def _input(time):
    """Return a chirp up to 3 Hz, that begins and ends at rest."""
    return np.sin(2 * np.pi * (0.2 + 0.24 * time) * time) * np.minimum(1.0, time)


def _moved(hold, torque, size=1.0, seed=0):
    """Return angles at the samples: a torque of input, angle and velocity moves the joint."""
    commands = size * _input(TIME)

    def rates(time, state):
        k = int(np.searchsorted(TIME, time + 1e-9, "right")) - 1
        command = commands[k] if hold is HELD else np.interp(time, TIME, commands)
        pull = torque(command, *state) - JOINT["p2"] * state[1] - JOINT["p3"] * np.sin(state[0])
        return state[1], pull / JOINT["p1"]

    angles, state = [0.0], (0.0, 0.0)
    for begin, end in pairwise(TIME):
        step = solve_ivp(rates, (begin, end), state, rtol=1e-7, atol=1e-9, max_step=STEP)
        state = tuple(step.y[:, -1])
        angles.append(state[0])
    noise = NOISE * np.random.default_rng(seed).standard_normal(TIME.size)
    return commands, np.array(angles) + noise


@cache
def _servo(hold):
    """Return the log of a joint that a continuous loop holds at a set-point, by a fast clock."""
    commands, angles = _moved(hold, lambda goal, at, rate: KP * (goal - at) - KD * rate, 0.5)
    loop = ServoLoop.of({"law": "pid-torque", "kp": KP, "kd": KD, "clock": 1e-6})
    return Log(TIME, commands, angles, input_kind=InputKind.SETPOINT, servo=loop)


@cache
def _direct(hold, late=0):
    """Return the log of a joint that a torque moves, some samples late."""
    commands, angles = _moved(hold, lambda torque, *_: torque, 0.15)
    early = np.append(commands[late:], np.full(late, commands[-1]))
    return Log(TIME, early, angles, input_kind=InputKind.TORQUE)


def _answer(log):
    found = identify(DataSet.of([log], known=Prior.of({"p4": 1.0})))
    return found.estimate, {each.kind for each in found.estimate.findings}, found


def _assert_taken(log, hold, kind):
    """Return the estimate of a log whose input was taken so, near the truth."""
    estimate, kinds, found = _answer(log)
    assert kind in kinds
    assert [log.intersample for log in found.logs.logs] == [hold]
    for name, true in JOINT.items():
        assert estimate.named[name] == pytest.approx(true, rel=5e-3), name
    return estimate


@pytest.mark.parametrize("made", [_servo, _direct])
def test_an_input_that_goes_straight_is_taken_as_such(made):
    estimate = _assert_taken(made(STRAIGHT), STRAIGHT, FindingKind.STRAIGHT)
    assert estimate.level is Level.GOOD
    told, said, _ = _answer(replace(made(STRAIGHT), intersample=STRAIGHT))
    assert not said & {FindingKind.STRAIGHT, FindingKind.HELD}
    assert told.named == pytest.approx(estimate.named)


@pytest.mark.parametrize("made", [_servo, _direct])
def test_a_held_input_is_taken_as_such(made):
    _assert_taken(made(HELD), HELD, FindingKind.HELD)


def test_where_the_delay_takes_it_up_the_intervals_hold_both():
    """Lines two samples late are held ones one and a half late, but for the gain."""
    estimate, kinds, _ = _answer(_direct(STRAIGHT, late=2))
    assert FindingKind.HELD in kinds
    for name, true in JOINT.items():
        lower, upper = (
            dict(zip(estimate.names, limits.tolist(), strict=True))[name]
            for limits in (estimate.lower, estimate.upper)
        )
        assert lower <= true <= upper, name


def test_a_clock_that_nobody_says_is_in_the_intervals():
    log = replace(_servo(STRAIGHT), intersample=STRAIGHT)
    assumed = replace(log, servo=replace(log.servo, clock=None))
    told, open_ = (_answer(each)[0] for each in (log, assumed))
    assert open_.relative_half_widths["p2"] > 3 * told.relative_half_widths["p2"]
    index = open_.names.index("p2")
    faster = 1.001  # the loop is continuous, beyond a hundred times as fast
    assert open_.lower[index] <= faster * JOINT["p2"] <= open_.upper[index]
