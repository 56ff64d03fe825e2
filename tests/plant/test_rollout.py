import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.logs.log import InputKind, Sine
from butterfly.model.parameters import AddedMass, TorqueDrive, VoltageDrive
from butterfly.plant.mjcf import compile_model
from butterfly.plant.rig import Rig, Simulator
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Clock, Encoder
from butterfly.signals.excitations import FreeDecay, Table
from tests.plant.setting import ADDED, FINE, MOTOR, grey_box, robot
from tests.signals.sines import fit_sine

SINE = Sine(omega=4.0, amplitude=0.5)


def _run(driven, *, duration=20.0, clock=Clock(), encoder=FINE, seed=0, signal=SINE):
    rig = Rig(robot=driven, clock=clock, encoder=encoder)
    (log,) = simulate_runs(rig, [(ADDED, signal)], duration, [np.random.SeedSequence(seed)])
    return log


@pytest.mark.parametrize(
    "drive",
    [
        MOTOR,
        VoltageDrive(resistance=2, torque_constant=0.05, back_emf_constant=0.0),
        VoltageDrive(resistance=1, torque_constant=0.03, back_emf_constant=0.07),
        TorqueDrive(gain=0.025),
    ],
    ids=["unequal constants", "no back EMF", "larger back EMF", "torque"],
)
def test_without_coulomb_friction_mujoco_is_the_grey_box_on_a_jittered_clock(drive):
    driven = robot(drive)
    log = _run(driven, duration=5.0, clock=Clock(jitter=2e-4))
    assert np.ptp(log.angle) > 0.2
    exact, _ = grey_box(driven.loaded(ADDED), log.time, log.input)
    np.testing.assert_allclose(log.angle, exact, atol=1e-9)
    kind = InputKind.TORQUE if isinstance(drive, TorqueDrive) else InputKind.VOLTAGE
    assert (log.input_kind, log.added_mass, log.excitation) == (kind, ADDED, SINE)
    np.testing.assert_allclose(log.input, 0.5 * np.sin(4 * log.time), atol=1e-15)


def test_a_slow_clock_is_integrated_in_small_steps():
    driven = robot()
    log = _run(driven, clock=Clock(step=0.04))
    fine = np.linspace(0, log.time[-1], 40 * (log.time.size - 1) + 1)
    exact, _ = grey_box(driven.loaded(ADDED), fine, np.repeat(log.input[:-1], 40))
    np.testing.assert_allclose(log.angle, exact[::40], atol=1e-9)


def test_with_coulomb_friction_the_swing_at_resonance_agrees_within_half_a_percent():
    driven = robot(coulomb=1e-3)
    log = _run(driven, duration=15.0, signal=Sine(omega=5.15, amplitude=0.3))
    exact, _ = grey_box(driven.loaded(ADDED), log.time, log.input)
    rows = log.time > 10
    ours, theirs = (
        fit_sine(log.time[rows], angle[rows], 5.15).amplitude for angle in (log.angle, exact)
    )
    assert ours == pytest.approx(theirs, rel=5e-3)


@settings(max_examples=25)
@given(mass=st.floats(0, 1), arm=st.floats(0, 0.2), angle=st.floats(-3, 3))
def test_an_added_mass_adds_exactly_its_inertia_and_gravity_moment(mass, arm, angle):
    added = AddedMass(mass=mass, arm=arm)
    model = compile_model(robot(), added)
    data = mujoco.MjData(model)
    data.qpos[0] = angle
    mujoco.mj_forward(model, data)
    inertia = np.zeros((1, 1))
    mujoco.mj_fullM(model, data, inertia)
    loaded = robot().loaded(added)
    assert inertia[0, 0] == pytest.approx(loaded.p1, rel=1e-14)
    assert data.qfrc_bias[0] == pytest.approx(loaded.p3 * np.sin(angle), rel=1e-12, abs=1e-16)


def test_a_seed_fixes_everything():
    noisy = {"duration": 2.0, "clock": Clock(jitter=2e-4), "encoder": Encoder(noise=1e-3)}
    first, again, other = (_run(robot(), **noisy, seed=seed) for seed in (1, 1, 2))
    for name, column in first.columns().items():
        np.testing.assert_array_equal(column, getattr(again, name))
    assert not np.array_equal(first.time, other.time)


@pytest.mark.parametrize("simulator", Simulator)
def test_a_sine_that_ran_in_is_in_steady_swing_from_its_first_sample_on(simulator):
    driven = robot(coulomb=3e-4)
    rig = Rig(robot=driven, simulator=simulator, encoder=FINE, run_in=60.0)
    runs = [(ADDED, SINE), (ADDED, FreeDecay(angle=0.3))]
    log, decay = simulate_runs(rig, runs, 12.0, np.random.SeedSequence(0).spawn(2))
    period = 2 * np.pi / SINE.omega
    first, last = (
        fit_sine(log.time[rows], log.angle[rows], SINE.omega)
        for rows in (log.time < period, log.time > log.time[-1] - period)
    )
    assert abs(first.fundamental - last.fundamental) < 2e-3 * last.amplitude
    assert decay.angle[0] == pytest.approx(0.3)


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan")])
def test_a_run_of_no_length_is_refused(duration):
    with pytest.raises(InputError, match="duration"):
        _run(robot(), duration=duration)


def test_mujoco_s_coulomb_friction_follows_the_set_valued_one_in_a_wide_decay_to_rest():
    """Within 1e-3 rad, its constraint being regularised; see models/butterfly_hand/README.md."""
    driven = robot(coulomb=1e-3)
    log = _run(driven, signal=FreeDecay(angle=1.5))
    exact, velocity = grey_box(driven.loaded(ADDED), log.time, log.input, 1.5)
    assert velocity[-1] == 0
    assert np.abs(log.angle - exact).max() < 1e-3


def test_mujoco_s_coulomb_friction_hardly_creeps_at_rest():
    push = Table(time=(0.0,), values=(0.07,))  # 1.75e-3 N m, held by friction
    assert np.abs(_run(robot(coulomb=2e-3), signal=push).angle).max() < 1e-5


def test_a_simulation_that_diverges_is_refused():
    with pytest.raises(InputError, match="diverged"):
        _run(robot(bias=1e6), duration=1.0)
