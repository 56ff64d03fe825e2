"""Segments, against closed loops about the upright that the independent integrator simulates."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import OutputError
from butterfly.identification.free_run import FreeRun, Setting, first_horizon, horizon_of
from butterfly.identification.identify import identify
from butterfly.identification.problem import Start
from butterfly.identification.residuals import residuals_of
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import Log
from butterfly.model.greybox import Columns
from butterfly.model.kernel.differentiate import differentiate
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, JointKind, LumpedParameters
from butterfly.model.prior import Prior
from butterfly.report.summary import summary
from tests.identification.simulated import driven
from tests.identification.simulated import noisy as with_noise
from tests.independent.integrator import Joint, motion

STEP = 0.005
JOINT = Joint(inertia=0.19, viscous=0.03, gravity=3.7, gain=1.0, coulomb=0.15)
TRUTH = {"p1": 0.19, "p2": 0.03, "p3": 3.7, "coulomb": 0.15}
ROBOT = LumpedParameters(**TRUTH, p4=1.0)
START = LumpedParameters(p1=0.25, p2=0.01, p3=4.5, p4=1.0, coulomb=0.05)
KNOWN = Prior.of({"p4": 1.0})
ZEROS = {NO_ADDED_MASS: 0.0}


def _swung_up(seed, seconds=6.0):
    """A swing-up, and a balance under a PD law that hears a dither."""
    random = np.random.default_rng(seed)
    phase, rate = random.uniform(0, 6), random.uniform(5, 9)
    time = STEP * np.arange(round(seconds / STEP))
    inputs, angles = np.zeros(time.size), np.zeros(time.size)
    x, v = random.uniform(-0.3, 0.3), 0.0
    for k, t in enumerate(time):
        off, dither = math.remainder(x - math.pi, 2 * math.pi), 0.5 * math.sin(rate * t + phase)
        lacking = 2 * 3.7 - (0.5 * 0.19 * v**2 + 3.7 * (1 - math.cos(x)))
        law = -12 * off - 1.5 * v if abs(off) < 0.4 else 1.5 * lacking * math.copysign(1, v)
        inputs[k], angles[k] = float(np.clip(law, -3, 3)) + dither, x
        held = np.full(2, inputs[k])
        (_, x), (_, v) = motion(JOINT, [0.0, STEP], held, x, v)
    return Log(time, inputs, angles, input_kind="torque", name=f"swing-up {seed}")


@pytest.fixture(scope="module")
def exact():
    return [_swung_up(seed) for seed in range(2)]


@pytest.fixture(scope="module")
def noisy(exact):
    return DataSet.of(with_noise(exact, 0.003, np.random.default_rng(0)), known=KNOWN)


def _fit(logs, **options):
    estimator = OutputError(terms=(), workers=1, **options)
    return estimator.of_logs(logs, [Start(START, ZEROS)], KNOWN)


def test_noise_free_swing_ups_give_the_exact_parameters(exact):
    found = _fit(exact)
    own = math.pi * math.sqrt(0.25 / 4.5)  # without noise, errors of the simulation are to be seen
    assert any(found.horizon == pytest.approx(own / part, rel=0.02) for part in (1, 3, 9))
    values = {name: getattr(found.parameters, name) for name in TRUTH}
    assert values == pytest.approx(TRUTH, rel=1e-3)
    assert DataSet.of(exact).simulations.fits(found).min() > 99.99
    off = replace(ROBOT, p3=1.01 * ROBOT.p3)
    assert all(FreeRun.of(log, Setting(parameters=off, zero=0.0)).fit < 50 for log in exact)


def test_the_derivatives_are_those_of_the_errors_at_the_best_start(exact):
    segments = Simulation(exact[0], ROBOT, horizon=0.8)
    other = replace(ROBOT, p1=0.2)
    names, step = ["p1", "p3", "zero"], 1e-5
    errors, rows = segments.linearised(names, other, 0.0)
    assert np.sqrt(np.mean(errors**2)) < 0.05
    for k, name in enumerate(names[:2]):
        value = getattr(other, name)
        near = [
            segments.linearised([], replace(other, **{name: value + by}), 0.0)[0]
            for by in (step, -step)
        ]
        cost = [np.sum(each**2) for each in near]
        slope = 2 * errors @ rows[:, k]
        assert slope == pytest.approx((cost[0] - cost[1]) / (2 * step), rel=0.02)
    *_, effects = segments.with_starts((), other, 0.0)
    assert effects.bounds[-1] == errors.size
    moved = np.add.reduceat(effects.directions**2, effects.bounds[:-1])
    np.testing.assert_allclose(moved, [[1, 0], *[[1, 1]] * (len(moved) - 1)])  # the first at rest


def test_what_is_simulated_does_not_depend_on_what_was_asked_before(exact):
    far = replace(ROBOT, p1=0.3, p3=4.5)
    fresh, used = (Simulation(exact[0], ROBOT, horizon=0.8) for _ in range(2))
    used.run(far, 0.0)
    mine, own = (each.run(ROBOT, 0.0).at(exact[0].time) for each in (used, fresh))
    np.testing.assert_array_equal(mine, own)
    for mine, own in zip(*(s.linearised(["p1"], ROBOT, 0.0) for s in (used, fresh)), strict=True):
        np.testing.assert_array_equal(mine, own)


def test_some_segments_are_simulated_as_all_are_and_nothing_is_compiled_for_them(exact):
    simulation = Simulation(exact[0], ROBOT, horizon=0.8)
    segments, begins = simulation.segments, simulation.begins
    columns = Columns.of(("p1",), ROBOT, exact[0].added_mass)
    errors, rows = segments.linearised(columns, 0.0, begins)
    compiled = len(differentiate.nopython_signatures)
    some = segments.linearised(columns, 0.0, begins[[1, 3]], [1, 3])
    mask = segments.errors_of([1, 3], columns.joint)
    np.testing.assert_array_equal(some[0], errors[mask])
    np.testing.assert_array_equal(some[1], rows[mask])
    assert len(differentiate.nopython_signatures) == compiled


def test_a_joint_that_sticks_has_a_start_that_only_its_angle_moves():
    time = STEP * np.arange(400)
    moving = 0.3 * np.sin(np.maximum(time - 1.0, 0.0))
    log = Log(time, np.zeros(400), moving, input_kind="torque")
    stuck = LumpedParameters(p1=0.19, p2=0.03, p3=0.1, p4=1.0, coulomb=0.5)
    effects = Simulation(log, stuck, horizon=0.5).with_starts((), stuck, 0.0)[-1]
    assert np.sum(effects.directions[: effects.bounds[1]] ** 2, axis=0) == pytest.approx([1, 0])


def test_logs_from_rest_are_simulated_whole_and_pieces_from_fitted_starts_after_what_came():
    time = STEP * np.arange(800)
    log = driven(JOINT, time, 0.5 * np.sin(3 * time))
    free, known = (Setting(parameters=ROBOT, zero=0.0, velocity=each) for each in (None, 0.1))
    assert not free.simulation(log).fitted
    assert free.simulation(log.piece(200, 800)).fitted
    assert not known.simulation(log.piece(200, 800)).fitted
    time = STEP * np.arange(1000)
    whole = driven(JOINT._replace(delay=0.06), time, 1.2 * np.sign(np.sin(4 * time)))
    late = replace(free, parameters=replace(ROBOT, delay=0.06))
    for first in range(120, 400, 40):
        assert FreeRun.of(whole.piece(first, first + 500), late).fit > 99.9


def test_the_judgement_sees_segments_and_says_so(noisy):
    found = identify(noisy, OutputError(terms=(), workers=1))
    places = [found.estimate.names.index(name) for name in TRUTH]
    truth = np.array(list(TRUTH.values()))
    assert (found.estimate.lower[places] <= truth).all()
    assert (truth <= found.estimate.upper[places]).all()
    said = summary(found)
    assert said[0].startswith("Good")
    assert found.fit.over == " over segments of 0.71 s"  # half a period of small swings
    assert any("and a fitted initial state every 0.71 s" in each for each in said)
    assert found.fit.median > 99
    assert not residuals_of(noisy, found.estimate).beyond_sensors


def test_a_horizon_that_is_told_goes_before_and_is_saved(exact):
    found = _fit(exact[:1], horizon=0.5)
    assert found.horizon == 0.5
    assert math.isinf(_fit(exact[:1], horizon=0).horizon)
    for horizon in (None, 0.5, math.inf):
        content = json.loads(json.dumps(replace(found, horizon=horizon).to_dict()))
        assert Estimate.from_dict(content).horizon == horizon
    assert Estimate.from_dict({k: v for k, v in content.items() if k != "horizon"}).horizon is None


def test_logs_that_were_left_out_have_starts_of_their_own(noisy):
    held = DataSet.of(noisy.logs[1:])
    assert held.simulations.fits(_fit(noisy.logs[:1])).min() > 99


TIME = np.arange(0, 20, 0.005)
PENDULUM = LumpedParameters(p1=0.19, p2=0.0, p3=3.7, p4=1.0)
HANGING = {NO_ADDED_MASS: 0.1}
TICK, SUB = 1e-3, 10
MASS, DAMPING, FRICTION, GAIN = 95.0, 200.0, 20.0, 35.0
SLIDE = AddedMass(joint=JointKind.SLIDE)


def _horizon(*logs, robot=PENDULUM, of=horizon_of):
    return of(logs, robot, HANGING)


def _log(angle):
    """Return a log of an angle that no torque explains."""
    return Log(TIME, np.sin(TIME), 0.1 + angle, input_kind="torque")


def test_a_balance_at_the_upright_is_simulated_over_half_a_period_of_small_swings():
    """In which an error grows e^pi-fold there."""
    balance = _log(math.pi + 0.02 * np.sin(5 * TIME))
    half = pytest.approx(math.pi / math.sqrt(3.7 / 0.19), rel=0.01)
    assert _horizon(balance, of=first_horizon) == half
    assert _horizon(_log(0.3 * np.sin(4 * TIME)), balance, of=first_horizon) < 1.0
    assert _horizon(balance) == math.inf  # gravity moves it so, but the torque does not


def test_values_of_a_swing_up_are_judged_over_segments_if_these_leave_but_noise(noisy):
    assert horizon_of(noisy.logs, ROBOT, ZEROS) == pytest.approx(0.71, rel=0.01)
    heavy = replace(ROBOT, p1=100 * ROBOT.p1, p3=100 * ROBOT.p3)
    assert first_horizon(noisy.logs, heavy, ZEROS) == pytest.approx(0.71, rel=0.01)
    assert horizon_of(noisy.logs, heavy, ZEROS) == math.inf


def test_a_run_that_is_followed_and_a_hand_that_hangs_are_simulated_whole():
    assert _horizon(_log(1.5 * np.sin(4 * TIME))) == math.inf  # gravity holds it, followed or not
    turning = JOINT._replace(viscous=1.0)
    robot = replace(PENDULUM, p2=1.0, coulomb=JOINT.coulomb)
    followed = driven(turning, TIME, 6.0 + np.sin(TIME))  # it turns over all the time
    followed = replace(followed, angle=0.1 + followed.angle)
    assert np.ptp(followed.angle) > 10 * math.pi
    assert _horizon(followed, robot=robot) == math.inf
    assert _horizon(followed, robot=replace(robot, p2=3.0), of=first_horizon) < 1.0


def test_a_joint_that_nothing_holds_is_simulated_over_the_time_in_which_its_speed_settles():
    """Or a period of its motion, if that is shorter, or whole if its run is followed."""
    free = replace(PENDULUM, p3=0.0, p2=0.19)
    assert _horizon(_log(np.sin(2 * math.pi * TIME / 10)), robot=free) == pytest.approx(
        2 * math.pi, rel=0.01
    )
    assert _horizon(_log(np.sin(2 * math.pi * TIME / 4)), robot=free) == pytest.approx(4.0)
    slowly = replace(PENDULUM, p3=1e-6)  # gravity that does not bring it back in 20 s holds nothing
    assert _horizon(_log(np.sin(2 * math.pi * TIME / 4)), robot=slowly) == pytest.approx(4.0)
    assert (
        _horizon(
            driven(Joint(inertia=0.19, viscous=0.19, gravity=0.0, gain=1.0), TIME, np.sin(TIME)),
            robot=free,
        )
        == math.inf
    )


@pytest.mark.parametrize("height", [1.8, 2.4])
def test_swings_that_decay_from_beyond_the_horizontal_are_simulated_whole(height):
    joint = Joint(inertia=0.19, viscous=0.05, gravity=3.7, gain=1.0)
    angle, _ = motion(joint, TIME, np.zeros(TIME.size), height)
    assert _horizon(_log(angle), robot=replace(PENDULUM, p2=0.05)) == math.inf


def _program(count):
    """Positions in m of a table that goes to and fro in trapezoids of velocity."""
    time = np.arange(count) * TICK
    pace = np.clip(3 * np.sin(2 * np.pi * time / 3.1), -1, 1) * (0.08 + 0.03 * np.sin(0.9 * time))
    return np.cumsum(pace) * TICK


def _followed(ripple, noise, seconds=20.0):
    """Record a slide that follows a program by a cascade, friction changing along its way.

    Semi-implicit Euler of steps of 0.1 ms, friction taking no more than all of the velocity.
    """
    rng = np.random.default_rng(1)
    wanted = _program(int(seconds / TICK))
    x, v, before = 0.0, 0.0, 0.0
    commands, positions = np.empty(wanted.size), np.empty(wanted.size)
    for k in range(wanted.size):
        speed, before = (x - before) / TICK, x
        commands[k] = np.clip(240 * (150 * (wanted[k] - x) - speed), -10, 10)
        positions[k] = x + noise * rng.standard_normal()
        uneven = ripple * np.sin(2 * np.pi * x / 0.017 + 0.4)
        for _ in range(SUB):
            free = v + TICK / SUB * (GAIN * commands[k] - DAMPING * v) / MASS
            held = TICK / SUB * (FRICTION + uneven) / MASS
            v = np.sign(free) * max(abs(free) - held, 0.0)
            x += TICK / SUB * v
    return Log(np.arange(wanted.size) * TICK, commands, positions, added_mass=SLIDE, source="slide")


def test_friction_that_changes_along_the_way_is_not_taken_for_mass_or_delay():
    log = _followed(ripple=4.0, noise=2e-5)
    found = OutputError()(DataSet.of([log], known=Prior.of({"p4": GAIN})))
    assert found.method == "output error"
    parts = 3.1 / found.horizon  # a period, or parts that leave but noise: nothing holds the table
    assert any(parts == pytest.approx(each, rel=0.1) for each in (1, 3, 9, 27))
    for name, truth in {"p1": MASS, "p2": DAMPING, "coulomb": FRICTION, "delay": 0.0}.items():
        at = found.names.index(name)
        assert found.lower[at] <= truth <= found.upper[at], name


def test_a_log_of_millions_of_seconds_is_refused_before_it_fills_the_memory():
    """Its stamps are microseconds that nobody calls so."""
    time = 5000.0 * np.arange(900)
    log = Log(time, np.sin(time), np.cos(time), source="micro.csv")
    with pytest.raises(InputError, match=r"micro.csv: time: got 4.5e\+06 s, which takes .* steps"):
        FreeRun.of(log, Setting(parameters=ROBOT, zero=0.0))
