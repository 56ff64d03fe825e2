"""What a next experiment would tell is what its sensitivities say, and it can be run as it is."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification import design
from butterfly.identification.data import DataSet
from butterfly.identification.design import rank_experiments
from butterfly.identification.estimators import HarmonicBalance
from butterfly.identification.inference.estimate import Estimate
from butterfly.logs.log import InputKind, Log, Sine
from butterfly.model.greybox import simulate
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.servo import ServoLoop
from butterfly.plant.motor import CommandPath
from butterfly.plant.rig import Rig, Simulator
from butterfly.plant.robot import Robot
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Clock
from butterfly.signals.excitations import FreeDecay, Multisine
from tests.conftest import MASSES
from tests.identification.simulated import simulated

ROBOT = LumpedParameters(p1=0.003, p2=5e-4, p3=0.05, p4=0.5, coulomb=1e-3, delay=0.003)


@pytest.fixture(scope="module")
def found():
    """An estimate from noisy sines about the resonances."""
    random, logs = np.random.default_rng(0), []
    for mass in MASSES:
        for sine in (Sine(omega=omega, amplitude=0.02) for omega in (4.0, 4.6, 6.5)):
            log = simulated(ROBOT, mass, sine.sample, 20.0, start=0.2, sine=sine)
            noise = 5e-3 * random.standard_normal(log.time.size)
            logs.append(replace(log, angle=log.angle + noise))
    return HarmonicBalance(terms=())(DataSet.of(logs))


def test_a_candidate_tells_two_numbers_of_the_model_s_relative_error(found):
    """What it would leave, from sensitivities simulated here and the sum of information."""
    candidates = rank_experiments(found, [MASSES[1]], 0.01)
    chosen = next(c for c in candidates if isinstance(c.signal, Sine) and not c.warning)
    time = np.arange(0, 40, 0.01)
    instants = np.column_stack([time[:-1], time[:-1] + 5e-3, time[1:]])

    def angle(values):
        p = LumpedParameters(**dict(zip(found.names, values, strict=True)))
        late = np.maximum(instants - p.delay, 0.0)
        inputs = chosen.signal.amplitude * np.sin(chosen.signal.omega * late)
        return simulate(p.with_added_mass(MASSES[1]), time, inputs, 0.0)[0]

    there = angle(found.values)
    steps = np.diag(found.standard_errors)
    slopes = np.column_stack([angle(found.values + h) - there for h in steps])
    slopes /= found.standard_errors
    noise = (0.01 * np.std(there)) ** 2
    information = 2 / time.size * slopes.T @ slopes / noise
    prior = found.covariance
    gain = prior @ np.linalg.inv(np.eye(len(prior)) + information @ prior)
    expected = np.sqrt(np.diag(gain)) / found.standard_errors
    assert expected.min() < 0.9
    np.testing.assert_allclose(chosen.errors, expected, rtol=1e-3)


def test_the_best_candidates_come_first_and_those_with_a_warning_last(found):
    ranked = rank_experiments(found, [NO_ADDED_MASS, AddedMass(mass=0.2, arm=0.104)], 0.02)
    good = [candidate for candidate in ranked if not candidate.warning]
    assert ranked[: len(good)] == good
    assert len(good) < len(ranked)
    assert [c.score for c in good] == sorted(c.score for c in good)
    assert all(np.all(c.errors <= 1 + 1e-9) for c in ranked)
    assert good[0].score < 0.9 * good[-1].score
    assert all(c.swing <= 1.0 for c in good)


def test_without_gravity_sines_lie_about_those_of_a_hand_that_resonates_at_2_rad_per_s(found):
    p1, p3 = found.names.index("p1"), found.names.index("p3")
    omegas = []
    for moment in (0.0, 4 * found.values[p1]):
        values = np.where(np.arange(found.values.size) == p3, moment, found.values)
        ranked = rank_experiments(replace(found, values=values), [NO_ADDED_MASS], 0.05)
        omegas.append(sorted(c.signal.omega for c in ranked if isinstance(c.signal, Sine)))
    assert omegas[0] == pytest.approx(omegas[1], rel=0.01)


def test_without_a_covariance_or_with_a_swing_that_is_none_nothing_is_planned(found):
    unknown = replace(found, covariance=np.full_like(found.covariance, np.nan))
    with pytest.raises(IdentifiabilityError, match="no covariance"):
        rank_experiments(unknown, MASSES, 0.1)
    for swing in (0.0, -1.0, float("nan"), "wide"):
        with pytest.raises(InputError, match="swing"):
            rank_experiments(found, [MASSES[1]], 0.05, largest_swing=swing)


def test_progress_is_shown_while_candidates_are_judged(found, monkeypatch):
    begun, judge = threading.Event(), design.judged_candidate

    def track(items, _):
        begun.set()
        yield from items

    def judged(*job, **options):
        assert begun.wait(5), "the work is over before its progress is shown"
        return judge(*job, **options)

    monkeypatch.setattr(design, "judged_candidate", judged)
    assert rank_experiments(found, [MASSES[1]], 0.05, track=track)


def test_every_proposed_input_can_be_run_as_it_is_proposed(found):
    ranked = rank_experiments(found, [MASSES[1]], 0.05, largest_swing=10.0)
    assert {type(each.signal) for each in ranked} == {Sine, Multisine, FreeDecay}
    robot = Robot.of_lumped(replace(found.parameters, delay=0.0))
    path = CommandPath(delay=max(found.parameters.delay, 0.0))
    rig = Rig(robot=robot, path=path, simulator=Simulator.GREY_BOX, clock=Clock(step=5e-3))
    runs = [(each.added_mass, each.signal) for each in ranked]
    seeds = np.random.SeedSequence(0).spawn(len(runs))
    for each, log in zip(ranked, simulate_runs(rig, runs, design.DURATION, seeds), strict=True):
        assert np.abs(log.angle).max() == pytest.approx(each.swing, rel=0.02), each.what


SERVO = LumpedParameters(
    p1=0.0066, p2=0.05, p3=0.02, p4=0.12, coulomb=0.02, load_friction=0.1, back_emf=0.04
)
LAW = ServoLoop.of({"law": "dynamixel-xl330", "kp": 800, "supply": 7.4})
HEAVY = AddedMass(mass=0.4, arm=0.1)


@pytest.fixture(scope="module")
def planned():
    """Candidates after logs with one mass, of which load and Coulomb friction are one number."""
    return _ranked([NO_ADDED_MASS, HEAVY], LAW)


def _ranked(masses, servo, latency=0.0):
    names = ("p1", "p4", "coulomb", "load_friction")
    values = np.array([getattr(SERVO, name) for name in names])
    errors = np.array([0.05, 0.05, 0.5, 0.5]) * values
    covariance = np.diag(errors**2)
    covariance[2, 3] = covariance[3, 2] = -0.99 * errors[2] * errors[3]
    fixed = {"p2": SERVO.p2, "p3": SERVO.p3, "back_emf": SERVO.back_emf, "latency": latency}
    found = Estimate(method="any", names=names, values=values, covariance=covariance,
                     lower=values - errors, upper=values + errors, fixed=fixed)  # fmt: skip
    time = np.arange(0.0, 4.0, 0.01)
    log = Log(time, input=np.sin(4 * time), angle=0.9 * np.sin(4 * time), servo=servo,
              input_kind=InputKind.SETPOINT, added_mass=HEAVY)  # fmt: skip
    return rank_experiments(found, masses, 0.02, servos=[log])


def test_a_servo_is_planned_set_points_that_move_it_as_predicted(planned):
    robot = Robot.of_lumped(SERVO)
    rig = Rig(robot=robot, simulator=Simulator.GREY_BOX, clock=Clock(step=0.01), servo=LAW)
    for each in planned[::3]:
        assert each.servo is LAW
        falls = isinstance(each.signal, FreeDecay)
        assert ("torque off" if falls else "set-point: ") in each.what
        own = replace(rig, torque_off=((0.0, 4.0),)) if falls else rig
        (log,) = simulate_runs(own, [(each.added_mass, each.signal)], 4.0, [1])
        assert np.abs(log.angle).max() == pytest.approx(each.swing, rel=0.02), each.what
    assert max(each.swing for each in planned if not each.warning) <= 1.0


def test_another_mass_tells_load_friction_from_coulomb_friction(planned):
    """The same slow motion with another mass than the logs', with which both are one number."""
    left = {(str(each.signal), each.added_mass): each.errors[2:] for each in planned}
    slow = {str(c.signal) for c in planned if isinstance(c.signal, Sine) and c.signal.omega < 10}
    assert len(slow) == 7
    for signal in slow:
        assert (left[signal, NO_ADDED_MASS] < 0.9 * left[signal, HEAVY]).all(), signal


