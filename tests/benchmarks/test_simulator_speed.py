"""The kernel beside scipy's solve_ivp and bare MuJoCo, on a real log's input without friction.

And beside the plainest compiled loop that steps the same equation, with friction but no reversals.
"""

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from scipy.integrate import solve_ivp

from butterfly.identification.simulation import Simulation
from butterfly.model.greybox import simulate
from butterfly.model.parameters import LumpedParameters
from butterfly.plant.mjcf import compile_model
from butterfly.plant.robot import Robot
from butterfly.signals import hold
from tests.benchmarks.bars import SHORT
from tests.benchmarks.cpu_time import compare
from tests.benchmarks.plain_loop import swing

_START = 0.1  # rad
_SHAKEN = 0.154, 7.0  # kg, rad/s: the log that is simulated


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
    (log,) = (
        each for each in real.data.logs if (each.added_mass.mass, each.excitation.omega) == _SHAKEN
    )
    loaded = parameters.with_added_mass(log.added_mass)
    grid = Simulation(log, parameters).grid
    grid = grid[: 200 if SHORT else None]
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

        wholes = {
            "scipy's solve_ivp at the kernel's accuracy": lambda: _by_scipy(
                loaded, log, grid, tolerance
            ),
            "MuJoCo's bare rollout, RK4 at 1 ms": lambda: pool.rollout(model, [data], state, held),
        }
        again = 20  # times at once: the kernel is too fast for the clock
        compare(
            lambda: [_by_kernel(loaded, log, grid) for _ in range(again)],
            wholes,
            parts=again,
            repeats=1 if SHORT else 3,
        )


def test_terms_that_a_joint_does_not_have_cost_it_little():
    step, parameters = 0.01, LumpedParameters(p1=0.02, p2=0.03, p3=0.5, p4=1.0, coulomb=0.01)
    grid = step * np.arange(20_000)
    half = 0.4 * np.sin(4.4 * step / 2 * np.arange(2 * grid.size - 1))
    drives = np.column_stack([half[:-1:2], half[1::2], half[2::2]])
    own = parameters.p1, parameters.p2, parameters.p3, parameters.coulomb

    def bare():
        return swing(own, drives, step, _START)

    def kernel():
        return simulate(parameters, grid, drives, _START)[0]

    assert np.abs(bare() - kernel()).max() < 0.05  # reversals are all that they do not share
    compare(bare, {"the kernel of a joint with p1..p4 and Coulomb friction": kernel})
