"""The kernel beside scipy's solve_ivp and bare MuJoCo, on a real log's input without friction.

And beside the plainest compiled loop that steps the same equation, with friction but no reversals.
"""

import math

import mujoco
import numba
import numpy as np
from mujoco.rollout import Rollout
from scipy.integrate import solve_ivp

from butterfly.identification.simulation import Simulation
from butterfly.model.greybox import simulate
from butterfly.model.parameters import LumpedParameters
from butterfly.plant.mjcf import compile_model
from butterfly.plant.robot import Robot
from butterfly.signals import hold
from tests.benchmarks.bars import SHORT, measured
from tests.benchmarks.cpu_time import least_seconds

_START = 0.1  # rad
_LOG = 35  # 154 g at 7 rad/s
_AGAIN = 20  # times at once: the kernel is too fast for the clock


def _by_kernel(loaded, log, grid):
    """The angle on a grid, the input's delivery included."""
    inputs = hold.parabolas(log.time, log.input, grid, log.intersample)[0]
    return simulate(loaded, grid, inputs, _START)[0]


def _by_scipy(loaded, log, grid, tolerance):
    """The same; LSODA needs the least time of scipy's methods for this accuracy."""

    def rates(time, state):
        angle, velocity = state
        torque = loaded.p4 * np.interp(time, log.time, log.input)
        pull = loaded.p2 * velocity + loaded.p3 * np.sin(angle)
        return velocity, (torque - pull) / loaded.p1

    span, start = (grid[0], grid[-1]), (_START, 0.0)
    tolerances = {"rtol": tolerance, "atol": 0.01 * tolerance}
    return solve_ivp(rates, span, start, method="LSODA", t_eval=grid, **tolerances).y[0]


def _least_accurate(loaded, log, grid, exact, error):
    """The loosest tolerance at which scipy is as accurate."""
    for tolerance in 10.0 ** np.arange(-7, -12, -0.5):
        if np.abs(_by_scipy(loaded, log, grid, tolerance) - exact).max() <= error:
            return tolerance
    raise AssertionError("solve_ivp does not reach the kernel's accuracy")


def test_scipy_and_mujoco_need_hundreds_of_times_the_kernel_s_time(real):
    found = real.estimate.parameters
    parameters = LumpedParameters(p1=found.p1, p2=found.p2, p3=found.p3, p4=found.p4)
    log = real.data.logs[_LOG]
    loaded = parameters.with_added_mass(log.added_mass)
    grid = Simulation(log, parameters).grid
    stamps = np.union1d(grid, log.time)
    fine = np.union1d(stamps, 0.5 * (stamps[1:] + stamps[:-1]))
    exact = _by_kernel(loaded, log, fine)[np.searchsorted(fine, grid)]
    error = np.abs(_by_kernel(loaded, log, grid) - exact).max()
    tolerance = _least_accurate(loaded, log, grid, exact, error)

    model = compile_model(Robot.of_lumped(parameters), log.added_mass)
    model.opt.timestep = 1e-3
    data = mujoco.MjData(model)
    data.qpos[0] = _START
    state = np.zeros((1, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    mujoco.mj_getState(model, data, state[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    ticks = np.arange(grid[0], grid[-1], 1e-3)
    held = np.interp(ticks + 5e-4, log.time, log.input)[None, :, None]
    with Rollout(nthread=0) as pool:
        states, _ = pool.rollout(model, [data], state, held)
        moved = np.interp(grid[1:-1], ticks + 1e-3, states[0, :, 1])
        assert np.abs(moved - exact[1:-1]).max() < 0.01

        kernel, scipy, rollout = least_seconds(
            lambda: [_by_kernel(loaded, log, grid) for _ in range(_AGAIN)],
            lambda: _by_scipy(loaded, log, grid, tolerance),
            lambda: pool.rollout(model, [data], state, held),
            repeats=1 if SHORT else 3,
        )
    kernel /= _AGAIN
    measured("scipy's solve_ivp at the kernel's accuracy", scipy / kernel)
    measured("MuJoCo's bare rollout, RK4 at 1 ms", rollout / kernel)


@numba.njit(error_model="numpy")
def _bare_loop(parameters, drives, step, angle):
    """Runge-Kutta of order 4, friction a sign."""
    p1, p2, p3, coulomb = parameters
    found = np.empty(len(drives) + 1)
    found[0], x, v = angle, angle, 0.0
    for k in range(len(drives)):
        a1 = (drives[k, 0] - p2 * v - p3 * math.sin(x) - coulomb * np.sign(v)) / p1
        v2 = v + 0.5 * step * a1
        a2 = drives[k, 1] - p2 * v2 - p3 * math.sin(x + 0.5 * step * v) - coulomb * np.sign(v2)
        v3 = v + 0.5 * step * a2 / p1
        a3 = drives[k, 1] - p2 * v3 - p3 * math.sin(x + 0.5 * step * v2) - coulomb * np.sign(v3)
        v4 = v + step * a3 / p1
        a4 = drives[k, 2] - p2 * v4 - p3 * math.sin(x + step * v3) - coulomb * np.sign(v4)
        x += step / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v += step / 6 * (a1 + (2 * a2 + 2 * a3 + a4) / p1)
        found[k + 1] = x
    return found


def test_terms_that_a_joint_does_not_have_cost_it_little():
    step, parameters = 0.01, LumpedParameters(p1=0.02, p2=0.03, p3=0.5, p4=1.0, coulomb=0.01)
    grid = step * np.arange(20_000)
    half = 0.4 * np.sin(4.4 * step / 2 * np.arange(2 * grid.size - 1))
    drives = np.column_stack([half[:-1:2], half[1::2], half[2::2]])
    own = parameters.p1, parameters.p2, parameters.p3, parameters.coulomb

    def bare():
        return _bare_loop(own, drives, step, _START)

    def kernel():
        return simulate(parameters, grid, drives, _START)[0]

    assert np.abs(bare() - kernel()).max() < 0.05  # reversals are all that they do not share
    plainest, whole = least_seconds(bare, kernel)
    measured("the kernel of a joint with p1..p4 and Coulomb friction", whole / plainest)
