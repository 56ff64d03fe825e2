"""Derivatives of simulations, against differences of simulations and an independent integrator."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from butterfly.errors import InputError
from butterfly.logs.log import Intersample
from butterfly.model.greybox import INITIAL, Columns, Readings, differentiate, simulate
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.terms import BASE_TERMS, BEYOND_MUJOCO, LOOP_TERMS, TERMS
from butterfly.signals import hold
from tests.model.joints import BRISTLES, LAG, PENDULUM, SLIDING, agrees, angle_readings, instants

ADDED = AddedMass(mass=0.05, arm=0.104)
SLOW = {"back_emf": 3e-4, "time_constant": 0.0213}
STICKY = {"coulomb": 4e-3}
GEAR = {"motor_friction": 0.2, "load_friction": 0.15, "motor_stribeck": 0.1}
GEAR |= {"load_stribeck": 0.05, "lifting_stribeck": 2.0, "lowering_stribeck": 1.0}
BASE = {"base_compliance": 2e-3, "base_frequency": 25.0, "base_damping": 0.3}
FRICTION = ("coulomb", "load", "stribeck")
NONE = dict.fromkeys(FRICTION, 0.0)
REGIMES = {
    "sliding": (SLIDING, 1.0),
    "sticking": (replace(SLIDING, **STICKY), 0.5),
    "uneven": (replace(SLIDING, coulomb_slope=6e-4, load_drag=1e-4), 1.0),
    "uneven, sticking": (replace(SLIDING, **STICKY, coulomb_slope=-2e-3), 0.5),
    "lag": (replace(SLIDING, **LAG), 1.0),
    "lag, sticking": (replace(SLIDING, **SLOW, **STICKY), 0.5),
    "gear": (replace(SLIDING, **GEAR), 1.0),
    "gear, sticking": (replace(SLIDING, **GEAR, **STICKY), 0.5),
    "gear, dry by torque alone": (replace(SLIDING, **GEAR, **NONE), 0.5),
    "gear, lag, sticking": (replace(SLIDING, **GEAR, **SLOW, **STICKY), 0.5),
    "bristles": (replace(SLIDING, **BRISTLES), 1.0),
    "lag and bristles": (replace(SLIDING, **LAG, **BRISTLES), 1.0),
    "base": (replace(SLIDING, **BASE), 1.0),
    "base, sticking": (replace(SLIDING, **BASE, **STICKY), 0.5),
    "no friction": (replace(SLIDING, **NONE), 1.0),
}
FREE = REGIMES["no friction"][0]
INVERSE = ["lifting_stribeck", "lowering_stribeck", "base_compliance"]
START = (0.3, 0.1)
GRID = np.arange(0, 4.0, 0.01)


class _Log:
    """An input at irregular stamps, and the simulation that it drives."""

    def __init__(self, scale=1.0, seed=0, intersample=Intersample.ZERO_ORDER_HOLD, grid=GRID):
        clock = np.random.default_rng(seed)
        self.time = np.cumsum(clock.uniform(0.001, 0.003, 1 + int(grid[-1] / 0.002)))
        self.input = 0.5 * scale * np.sin(4 * self.time)
        self.slow = self.time > self.time[-1] / 2
        self.intersample, self.grid = intersample, grid
        self.readings = angle_readings(grid.size - 1)

    def angles(self, parameters, start=START):
        inputs = self._parabolas(parameters.delivered(self.input), parameters)[0]
        return simulate(parameters.with_added_mass(ADDED), self.grid, inputs, *start)[0][1:]

    def sensitivities(self, names, parameters, added=ADDED, *, exact=True):
        """Return (n - 1,) angles and their (n - 1, k) derivatives by the names."""
        p, columns = parameters, Columns.of(names, parameters, added, exact=exact)
        slopes = [self._parabolas(each, p)[:1] for each in p.slopes(self.input).values()]
        delivered = p.delivered(self.input)
        late = np.cumsum(np.diff(delivered, prepend=delivered[0]) * self.slow)
        slow = self._parabolas(late, p)[1:]
        inputs = np.concatenate([self._parabolas(p.delivered(self.input), p), slow, *slopes])
        return differentiate(self.grid, inputs, START, self.readings, columns)[:2]

    def _parabolas(self, inputs, parameters):
        shifted, time = self.grid - parameters.delay, self.time + parameters.slow_delay * self.slow
        return hold.parabolas(time, inputs, shifted, self.intersample)

    def moved(self, name, by, parameters):
        """Return the angles after one parameter was moved."""
        if name in INITIAL:
            moves = {"zero": (-by, 0.0), "velocity": (0.0, by)}[name]
            return self.angles(parameters, np.add(START, moves))
        return self.angles(replace(parameters, **{name: getattr(parameters, name) + by}))


def _differentiable(p):
    """Return all names by which there is a derivative."""
    without = set() if p.time_constant else {"time_constant", "back_emf"}
    without |= {*LOOP_TERMS, "slow_interval"}  # of no joint that its input drives
    without |= {*BEYOND_MUJOCO} if p.bristle_stiffness else {"bristle_stiffness", "bristle_damping"}
    without |= {*GEAR} if p.base_gives else {*BASE_TERMS}
    without |= set() if p.coulomb else {*FRICTION, "coulomb_slope"}
    without |= set() if p.motor_friction else {*GEAR}  # not below 0, whose derivative it has there
    return [name for name in (*TERMS, *INITIAL) if name not in without]


@pytest.mark.parametrize(
    ("regime", "intersample"),
    [(regime, Intersample.ZERO_ORDER_HOLD) for regime in REGIMES]
    + [(regime, Intersample.FIRST_ORDER_HOLD) for regime in ("sliding", "lag, sticking")],
)
def test_derivatives_by_every_row_are_those_of_differences_of_simulations(regime, intersample):
    parameters, scale = REGIMES[regime]
    log = _Log(scale, intersample=intersample)
    names = _differentiable(parameters)
    values, rows = log.sensitivities(names, parameters)
    np.testing.assert_array_equal(values, log.angles(parameters))
    allowed = {"delay": 1e-3, "slow_delay": 2e-3}
    for name, row in zip(names, rows.T, strict=True):
        size = abs(getattr(parameters, name, 0.0)) or 1e-3
        steps = [share * size for share in (1e-5, 1e-6, 1e-4, 1e-7)]
        moved = partial(log.moved, name, parameters=parameters)
        assert agrees(row, moved, steps, allowed.get(name, 1e-5)), name
        moves = parameters.stribeck or name != "stribeck_velocity"
        assert np.linalg.norm(row) > 0 or not moves


def test_without_friction_the_derivative_by_it_is_that_of_friction_that_begins():
    log = _Log()
    values, rows = log.sensitivities((*FRICTION, *GEAR), FREE)
    np.testing.assert_allclose(values, log.angles(FREE), atol=1e-7)  # split at reversals
    for name, row in zip((*FRICTION, *GEAR), rows.T, strict=True):
        moved = partial(log.moved, name, parameters=FREE)
        assert agrees(row, moved, (1e-6, 1e-7, 1e-8), at_0=values), name


@pytest.mark.parametrize("joint", [SLIDING, replace(SLIDING, **STICKY)])
def test_the_derivative_by_a_compliance_of_0_is_that_of_a_base_that_begins_to_give(joint):
    log = _Log(0.5, grid=np.arange(0, 2.5, 0.005))
    names = ["base_compliance", *GEAR]
    values, (row, *gears) = (each.T for each in log.sensitivities(names, joint))
    np.testing.assert_allclose(values, log.angles(joint), atol=1e-12)
    alone = log.sensitivities(list(GEAR), joint)[1].T
    np.testing.assert_allclose(gears, alone, atol=1e-7 * np.abs(alone).max())
    moved = partial(log.moved, "base_compliance", parameters=joint)
    assert agrees(row, moved, (1e-8,), at_0=values)


def test_what_a_base_would_add_is_that_derivative_the_nearer_the_shorter_the_steps():
    sizes, names = (0.01, 0.005), ["p3", "base_compliance", *BASE_TERMS[1:]]
    logs = [_Log(grid=np.arange(0, 2.5, size)) for size in sizes]
    ways = [[log.sensitivities(names, SLIDING, exact=way)[1] for way in (0, 1)] for log in logs]
    errors = [np.linalg.norm(quick - exact) / np.linalg.norm(exact) for quick, exact in
              ((quick[:, 1], exact[:, 1]) for quick, exact in ways)]  # fmt: skip
    assert errors[1] < 0.6 * errors[0] < 0.003
    for quick, exact in ways:
        np.testing.assert_allclose(quick[:, 0], exact[:, 0], rtol=1e-3, atol=1e-5)
        assert not quick[:, 2:].any()


@pytest.mark.parametrize(("coulomb", "stribeck"), [(-1e-3, 3e-3), (-1e-3, -1e-3), (2e-3, -3e-3)])
def test_friction_below_0_that_an_estimator_tries_has_the_derivative_of_what_is_simulated(
    coulomb, stribeck
):
    tried, log = replace(SLIDING, load=0.0, coulomb=coulomb, stribeck=stribeck), _Log()
    _, rows = log.sensitivities(FRICTION, tried)
    for name, row in zip(FRICTION, rows.T, strict=True):
        moved = partial(log.moved, name, parameters=tried)
        assert agrees(row, moved, (1e-6, 1e-7, 1e-8)), name


def test_back_emf_without_a_lag_is_viscous_friction_that_p2_has_already():
    _, rows = _Log().sensitivities(["back_emf", "p2"], SLIDING)
    assert np.abs(rows[:, 0]).max() < 1e-12 * np.abs(rows[:, 1]).max()


@pytest.mark.parametrize("seed", range(20))
def test_in_any_direction_any_robot_has_the_derivative_of_a_difference(seed):
    random = np.random.default_rng(seed)
    values = {
        name: value * random.uniform(0.5, 2)
        for name, value in vars(SLIDING).items()
        if value and name not in LOOP_TERMS
    }
    lag, stiffness = random.choice([0.0, 0.0123]), random.choice([0.0, 0.0, 3.0])
    values |= {"coulomb": random.uniform(1e-4, 6e-3), "bristle_stiffness": stiffness}
    robot = LumpedParameters(**values | {"time_constant": lag, "back_emf": 3e-4 if lag else 0.0})
    log = _Log(random.uniform(0.2, 2.0), seed, grid=np.arange(0, 2, 0.01))
    names = [
        name
        for name in TERMS
        if getattr(robot, name) and name not in {"delay", *INITIAL, *LOOP_TERMS}
    ]
    way = {name: getattr(robot, name) * random.normal() for name in names}

    def moved(h):
        return log.angles(replace(robot, **{n: getattr(robot, n) + h * way[n] for n in names}))

    near, nearer = ((moved(h) - moved(-h)) / (2 * h) for h in (1e-6, 2e-7))
    size = np.linalg.norm(near)
    if np.linalg.norm(near - nearer) > 1e-6 * size:
        return  # events change their order, which has no derivative
    _, rows = log.sensitivities(names, robot)
    assert np.linalg.norm(rows @ list(way.values()) - near) < 1e-5 * size


@pytest.mark.parametrize("regime", REGIMES)
def test_scaling_all_torques_and_the_inertia_together_moves_nothing(regime):
    """It is the factor that only a known added mass tells."""
    parameters, scale = REGIMES[regime]
    names = ["p1", "p2", "p3", "p3_offset", "p4", "coulomb", "stribeck", "drag", "bias", "spring"]
    names += ["cogging", "cogging_cosine", "back_emf", "bristle_stiffness", "bristle_damping"]
    names += ["coulomb_slope", *INVERSE]
    names = [name for name in names if getattr(parameters, name)]
    _, rows = _Log(scale).sensitivities(names, parameters, added=NO_ADDED_MASS)
    effects = rows * [getattr(parameters, name) * (-1) ** (name in INVERSE) for name in names]
    assert np.abs(effects.sum(axis=1)).max() < 1e-10 * np.abs(effects).max()


def test_they_solve_the_variational_equations_as_another_integrator_does():
    p, (angle, velocity) = PENDULUM, START
    names = ["p1", "p2", "p3", "p4", "bias", "zero", "velocity"]
    time = np.arange(0, 5.0005, 1e-3)
    inputs = 0.5 * np.sin(4 * instants(time))

    def rates(t, state):
        x, v = state[:2]
        u = 0.5 * math.sin(4 * t)
        a = (p.p4 * u - p.p2 * v - p.p3 * math.sin(x)) / p.p1
        forced = np.array([-a, -v, -math.sin(x), u, 1.0, 0.0, 0.0]) / p.p1
        by_x, by_v = state[2:].reshape(2, -1)
        by_a = (-p.p2 * by_v - p.p3 * math.cos(x) * by_x) / p.p1 + forced
        return [v, a, *by_v, *by_a]

    begin = np.zeros((2, 7))
    begin[0, 5], begin[1, 6] = -1.0, 1.0
    start = [angle, velocity, *begin.ravel()]
    at = time[1::100]
    expected = solve_ivp(rates, time[[0, -1]], start, "DOP853", at, rtol=1e-12, atol=1e-12).y[2:9]
    columns, readings = Columns.of(names, p), angle_readings(time.size - 1)
    _, rows, *_ = differentiate(time, inputs[None], (angle, velocity), readings, columns)
    found = rows[::100].T
    errors = np.linalg.norm(found - expected, axis=1) / np.linalg.norm(expected, axis=1)
    assert errors.max() < 1e-8


def test_readings_are_sums_over_the_state_at_both_ends_of_single_intervals():
    random, count = np.random.default_rng(2), GRID.size - 1
    inputs = random.normal(size=(count, 3))
    loaded, columns = SLIDING.with_added_mass(ADDED), Columns.of(["p1", "coulomb"], SLIDING, ADDED)
    angle, velocity = simulate(loaded, GRID, inputs, *START)
    into, read = np.full(count, -1), np.array([3, 4, 100, 398])
    into[read] = [2, 0, 3, 1]
    weights = random.normal(size=(4, 4))

    def readings(into, weights):
        each = Readings(into=into, weights=weights)
        return differentiate(GRID, inputs[None], START, each, columns)[:2]

    units = [np.repeat(unit[:, None], count, axis=1) for unit in np.eye(4)]
    single = np.array([readings(np.arange(count), unit)[1] for unit in units])
    values, rows = readings(into, weights)
    ends = np.array([angle[read], velocity[read], angle[read + 1], velocity[read + 1]])
    own = weights[:, into[read]]
    np.testing.assert_allclose(values[into[read]], (ends * own).sum(axis=0), rtol=1e-12)
    summed = (single[:, read] * own[:, :, None]).sum(axis=0)
    np.testing.assert_allclose(rows[into[read]], summed, rtol=1e-12)
    np.testing.assert_array_equal(single[0, 1:], single[2, :-1])  # an interval begins as one ends


def test_what_has_no_derivative_is_refused():
    found = {"colomb": "coulomb", "viscous": "one of", "time_constant": "more than 0 s"}
    found |= dict.fromkeys(("bristle_stiffness", "bristle_damping"), "more than 0")
    for name, message in found.items():
        with pytest.raises(InputError, match=message):
            Columns.of(["p1", name], SLIDING)
