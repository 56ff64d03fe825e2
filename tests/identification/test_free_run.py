"""Free runs and their FIT, from logs of known parameters and start, and by parameters by hand."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification import free_run
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError, WeakForm
from butterfly.identification.free_run import LEAST_FIT, FitSummary, FreeRun, Setting, Simulations
from butterfly.identification.identified import best_gain, try_parameters
from butterfly.identification.identify import diagnose, identify, judged
from butterfly.identification.problem import Start
from butterfly.identification.residuals import residuals_of
from butterfly.identification.simulation import Simulation
from butterfly.identification.trust import FindingKind
from butterfly.logs.log import Log, Sine
from butterfly.model.greybox import simulate
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import Prior
from butterfly.verdict import Level
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SWINGS, driven, simulated, steady
from tests.independent.integrator import Joint

SPEED, ZERO = 2.5, 0.2
PLAIN = OutputError(terms=(), per_log=("velocity",), workers=1)


def _thrown(mass, seed):
    """A free decay that begins in motion."""
    time = np.arange(0, 5, 2.5e-3)
    inputs = 0.02 * np.sin((3 + seed) * np.column_stack([time[:-1], time[:-1], time[:-1]]))
    angle, _ = simulate(ROBOT.with_added_mass(mass), time, inputs, 0.1, SPEED)
    about = {"input_kind": "torque", "added_mass": mass, "name": f"throw {seed}"}
    return Log(time, np.append(inputs[:, 0], 0.0), angle + ZERO, **about)


@pytest.fixture(scope="module")
def data():
    return DataSet.of([_thrown(mass, k) for k, mass in enumerate(MASSES)])


@pytest.fixture
def runs(monkeypatch):
    """Names of the logs that are simulated, one after the other."""
    names, run = [], Simulation.run

    def counted(self, *rest):
        names.append(self.log.name)
        return run(self, *rest)

    monkeypatch.setattr(Simulation, "run", counted)
    return names


def test_fit_is_the_published_percentage_and_does_not_mind_where_zero_is(data):
    log = data.logs[0]
    angle = log.angle
    run = FreeRun(log=log, simulated=angle + 0.1 * np.cos(log.time))
    error = np.sqrt(np.sum((run.simulated - angle) ** 2))
    expected = 100 * (1 - error / np.sqrt(np.sum((angle - np.mean(angle)) ** 2)))
    assert run.fit == pytest.approx(expected)
    moved = FreeRun(log=replace(log, angle=angle + 5.0), simulated=run.simulated + 5.0)
    assert moved.fit == pytest.approx(run.fit, abs=1e-9)
    assert run.rms == pytest.approx(error / angle.size**0.5)
    mean = FreeRun(log=log, simulated=np.full(angle.size, angle.mean()))
    assert mean.fit == pytest.approx(0.0, abs=1e-9)
    assert FitSummary.of(np.array([90.0, 50.0, 97.0])) == FitSummary(90.0, 79.0, 50.0)


def test_a_joint_that_goes_on_and_on_is_followed_as_far_as_its_velocity_is(sine_log):
    time = sine_log.time
    log = replace(sine_log, angle=5 * time + 0.1 * np.sin(3 * time))
    for share in (0.0, 0.5, 1.0, 2.0):
        run = FreeRun(log=log, simulated=5 * time + 0.1 * share * np.sin(3 * time) + 0.2)
        assert run.fit > 99
        assert run.velocity_fit == pytest.approx(100 * (1 - abs(share - 1)), abs=0.1)
        assert run.followed == pytest.approx(min(run.fit, run.velocity_fit), abs=1e-6)


def _film(noise, seed=0):
    """A slow free swing, ten frames a second, and the same without its noise."""
    joint, time = Joint(inertia=1.0, viscous=0.17, gravity=0.5, gain=1.0), np.arange(0, 22, 0.1)
    exact = driven(joint, time, np.zeros(time.size), 0.19)
    shaken = noise * np.random.default_rng(seed).standard_normal(time.size)
    return replace(exact, angle=exact.angle + shaken), exact


@pytest.mark.parametrize("noise", [1e-4, 0.01, 0.03])
def test_what_is_followed_is_what_noise_does_not_explain(noise):
    """Free runs of a joint by another integrator, with right values, and with wrong ones."""
    for seed in range(5):
        log, exact = _film(noise, seed)
        for more, follows in (({}, True), ({"p3": 1.0}, False), ({"p2": 2.0}, False)):
            values = LumpedParameters(**{"p1": 1.0, "p2": 0.17, "p3": 0.5, "p4": 1.0} | more)
            simulated = FreeRun.of(exact, Setting(parameters=values, zero=0.0)).simulated
            run = FreeRun(log=log, simulated=simulated)
            assert (run.followed > LEAST_FIT) is follows
            assert run.noise == pytest.approx(noise, rel=0.2) or not follows


@pytest.mark.parametrize("noise", [0.01, 0.03])
def test_a_noisy_velocity_refuses_no_joint_that_follows(noise):
    log, exact = _film(noise)
    run = FreeRun(log=log, simulated=exact.angle)
    assert run.velocity_fit < LEAST_FIT < 90 < run.followed


def test_another_method_is_advised_only_if_it_was_tried_and_follows(data):
    """Of the same wrong values, by logs of a joint and by logs of none."""
    estimator = OutputError(terms=(), workers=1)
    found = replace(estimator(data), values=np.array([1.0, 1.0, 0.05, 0.1, 0.0, 0.0]))
    rng = np.random.default_rng(0)
    wander = [
        replace(log, angle=np.cumsum(rng.standard_normal(log.time.size))) for log in data.logs
    ]
    for logs, better in ((data.logs, ("weak-form",)), (wander, ())):
        some = DataSet.of(logs)
        said = diagnose(some, estimator, found, residuals_of(some, found)).findings
        assert [each.parameters for each in said if each.kind is FindingKind.POOR_FIT] == [better]


def test_a_simulation_that_is_rough_or_diverges_is_not_excused_as_noise():
    log, exact = _film(1e-3)
    zigzag = np.where(np.arange(log.time.size) % 2, 1.0, -1.0)
    assert FreeRun(log=log, simulated=exact.angle + zigzag).followed < 0
    with np.errstate(over="ignore"):
        grown = np.exp(np.minimum(100 * log.time, 800.0))
    assert FreeRun(log=log, simulated=grown).followed == -math.inf


def test_the_velocity_and_zero_found_for_each_log_predict_it_by_one_simulation(data, runs):
    start = Start(replace(ROBOT, p1=0.0031, p4=0.48), dict.fromkeys(MASSES, ZERO))
    found = PLAIN.of_logs(data.logs, [start])
    speeds = [found.local[log.name]["velocity"] for log in data.logs]
    assert speeds == pytest.approx([SPEED] * 3, rel=2e-3)
    assert found.local[None]["zero"] == pytest.approx(ZERO, abs=1e-3)
    told = Setting(parameters=ROBOT, zero=ZERO, velocity=SPEED)
    assert FreeRun.of(data.logs[1], told).fit > 99.9
    assert FreeRun.of(data.logs[1], replace(told, velocity=0.0)).fit < 80
    runs.clear()
    fits = data.simulations.fits(found)
    assert fits.min() > 99.5
    np.testing.assert_array_equal(data.simulations.fits(found), fits)
    assert len(runs) == len(data.logs)
    assert pickle.loads(pickle.dumps(data)).simulations.fits(found).tolist() == fits.tolist()  # noqa: S301 - our own


def test_logs_that_are_held_out_are_simulated_once(data, runs):
    apart = data.holding([0])
    (held,) = apart.test_logs.logs
    found = identify(apart, WeakForm(terms=()))
    assert runs.count(held.name) == 1
    assert list(found.held_out) == [held.name]


def test_noise_of_a_law_is_simulated_sample_by_sample():
    """Where the joint turns back, each sample counts: their mean over a step was 0.6 mrad off."""
    joint = Joint(inertia=0.2, viscous=0.02, gravity=0.5, gain=1.0, coulomb=0.4, delay=5e-3)
    same = LumpedParameters(p1=0.2, p2=0.02, p3=0.5, p4=1.0, coulomb=0.4, delay=5e-3)
    time = np.arange(0, 6, 2e-3)
    inputs = np.sin(2 * time) + 0.1 * np.random.default_rng(1).standard_normal(time.size)
    log = driven(joint, time, inputs)
    run = Simulation(log, same)
    assert run.step <= 1.05 * time[1]
    np.testing.assert_allclose(run.run(same, 0.0).at(log.time), log.angle, atol=1e-6)


def test_a_log_linear_between_samples_is_followed_by_its_own_parameters_and_worse_by_others():
    robot = replace(ROBOT, delay=0.0037)
    sine = Sine(omega=4.4, amplitude=0.02)
    log = simulated(robot, MASSES[1], sine.sample, 10.0, zero=0.7)
    own = Setting(parameters=robot, zero=0.7)
    heavy = replace(own, parameters=replace(robot, p1=1.1 * robot.p1))
    assert FreeRun.of(log, own).fit > 99.9
    assert FreeRun.of(log, heavy).fit < 95


def test_an_identification_is_judged_over_the_horizon_that_its_logs_are_simulated_over(
    data, monkeypatch
):
    monkeypatch.setattr(Simulations, "horizon", lambda self, estimate: 3.0)  # noqa: ARG005 - a method
    estimator = WeakForm(terms=())
    found = identify(data, estimator)
    assert found.estimate.horizon == found.fit.horizon == 3.0
    assert judged(data, estimator)[1].horizon == 3.0


@pytest.fixture
def swings():
    return DataSet.of(steady(ROBOT, dict(list(SWINGS.items())[::2]))[::2])


@pytest.fixture
def built(monkeypatch):
    """Count the trajectories that are built."""
    count = []

    class Counted(Simulation):
        def __init__(self, *arguments):
            count.append(arguments[0].name)
            super().__init__(*arguments)

    monkeypatch.setattr(free_run, "Simulation", Counted)
    return count


def test_the_best_gain_is_the_true_one_and_each_trajectory_is_built_once(swings, built):
    found = best_gain(replace(ROBOT, p4=math.nan), swings)
    assert found == pytest.approx(ROBOT.p4, rel=1e-3)
    assert sorted(built) == sorted(log.name for log in swings.logs)


def test_comparisons_share_the_trajectories_and_say_whether_the_gain_was_fitted(swings, built):
    fitted = try_parameters("sheet", replace(ROBOT, p4=math.nan), swings)
    given = try_parameters("table", replace(ROBOT, p1=1.2 * ROBOT.p1), swings)
    assert (fitted.gain_fitted, given.gain_fitted) == (True, False)
    assert fitted.fit.worst > 99
    assert given.fit.median < fitted.fit.median - 5
    assert len(built) <= 2 * len(swings.logs)  # the grid follows the resonance, not the gain


HELD = {"p1": 0.006, "p2": 0.004, "p3": 0.34, "p4": 1.0, "coulomb": 0.03}
"""A wrist that hangs outside its range: a loop, which its logs do not have, holds it above."""


def _held_above(seed, middle=2.5, seconds=8.0):
    """Log the torque and the angle of a joint that a loop holds in its upper half."""
    rng = np.random.default_rng(seed)
    pace, phase = rng.uniform(2.0, 12.0, 3), rng.uniform(0.0, 6.3, 3)
    step, parts = 5e-3, 20
    angle, velocity, rows = middle, 0.0, []
    for k in range(round(seconds / step)):
        torque = 0.12 * np.sin(pace * k * step + phase).sum() + HELD["p3"] * math.sin(middle)
        torque += 1.2 * (middle - angle) - 0.03 * velocity
        rows.append((k * step, torque, angle + rng.normal(0.0, 3e-4)))
        for _ in range(parts):
            friction = HELD["p2"] * velocity + HELD["coulomb"] * math.tanh(velocity / 1e-3)
            velocity += (
                step / parts * (torque - friction - HELD["p3"] * math.sin(angle)) / HELD["p1"]
            )
            angle += step / parts * velocity
    time, inputs, angles = np.array(rows).T
    about = {"input_kind": "torque", "zero": 0.0, "intersample": "zero_order_hold"}
    return Log(time, inputs, angles, name=f"held {seed}", **about)


def test_gravity_drives_errors_apart_where_a_loop_holds_a_joint_in_its_upper_half():
    joint = LumpedParameters(**HELD)
    above, below = _held_above(0, seconds=2.0), _held_above(0, middle=0.6, seconds=2.0)
    assert free_run.falls(above, joint, 0.0)
    assert not free_run.is_held(above, joint, 0.0)
    assert not free_run.falls(below, joint, 0.0)
    assert not free_run.falls(above, replace(joint, p3=0.0), 0.0)


def test_a_joint_that_a_loop_holds_in_its_upper_half_is_identified_over_segments():
    data = DataSet.of([_held_above(seed) for seed in range(3)], known=Prior.of({"p4": 1.0}))
    estimate = identify(data).estimate
    assert estimate.level is Level.GOOD
    assert 0 < estimate.horizon < 1.0
    for name in ("p1", "p3", "coulomb"):
        assert estimate.named[name] == pytest.approx(HELD[name], rel=0.03)
