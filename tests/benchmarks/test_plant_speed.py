"""What plant, sweeps and controller cost beside bare MuJoCo, and our kernel beside other loops."""

import time
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from scipy.integrate import solve_ivp

from butterfly.identification.segments import Segments
from butterfly.logs.log import Sine
from butterfly.model.energy import Orbit
from butterfly.model.greybox import simulate
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.orbit.controller import EnergyShaping, gain_for
from butterfly.plant.joints import steps_of
from butterfly.plant.mjcf import compile_model, text_of
from butterfly.plant.motor import Reading
from butterfly.plant.rig import Rig
from butterfly.plant.robot import Robot
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Clock
from butterfly.signals import hold
from butterfly.twin.stand_alone import stand_alone
from butterfly.twin.twin import Twin
from tests.benchmarks.bars import SHORT
from tests.benchmarks.cpu_time import compare, least_seconds
from tests.benchmarks.plain_loop import swing
from tests.plant.setting import MOTOR, robot

ROBOT = robot(replace(MOTOR, back_emf_constant=0.05), coulomb=3e-4)


def test_the_motor_wrapper_costs_little_more_than_a_bare_mujoco_loop():
    steps = 20_000
    model = compile_model(ROBOT)
    data = mujoco.MjData(model)
    angle, velocity = np.zeros(steps), np.zeros(steps)

    def bare():
        for k in range(steps):
            data.ctrl[0] = 0.2
            mujoco.mj_step(model, data)
            angle[k], velocity[k] = data.qpos[0], data.qvel[0]

    sine, rng = Sine(omega=4, amplitude=0.2), np.random.default_rng(0)

    def driven():
        Rig(robot=ROBOT).play(AddedMass(), sine, steps * 1e-3, rng)

    compare(bare, {"motor wrapper": driven})


def test_a_run_on_a_jittered_clock_costs_little_more_than_its_steps_in_mujoco():
    rig = Rig(robot=ROBOT, clock=Clock(jitter=2e-4))
    cycles = rig.clock.cycles(20.0, np.random.default_rng(np.random.SeedSequence(0)))
    steps = sum(map(steps_of, cycles.tolist()))
    model = compile_model(ROBOT)
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.2
    run, seed = (AddedMass(), Sine(omega=4, amplitude=0.2)), np.random.SeedSequence(0)
    own = {
        "a run in MuJoCo on a jittered clock": lambda: list(simulate_runs(rig, [run], 20.0, [seed]))
    }
    compare(lambda: mujoco.mj_step(model, data, steps), own)


