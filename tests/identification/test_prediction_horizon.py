"""For how long a simulation stays near: upright, hanging, or where nothing brings it back."""

import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.estimators import OutputError, Suitable, WeakForm
from butterfly.identification.prediction_horizon import GROWTH, excess_error, horizon_of
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, JointKind, LumpedParameters
from butterfly.model.prior import Prior
from tests.identification.simulated import driven, noisy
from tests.independent.integrator import Joint, motion

TIME = np.arange(0, 20, 0.005)
ROBOT = LumpedParameters(p1=0.19, p2=0.0, p3=3.7, p4=1.0)
ZEROS = {NO_ADDED_MASS: 0.1}
STEP, SUB = 1e-3, 10
MASS, DAMPING, FRICTION, GAIN = 95.0, 200.0, 20.0, 35.0
SLIDE = AddedMass(joint=JointKind.SLIDE)


def _horizon(*angles, robot=ROBOT):
    logs = [Log(TIME, np.sin(TIME), 0.1 + each, input_kind="torque") for each in angles]
    return horizon_of(logs, robot, ZEROS)


def test_a_balance_at_the_upright_has_a_short_horizon():
    """There an error grows as cosh(t sqrt(p3/p1)); the horizon is rounded down to two digits."""
    exact = math.acosh(GROWTH) / math.sqrt(3.7 / 0.19)
    assert 0.8 * exact < _horizon(math.pi + 0.02 * np.sin(5 * TIME)) <= exact


def test_a_hand_that_hangs_or_turns_without_gravity_has_none_but_one_log_tells_for_all():
    assert _horizon(1.5 * np.sin(4 * TIME)) == math.inf
    assert _horizon(2.0 * TIME, robot=replace(ROBOT, p3=0.0)) == math.inf
    assert _horizon(0.3 * np.sin(4 * TIME), math.pi + 0.01 * np.sin(TIME)) < 1.1


@pytest.mark.parametrize("height", [1.8, 2.4])
def test_swings_that_decay_from_beyond_the_horizontal_have_none(height):
    joint = Joint(inertia=0.19, viscous=0.05, gravity=3.7, gain=1.0)
    angle, _ = motion(joint, TIME, np.zeros(TIME.size), height)
    assert _horizon(angle, robot=replace(ROBOT, p2=0.05)) == math.inf


def _program(count):
    """Positions in m of a table that goes to and fro in trapezoids of velocity."""
    time = np.arange(count) * STEP
    pace = np.clip(3 * np.sin(2 * np.pi * time / 3.1), -1, 1) * (0.08 + 0.03 * np.sin(0.9 * time))
    return np.cumsum(pace) * STEP


def _followed(ripple, noise, seconds=20.0):
    """Record a slide that follows a program by a cascade, friction changing along its way.

    Semi-implicit Euler of steps of 0.1 ms, friction taking no more than all of the velocity.
    """
    rng = np.random.default_rng(1)
    wanted = _program(int(seconds / STEP))
    x, v, before = 0.0, 0.0, 0.0
    commands, positions = np.empty(wanted.size), np.empty(wanted.size)
    for k in range(wanted.size):
        speed, before = (x - before) / STEP, x
        commands[k] = np.clip(240 * (150 * (wanted[k] - x) - speed), -10, 10)
        positions[k] = x + noise * rng.standard_normal()
        uneven = ripple * np.sin(2 * np.pi * x / 0.017 + 0.4)
        for _ in range(SUB):
            free = v + STEP / SUB * (GAIN * commands[k] - DAMPING * v) / MASS
            held = STEP / SUB * (FRICTION + uneven) / MASS
            v = np.sign(free) * max(abs(free) - held, 0.0)
            x += STEP / SUB * v
    return Log(
        time=np.arange(wanted.size) * STEP,
        input=commands,
        angle=positions,
        input_kind=InputKind.VOLTAGE,
        intersample=Intersample.ZERO_ORDER_HOLD,
        added_mass=SLIDE,
        source="slide",
    )


def _data(log):
    return DataSet.of([log], known=Prior.of({"p4": GAIN}))


def _found(log, **options):
    return OutputError(workers=1, **options)(_data(log))


def _covers(found, names=("p1", "p2", "coulomb", "delay")):
    truth = {"p1": MASS, "p2": DAMPING, "coulomb": FRICTION, "delay": 0.0}
    rows = zip(found.names, found.lower, found.upper, strict=True)
    return all(lower <= truth[name] <= upper for name, lower, upper in rows if name in names)


def _cut(found):
    return [each.number for each in found.findings if each.kind is FindingKind.ADDS_UP]


def test_friction_that_changes_along_the_way_is_not_taken_for_mass_or_delay():
    log = _followed(ripple=4.0, noise=1e-7)
    found = _found(log)
    assert _cut(found) == [0.5]
    assert _covers(found)


def test_nobody_who_names_no_method_gets_such_friction_added_up():
    assert _covers(Suitable()(_data(_followed(ripple=4.0, noise=2e-5))))


def test_logs_that_hold_nothing_but_noise_besides_are_fitted_whole():
    found = _found(_followed(ripple=0.0, noise=2e-5))
    assert not _cut(found)
    assert _covers(found, ("p1", "p2", "coulomb"))


def test_white_noise_is_one_noise_in_excess_and_a_wave_is_more():
    """Differences of white errors are sqrt(2) times as large as the errors."""
    time = np.arange(0, 30, 5e-3)
    joint = Joint(inertia=0.19, viscous=0.3, gravity=0.0, gain=1.0)
    logs = noisy([driven(joint, time, np.sin(3 * time))], 1e-3, np.random.default_rng(0))
    data = DataSet.of(logs, known=Prior.of({"p3": 0.0, "p4": 1.0}))
    found = WeakForm(terms=(), check=False)(data)
    truth = {"p1": 0.19, "p2": 0.3}
    found = replace(found, values=np.array([truth.get(name, 0.0) for name in found.names]))
    assert excess_error(data.logs[0], found, math.inf) == pytest.approx(1, abs=0.05)
    waved = replace(data.logs[0], angle=data.logs[0].angle + 5e-3 * np.sin(0.7 * time))
    assert excess_error(waved, found, math.inf) > 2
