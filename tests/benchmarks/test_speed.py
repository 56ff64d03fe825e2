"""Speed as a ratio to something done in the same run; shown, and kept within wide limits.

Run with ``make bench``.
"""

import time

import mujoco
import numpy as np
import pytest
from scipy.io import loadmat

from butterfly.identify.free_run import free_run
from butterfly.identify.harmonic_balance import fit_harmonic_balance
from butterfly.identify.identification import identify
from butterfly.logs.log import Sine
from butterfly.model.parameters import Friction, Hand, VoltageDrive
from butterfly.plant.mjcf import Robot, compile_model
from butterfly.plant.mujoco_plant import MujocoPlant
from butterfly.plant.sensors import Clock, Encoder


def _seconds(function, repeats=3):
    durations = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        durations.append(time.perf_counter() - start)
    return min(durations)


@pytest.mark.usefixtures("real")  # compiles the kernels
def test_identifying_the_real_logs_costs_little_more_than_reading_them(real_manifest):
    paths = [f"{real_manifest.root}/{entry.file}" for entry in real_manifest.logs]
    reading = _seconds(lambda: [loadmat(path) for path in paths])
    whole = _seconds(lambda: identify(real_manifest))
    print(f"\nidentify 41 real logs: {whole:.2f} s, {whole / reading:.1f} times the bare reading")
    assert whole < 6 * reading


def test_the_harmonic_balance_costs_less_than_simulating_the_logs_once(real):
    fit = _seconds(lambda: fit_harmonic_balance(real.points))
    parameters, rest = real.estimate.parameters, real.equilibria
    runs = _seconds(lambda: [free_run(g, parameters, rest[g.added_mass]) for g in real.logs])
    print(f"\nharmonic balance {1e3 * fit:.1f} ms, free run of 41 logs {1e3 * runs:.0f} ms")
    assert fit < runs


def test_the_plant_costs_little_more_than_a_bare_mujoco_loop():
    robot = Robot(
        hand=Hand(mass=0.1, com_distance=0.05, inertia=0.003),
        drive=VoltageDrive(resistance=2, torque_constant=0.05, back_emf_constant=0.05),
        friction=Friction(viscous=2e-4, coulomb=3e-4),
    )
    steps = 20_000
    model = compile_model(robot)
    data = mujoco.MjData(model)
    angle, velocity = np.zeros(steps), np.zeros(steps)

    def bare():
        for k in range(steps):
            data.ctrl[0] = 0.2
            mujoco.mj_step(model, data)
            angle[k], velocity[k] = data.qpos[0], data.qvel[0]

    plant = MujocoPlant(robot)
    sine, rng = Sine(omega=4, amplitude=0.2), np.random.default_rng(0)

    def driven():
        plant.run(sine, duration=steps * 1e-3, clock=Clock(), encoder=Encoder(), rng=rng)

    ratio = _seconds(bare) / _seconds(driven)
    print(f"\nplant: {ratio:.2f} of the speed of a bare mj_step loop that logs the same columns")
    assert ratio > 0.6
