"""Speed as a ratio to something done in the same run; shown, and kept within wide limits.

Run with ``make bench``.
"""

import time

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from butterfly.identify.estimators import HarmonicBalance, OutputError
from butterfly.identify.predict import Predictor
from butterfly.logs.log import Sine
from butterfly.model.energy import Orbit
from butterfly.model.friction import Friction
from butterfly.model.parameters import AddedMass, Hand, VoltageDrive
from butterfly.orbit.controller import EnergyShaping, gain_for
from butterfly.plant.mjcf import compile_model
from butterfly.plant.motor import Reading
from butterfly.plant.robot import Robot
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.setup import Setup
from tests.benchmarks.bars import at_least, at_most


def _seconds(function, repeats=3):
    durations = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        durations.append(time.perf_counter() - start)
    return min(durations)


def test_the_harmonic_balance_costs_less_than_simulating_the_logs_once(real):
    fit = _seconds(lambda: HarmonicBalance().of_points(real.data.sines))
    runs = _seconds(lambda: Predictor(real.data).fits(real.estimate))
    print(f"\nharmonic balance {1e3 * fit:.1f} ms, free run of 41 logs {1e3 * runs:.0f} ms")
    at_most(fit / runs, 1, "harmonic balance over one free run")


def test_the_joint_output_error_fit_costs_less_than_250_simulations_of_every_log(real):
    data, start = real.data, real.estimate.parameters
    estimator = OutputError(check=False, workers=1)
    fit = _seconds(lambda: estimator.of_logs(data.logs, start, data.equilibria), 2)
    problem = estimator.problem(data.logs, start, data.equilibria)
    once = _seconds(lambda: problem.residuals(problem.initial))
    print(f"\noutput error, 12 parameters, one core: {fit:.2f} s, {fit / once:.0f} simulations")
    at_most(fit / once, 250, "output error in simulations")


ROBOT = Robot(
    hand=Hand(mass=0.1, com_distance=0.05, inertia=0.003),
    drive=VoltageDrive(resistance=2, torque_constant=0.05, back_emf_constant=0.05),
    friction=Friction(viscous=2e-4, coulomb=3e-4),
)


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
        Setup(robot=ROBOT).play(AddedMass(), sine, steps * 1e-3, rng)

    ratio = _seconds(bare) / _seconds(driven)
    print(f"\nmotor wrapper: {ratio:.2f} of the speed of a bare mj_step loop with the same columns")
    at_least(ratio, 0.6, "motor wrapper over bare loop")


def test_a_sweep_costs_little_more_than_a_bare_rollout():
    runs = [(AddedMass(), Sine(omega=2 + 0.2 * k, amplitude=0.2)) for k in range(39)]
    duration, threads = 20.0, 2
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
        list(simulate_runs(Setup(robot=ROBOT), runs, duration, seeds, threads=threads))

    ratio = _seconds(bare) / _seconds(swept)
    print(f"\nsweep of 39 runs: {ratio:.2f} of the speed of a bare rollout on {threads} threads")
    at_least(ratio, 0.7, "sweep over bare rollout")


def test_the_energy_shaping_controller_costs_less_than_two_steps_of_mujoco():
    lumped = ROBOT.lumped
    orbit = Orbit.of_amplitude(lumped, 1.0)
    law = EnergyShaping(orbit, gain_for(orbit, 0.5))
    readings = [Reading(1e-3 * k, 0.5 * np.sin(4e-3 * k).item(), 0.0) for k in range(20_000)]
    deciding = _seconds(lambda: [law(reading) for reading in readings]) / len(readings)
    model = compile_model(ROBOT)
    data = mujoco.MjData(model)
    step = _seconds(lambda: [mujoco.mj_step(model, data) for _ in readings]) / len(readings)
    print(f"\ncontroller: {1e6 * deciding:.1f} us a step, {deciding / step:.2f} of a MuJoCo step")
    at_most(deciding / step, 2, "controller over a step of MuJoCo")