def test_set_points_are_as_fast_as_the_logs_and_speeds_of_a_law_of_speed(planned):
    """Those were 0.9 rad at 4 rad/s, and set-points of speed are in rad/s."""
    sines = [each.signal for each in planned if isinstance(each.signal, Sine)]
    assert max(each.omega * each.amplitude for each in sines) == pytest.approx(3.6, rel=0.05)
    law = ServoLoop.of({"law": "odrive-velocity", "kp": 0.5, "ki": 0.1})
    of_speed = _ranked([NO_ADDED_MASS], law)
    peaks = {round(each.signal.amplitude, 1) for each in of_speed if "sine of" in each.what[:20]}
    assert max(peaks) == pytest.approx(3.6, rel=0.05)
    assert all("rad/s (kp 0.5, ki 0.1)" in each.what for each in of_speed if "set" in each.what)


def test_a_loop_that_is_not_stable_is_planned_nothing_without_a_warning():
    runs_away = ServoLoop.of({"law": "moteus", "kp": 2000.0, "kd": 1.0})
    ranked = _ranked([NO_ADDED_MASS], runs_away, latency=0.05)
    told = [each.warning for each in ranked if not isinstance(each.signal, FreeDecay)]
    assert all(warning.startswith("swings") for warning in told)
    assert np.isfinite([each.errors for each in ranked]).all()


def test_a_plan_tells_of_the_delay_of_a_slow_clock(found):
    """It takes the second half of a run: what nothing shows could not become better known."""
    covariance = np.zeros((found.values.size + 1,) * 2)
    covariance[:-1, :-1], covariance[-1, -1] = found.covariance, 1e-6
    own = {"values": -1e-3, "lower": -3e-3, "upper": 1e-3, "freedom": 10.0}
    more = {name: np.append(getattr(found, name), value) for name, value in own.items()}
    more |= {"names": (*found.names, "slow_delay"), "covariance": covariance}
    slow = replace(found, **more, fixed={**found.fixed, "slow_interval": 2e-3})
    best = rank_experiments(slow, [MASSES[1]], 0.01)[0]
    assert best.errors[-1] < 0.9