def test_a_sweep_costs_little_more_than_a_bare_rollout():
    runs = [(AddedMass(), Sine(omega=2 + 0.2 * k, amplitude=0.2)) for k in range(39)]
    duration, threads = 1.0 if SHORT else 10.0, 2
    model = compile_model(ROBOT)
    workers = [mujoco.MjData(model) for _ in range(threads)]
    start = np.zeros((39, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    time_grid = 1e-3 * np.arange(int(duration * 1e3))
    inputs = np.array([0.2 * np.sin(sine.omega * time_grid) for _, sine in runs])[:, :, None]

    def bare():
        with Rollout(nthread=threads) as pool:
            pool.rollout(model, workers, start, inputs)

    def swept():
        seeds = np.random.SeedSequence(0).spawn(39)
        list(simulate_runs(Rig(robot=ROBOT), runs, duration, seeds, threads=threads))

    compare(bare, {"39 runs in MuJoCo": swept}, repeats=2)
    soonest, took = least_seconds(bare, swept, repeats=2, clock=time.perf_counter)
    assert took <= (2.8 if SHORT else 1.4) * soonest, "by the wall clock"


def test_the_energy_shaping_controller_costs_less_than_two_steps_of_mujoco():
    lumped = ROBOT.lumped
    orbit = Orbit.of_amplitude(lumped, 1.0)
    law = EnergyShaping(orbit, gain_for(orbit, 0.5))
    readings = [Reading(1e-3 * k, 0.5 * np.sin(4e-3 * k).item(), 0.0) for k in range(20_000)]
    model = compile_model(ROBOT)
    data = mujoco.MjData(model)
    deciding = {
        "a step of the energy-shaping controller": lambda: [law(reading) for reading in readings]
    }
    compare(lambda: [mujoco.mj_step(model, data) for _ in readings], deciding)


HINGE = """<mujoco><option integrator="RK4" timestep="0.002"/><worldbody><body>
<joint name="hinge" axis="0 -1 0" damping="0.001" frictionloss="0.0005"/>
<inertial pos="0 0 -0.05" mass="0.1" diaginertia="0.003 0.003 0.003"/></body></worldbody>
<actuator><motor joint="hinge"/></actuator></mujoco>"""


def test_an_exported_twin_costs_little_more_than_a_hinge_with_friction():
    p = LumpedParameters(
        p1=0.003, p2=1e-3, p3=0.05, p4=1.0, coulomb=5e-4, stribeck=3e-4, delay=3e-3
    )
    texts = HINGE, text_of(stand_alone(Twin(parameters=p)).root)
    models = [mujoco.MjModel.from_xml_string(text) for text in texts]

    def stepped(model):
        data = mujoco.MjData(model)
        data.qpos[0], data.ctrl[0] = 0.5, 0.01
        mujoco.mj_step(model, data, 10_000)

    hinge, own = (partial(stepped, model) for model in models)
    compare(hinge, {"the exported twin with Stribeck friction, 2 ms": own})


_START = 0.1  # rad
_LOG = 35  # 154 g at 7 rad/s


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


def test_scipy_and_mujoco_need_hundreds_of_times_the_kernel_s_time(real):
    found = real.estimate.parameters
    parameters = LumpedParameters(p1=found.p1, p2=found.p2, p3=found.p3, p4=found.p4)
    log = real.data.logs[_LOG]
    loaded = parameters.with_added_mass(log.added_mass)
    grid = Segments(log, parameters).grid
    grid = grid[: grid.size // 4 if SHORT else None]
    stamps = np.union1d(grid, log.time)
    fine = np.union1d(stamps, 0.5 * (stamps[1:] + stamps[:-1]))
    exact = _by_kernel(loaded, log, fine)[np.searchsorted(fine, grid)]
    error = np.abs(_by_kernel(loaded, log, grid) - exact).max()
    tolerance = next(  # the loosest at which scipy is as accurate
        each
        for each in 10.0 ** np.arange(-7, -12, -0.5)
        if np.abs(_by_scipy(loaded, log, grid, each) - exact).max() <= error
    )

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

        def by_kernel():  # too fast for the clock
            return [_by_kernel(loaded, log, grid) for _ in range(20)]

        wholes = {
            "scipy's solve_ivp at the kernel's accuracy": partial(
                _by_scipy, loaded, log, grid, tolerance
            ),
            "MuJoCo's bare rollout, RK4 at 1 ms": partial(pool.rollout, model, [data], state, held),
        }
        compare(by_kernel, wholes, parts=20, repeats=1 if SHORT else 3)


def test_terms_that_a_joint_does_not_have_cost_it_little():
    step, parameters = 0.01, LumpedParameters(p1=0.02, p2=0.03, p3=0.5, p4=1.0, coulomb=0.01)
    grid = step * np.arange(20_000)
    half = 0.4 * np.sin(4.4 * step / 2 * np.arange(2 * grid.size - 1))
    drives = np.column_stack([half[:-1:2], half[1::2], half[2::2]])
    own = parameters.p1, parameters.p2, parameters.p3, parameters.coulomb

    bare = partial(swing, own, drives, step, _START)
    kernel = partial(simulate, parameters, grid, drives, _START)
    assert np.abs(bare() - kernel()[0]).max() < 0.05  # reversals are all that they do not share
    compare(bare, {"the kernel of a joint with p1..p4 and Coulomb friction": kernel})
