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
from tests.independent.integrator import Joint, motion

TIME = np.arange(0, 20, 0.005)
ROBOT = LumpedParameters(p1=0.19, p2=0.0, p3=3.7, p4=1.0)
ZEROS = {NO_ADDED_MASS: 0.1}
STEP, SUB = 1e-3, 10
MASS, DAMPING, FRICTION, GAIN = 95.0, 200.0, 20.0, 35.0
SLIDE = AddedMass(joint=JointKind.SLIDE)


def _horizon(angle, robot=ROBOT):
    log = Log(TIME, np.sin(TIME), 0.1 + angle, input_kind="torque")
    return horizon_of([log], robot, ZEROS)


def test_a_balance_at_the_upright_has_a_short_horizon():
    """There an error grows as cosh(t sqrt(p3/p1)); the horizon is rounded down to two digits."""
    exact = math.acosh(GROWTH) / math.sqrt(3.7 / 0.19)
    assert 0.8 * exact < _horizon(math.pi + 0.02 * np.sin(5 * TIME)) <= exact


def test_a_hand_that_hangs_or_turns_without_gravity_has_none():
    assert _horizon(1.5 * np.sin(4 * TIME)) == math.inf
    assert _horizon(2.0 * TIME, LumpedParameters(p1=0.19, p2=0.0, p3=0.0, p4=1.0)) == math.inf


@pytest.mark.parametrize("height", [1.8, 2.4])
def test_swings_that_decay_from_beyond_the_horizontal_have_none(height):
    joint = Joint(inertia=0.19, viscous=0.05, gravity=3.7, gain=1.0)
    angle, _ = motion(joint, TIME, np.zeros(TIME.size), height)
    assert _horizon(angle, replace(ROBOT, p2=0.05)) == math.inf


def test_one_log_that_diverges_tells_for_all():
    calm = Log(TIME, np.sin(TIME), 0.1 + 0.3 * np.sin(4 * TIME), input_kind="torque")
    wild = Log(TIME, np.sin(TIME), 0.1 + math.pi + 0.01 * np.sin(TIME), input_kind="torque")
    assert horizon_of([calm], ROBOT, ZEROS) == math.inf
    assert horizon_of([calm, wild], ROBOT, ZEROS) < 1.1


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
        velocity=None,
        input_kind=InputKind.VOLTAGE,
        intersample=Intersample.ZERO_ORDER_HOLD,
        added_mass=SLIDE,
        excitation=None,
        source="slide",
    )


def _data(log):
    return DataSet.of([log], known=Prior.of({"p4": GAIN}))


def _found(log, **options):
    return OutputError(workers=1, **options)(_data(log))


def _covers(found, **truth):
    rows = zip(found.names, found.lower, found.upper, strict=True)
    bands = {name: (low, high) for name, low, high in rows}
    return {name: bands[name][0] <= value <= bands[name][1] for name, value in truth.items()}


def _cut(found):
    return [each.number for each in found.findings if each.kind is FindingKind.ADDS_UP]


def test_friction_that_changes_along_the_way_is_not_taken_for_mass_or_delay():
    log = _followed(ripple=4.0, noise=1e-7)
    truth = {"p1": MASS, "p2": DAMPING, "coulomb": FRICTION, "delay": 0.0}
    found, whole = _found(log), _found(log, horizon=0)
    assert _cut(found) == [0.5]
    assert all(_covers(found, **truth).values())
    assert not all(_covers(whole, **truth).values())


def test_nobody_who_names_no_method_gets_such_friction_added_up():
    uneven, even = (_followed(ripple=ripple, noise=2e-5) for ripple in (4.0, 0.0))
    assert isinstance(Suitable().suited(_data(uneven)), WeakForm)
    assert isinstance(Suitable().suited(_data(even)), OutputError)
    truth = {"p1": MASS, "p2": DAMPING, "coulomb": FRICTION, "delay": 0.0}
    assert all(_covers(Suitable()(_data(uneven)), **truth).values())


def test_logs_that_hold_nothing_but_noise_besides_are_fitted_whole():
    found = _found(_followed(ripple=0.0, noise=2e-5))
    assert not _cut(found)
    assert all(_covers(found, p1=MASS, p2=DAMPING, coulomb=FRICTION).values())


def test_white_noise_is_one_noise_in_excess_and_a_wave_is_more():
    """Differences of white errors are sqrt(2) times as large as the errors."""
    time = np.arange(0, 30, 5e-3)
    joint = Joint(inertia=0.19, viscous=0.3, gravity=0.0, gain=1.0)
    inputs = np.sin(3 * time)
    angle, _ = motion(joint, time, inputs)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(time.size)
    data = DataSet.of(
        [Log(time, inputs, angle + noise, input_kind="torque")],
        known=Prior.of({"p3": 0.0, "p4": 1.0}),
    )
    found = WeakForm(terms=(), check=False)(data)
    found = replace(
        found, values=np.array([{"p1": 0.19, "p2": 0.3}.get(name, 0.0) for name in found.names])
    )
    assert excess_error(data.logs[0], found, math.inf) == pytest.approx(1, abs=0.05)
    waved = replace(data.logs[0], angle=data.logs[0].angle + 5e-3 * np.sin(0.7 * time))
    assert excess_error(waved, found, math.inf) > 2
