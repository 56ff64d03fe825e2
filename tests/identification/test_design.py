"""What a next experiment would tell is what its sensitivities say, and it can be run as it is."""

import math
import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import fractional_matrix_power
from scipy.special import stdtrit

import butterfly as bf
from butterfly.campaigns.bench import STILL, Signal
from butterfly.campaigns.guard import Expected, Limits
from butterfly.campaigns.plan import Recipe, played
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification import design
from butterfly.identification.data import DataSet
from butterfly.identification.design import MOST_RUNS, OF_GOAL, plans, wanted
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import HarmonicBalance
from butterfly.logs.log import InputKind, Log, Sine
from butterfly.model.greybox import simulate
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.servo import ServoLoop
from butterfly.plant.motor import CommandPath
from butterfly.plant.rig import Rig, Simulator
from butterfly.plant.robot import Robot
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Clock, Encoder
from butterfly.report.summary import next_run_text
from butterfly.signals.excitations import FreeDecay, Multisine
from tests.conftest import MASSES
from tests.identification.simulated import next_runs, simulated

ROBOT = LumpedParameters(p1=0.003, p2=5e-4, p3=0.05, p4=0.5, coulomb=1e-3, delay=0.003)
SIMULATED = {"simulator": Simulator.GREY_BOX, "clock": Clock(step=5e-3)}


@pytest.fixture(scope="module")
def data():
    """Noisy sines about the resonances."""
    random, logs = np.random.default_rng(0), []
    for mass in MASSES:
        for sine in (Sine(omega=omega, amplitude=0.02) for omega in (4.0, 4.6, 6.5)):
            log = simulated(ROBOT, mass, sine.sample, 20.0, start=0.2, sine=sine)
            noise = 5e-3 * random.standard_normal(log.time.size)
            logs.append(replace(log, angle=log.angle + noise))
    return DataSet.of(logs)


@pytest.fixture(scope="module")
def found(data):
    return HarmonicBalance(terms=())(data)


def _information(found, mass, sine, duration, start=0.0):
    """The integral over time of products of sensitivities, by differences."""
    time = np.arange(0, duration, 0.01)
    instants = np.column_stack([time[:-1], time[:-1] + 5e-3, time[1:]])

    def angle(values):
        p = LumpedParameters(**dict(zip(found.names, values, strict=True)))
        inputs = sine.amplitude * np.sin(sine.omega * np.maximum(instants - p.delay, 0.0))
        return simulate(p.with_added_mass(mass), time, inputs, start)[0]

    steps, at = 1e-3 * np.diag(found.standard_errors), found.values
    slopes = np.array([(angle(at + h) - angle(at - h)) / (2 * h.sum()) for h in steps])
    return slopes @ slopes.T * 0.01


def test_intervals_after_some_runs_are_those_of_student_with_the_freedom_of_all_logs(data, found):
    """What is left, and the fewest runs that reach the goal, from sensitivities simulated here."""
    sines = [p for p in next_runs(data, found, goal=0.21) if isinstance(p.recipe.signal, Sine)]
    plan = next(each for each in sines if each.runs > 1 >= each.expected[1])
    aim = wanted(found, data.logs, 0.21)
    so_far = [_information(found, log.added_mass, log.excitation, 20.0, 0.2) for log in data.logs]
    more = _information(found, plan.recipe.log.added_mass, plan.recipe.signal, 40.0)
    errors, freedom = _expected(so_far)
    shown = found.farther / errors / stdtrit(freedom, 0.975)

    def after(runs):
        left, more_freedom = _expected([*so_far, *[more] * runs])
        return shown * left * stdtrit(more_freedom, 0.975)

    np.testing.assert_allclose(plan.errors, _expected([*so_far, more])[0] / errors, rtol=0.02)
    shares = [np.max(after(runs) / aim) for runs in (1, plan.runs, plan.runs - 1)]
    assert plan.expected == pytest.approx(shares[:2], rel=0.02)
    assert shares[1] <= 1.02 < 1.04 * shares[2]


def _expected(informations):
    """Standard errors and degrees of freedom, by Bell & McCaffrey's matrix P, which is formed."""
    normal = np.linalg.inv(sum(informations))
    roots = [np.linalg.eigh(each) for each in informations]  # rounding may make one negative
    rows = [np.sqrt(np.maximum(sizes, 0.0))[:, None] * axes.T for sizes, axes in roots]
    size = len(normal)
    flat = np.concatenate(rows)
    maker = np.eye(len(flat)) - flat @ normal @ flat.T
    blocks = [slice(size * k, size * k + size) for k in range(len(rows))]
    influence = [fractional_matrix_power(maker[b, b], -0.5) @ x @ normal
                 for b, x in zip(blocks, rows, strict=True)]  # fmt: skip
    freedom = []
    for name in range(size):
        moved = np.zeros((len(flat), len(rows)))
        for k, b in enumerate(blocks):
            moved[b, k] = influence[k][:, name]
        p = moved.T @ maker @ moved
        freedom.append(np.trace(p) ** 2 / np.trace(p @ p))
    return np.sqrt(np.diag(normal)), np.array(freedom)


def test_the_first_advice_reaches_the_goal_and_gives_the_half_widths_that_it_promises():
    """Robots that are known a little are run exactly as proposed, and identified again."""
    ratios = []
    for seed in range(3):
        sizes = np.exp(np.random.default_rng(seed).uniform(-0.5, 0.5, 5))
        values = zip(OF_GOAL, sizes * (0.004, 0.002, 0.05, 0.3, 0.001), strict=True)
        seen = {"path": CommandPath(delay=0.004), "encoder": Encoder(steps=8192, noise=1e-3)}
        rig = Rig(robot=Robot.of_lumped(LumpedParameters(**dict(values))), **seen, **SIMULATED)
        sines = Sine(omega=3.0, amplitude=0.03), Sine(omega=5.0, amplitude=0.02)
        logs = list(simulate_runs(rig, zip(MASSES[::2], sines, strict=True), 6.5, [seed, 9]))
        before = bf.identify(logs)
        best = next_runs(before.data, before.estimate, duration=20.0, goal=0.005)[0]
        said = bf.design(before, duration=20.0, goal="0.5%").summary[0]
        run = best.recipe.log.added_mass, best.recipe.signal
        assert said.startswith(f"Run next: {best.recipe.what}, with {run[0]}, {best.runs} run")
        logs += simulate_runs(rig, [run] * best.runs, 20.0, range(10, 10 + best.runs))
        after = bf.identify(logs)
        assert "No run is needed" in bf.design(after, goal=0.005).summary[0]
        reached = after.estimate.farther / wanted(after.estimate, after.data.logs, 0.005)
        ratios.append(np.max(reached) / best.expected[1])
    assert 0.5 < np.median(ratios) < 2


def test_a_torque_that_is_hardly_there_is_wanted_below_the_goal_of_the_largest_torque(data, found):
    """Logs of 0.02 at 0.5 per unit; p2 where they move fastest, p3 of a level hand."""
    names, most, goal = [*found.names], 0.02 * found.parameters.p4, 0.01
    speed = math.sqrt(2) * max(log.rms_speed for log in data.logs)
    # gravity's moment is largest where the hand is level
    moves = {"coulomb": 1.0, "p2": speed, "p3": 1.0}
    for name, factor in moves.items():
        for share in (0.0, 0.004, 0.5):
            values = found.values.copy()
            values[names.index(name)] = value = share * most / factor
            aim = wanted(replace(found, values=values), data.logs, goal)[names.index(name)]
            hardly = goal * most / factor - value  # to where the interval may reach
            assert aim == pytest.approx(max(hardly, goal * value), rel=0.01), name


def test_no_value_that_is_not_significant_is_said_to_be_within_the_goal(found):
    lower = np.where(np.array(found.names) == "coulomb", -1.0, found.lower)
    for estimate, named in ((found, "p3, p4, coulomb"), (replace(found, lower=lower), "p3, p4")):
        said = next_run_text(SimpleNamespace(), estimate, 0.1, 0.01)
        assert said == f"No run is needed: p1, p2, {named} are within 10 %."


def test_without_a_drive_the_largest_torque_is_that_of_gravity(data, found):
    falling = [replace(log, input=0 * log.input, excitation=None) for log in data.logs]
    values = np.where(np.array(found.names) == "coulomb", 0.0, found.values)
    aim = wanted(replace(found, values=values), falling, 0.01)[found.names.index("coulomb")]
    moments = [
        found.parameters.with_added_mass(log.added_mass).p3 * math.sin(np.ptp(log.angle) / 2)
        for log in falling
    ]
    assert aim == pytest.approx(0.01 * max(moments))


@pytest.mark.parametrize("absent", ["p3", "coulomb"])
def test_a_joint_that_is_balanced_or_without_friction_gets_a_plan_that_reaches_the_goal(absent):
    robot = Robot.of_lumped(replace(ROBOT, **{absent: 0.0}))
    seen = {"path": CommandPath(delay=ROBOT.delay), "encoder": Encoder(steps=65536)}
    rig = Rig(robot=robot, **seen, **SIMULATED)
    sines = [Sine(omega=omega, amplitude=0.03) for omega in (3.0, 7.0)]
    runs = [(mass, sine) for mass in MASSES[::2] for sine in sines]
    before = bf.identify(list(simulate_runs(rig, runs, 6.5, range(4))))
    assert abs(before.estimate.named[absent]) < 0.01 * getattr(ROBOT, absent)
    best = next_runs(before.data, before.estimate, duration=20.0, goal=0.01)[0]
    assert best.expected[1] <= 1
    assert best.runs < MOST_RUNS


def test_a_campaign_plans_the_same_run_alike(data, found):
    plans_ = [p for p in next_runs(data, found, goal=0.15) if isinstance(p.recipe.signal, Sine)]
    for plan in plans_[:3]:
        sine, mass = plan.recipe.signal, plan.recipe.log.added_mass
        law = Signal(lambda t, sine=sine: sine.amplitude * math.sin(sine.omega * t))
        recipe = Recipe(
            what="", kind="", added_mass=mass, duration=40 + STILL, law=lambda _, law=law: law
        )
        expected = Expected(resonance=resonance_frequency(found.parameters.with_added_mass(mass)))
        log = played(data, found, recipe, Limits(command=1.0), expected)
        aim = wanted(found, data.logs, 0.15)
        (same,) = plans(data, found, [(recipe, log)], aim, mounted=mass, price=0.0)
        assert same.expected == pytest.approx(plan.expected, rel=0.05)


def test_the_cheapest_candidates_come_first_and_those_with_a_warning_last(data, found):
    ranked = next_runs(data, found, goal=0.15, command=1.0, swing=0.5)
    good = [plan for plan in ranked if not plan.recipe.warning]
    assert ranked[: len(good)] == good
    assert len(good) < len(ranked)
    assert [plan.cost for plan in good] == sorted(plan.cost for plan in good)
    assert all(np.all(plan.errors <= 1 + 1e-9) for plan in ranked)
    assert good[0].cost < 0.9 * good[-1].cost
    assert all(plan.recipe.swing <= 0.5 for plan in good)
    assert all(bool(plan.change) == (plan.recipe.log.added_mass != MASSES[-1]) for plan in ranked)


def test_without_gravity_sines_lie_about_those_of_a_hand_that_resonates_at_2_rad_per_s(data, found):
    p1, p3 = found.names.index("p1"), found.names.index("p3")
    omegas = []
    for moment in (0.0, 4 * found.values[p1]):
        of_gravity = np.arange(found.values.size) == p3
        values = np.where(of_gravity, moment, found.values)
        lower = np.where(of_gravity, -found.upper, found.lower)
        ranked = next_runs(data, replace(found, values=values, lower=lower))
        own = [each.recipe for each in ranked if each.recipe.log.added_mass == NO_ADDED_MASS]
        omegas.append(sorted({c.signal.omega for c in own if isinstance(c.signal, Sine)}))
    assert omegas[0] == pytest.approx(omegas[1], rel=0.01)


def test_without_a_covariance_or_with_a_limit_that_is_none_nothing_is_planned(data, found):
    unknown = replace(found, covariance=np.full_like(found.covariance, np.nan))
    with pytest.raises(IdentifiabilityError, match="no covariance"):
        next_runs(data, unknown)
    for limit in ("swing", "duration", "command"):
        for value in (0.0, -1.0, float("nan"), "wide"):
            with pytest.raises(InputError, match=limit):
                next_runs(data, found, **{limit: value})


def test_progress_is_shown_while_candidates_are_judged(data, found, monkeypatch):
    begun, judge = threading.Event(), design.Plan

    def track(items, _):
        begun.set()
        yield from items

    monkeypatch.setattr(design, "Plan", lambda **plan: begun.wait(5) and judge(**plan))
    assert all(next_runs(data, found, track=track)), "work is over before its progress is shown"


def test_every_proposed_input_can_be_run_as_it_is_proposed(data, found):
    ranked = [each.recipe for each in next_runs(data, found, swing=10.0)]
    peaks = [each.log.input.max() for each in ranked]
    assert max(peaks) == pytest.approx(0.02, rel=0.01)  # the largest that was logged
    assert {type(each.signal) for each in ranked} == {Sine, Multisine, FreeDecay}
    robot = Robot.of_lumped(replace(found.parameters, delay=0.0))
    rig = Rig(robot=robot, path=CommandPath(delay=max(found.parameters.delay, 0.0)), **SIMULATED)
    runs = [(each.log.added_mass, each.signal) for each in ranked]
    seeds = range(len(runs))
    for each, log in zip(ranked, simulate_runs(rig, runs, 40.0, seeds), strict=True):
        assert np.abs(log.angle).max() == pytest.approx(each.swing, rel=0.02), each.what


SERVO = LumpedParameters(
    p1=0.0066, p2=0.05, p3=0.02, p4=0.12, coulomb=0.02, load_friction=0.1, back_emf=0.04
)
LAW = ServoLoop.of({"law": "dynamixel-xl330", "kp": 800, "supply": 7.4})
HEAVY = AddedMass(mass=0.4, arm=0.1)


@pytest.fixture(scope="module")
def planned():
    """Candidates after a log with one mass, of which load and Coulomb friction are one number."""
    return _ranked(LAW)


def _ranked(servo, latency=0.0):
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
    return next_runs(DataSet.of([log]), found, swing=1.0)


def test_a_servo_is_planned_set_points_that_move_it_as_predicted(planned):
    robot = Robot.of_lumped(SERVO)
    rig = Rig(robot=robot, simulator=Simulator.GREY_BOX, clock=Clock(step=0.01), servo=LAW)
    for each in (plan.recipe for plan in planned[::3]):
        assert each.servo == LAW
        falls = isinstance(each.signal, FreeDecay)
        assert ("torque off" if falls else "set-point: ") in each.what
        own = replace(rig, torque_off=((0.0, 4.0),)) if falls else rig
        (log,) = simulate_runs(own, [(each.log.added_mass, each.signal)], 4.0, [1])
        assert np.abs(log.angle).max() == pytest.approx(each.swing, rel=0.02), each.what
    assert max(p.recipe.swing for p in planned if not p.recipe.warning) <= 1.0


def test_another_mass_tells_load_friction_from_coulomb_friction(planned):
    """The same slow motion with another mass than the logs', with which both are one number."""
    told = {(str(p.recipe.signal), p.recipe.log.added_mass): p.errors[2:] for p in planned}
    sines = [p.recipe.signal for p in planned if isinstance(p.recipe.signal, Sine)]
    slow = {str(each) for each in sines if each.omega < 10}
    assert len(slow) == 7
    for signal in slow:
        coulomb, load = told[signal, NO_ADDED_MASS] / told[signal, HEAVY]
        assert coulomb < 0.9, signal
        assert load < 1, signal


def test_set_points_are_as_fast_as_the_logs_and_speeds_of_a_law_of_speed(planned):
    """Those were 0.9 rad at 4 rad/s, and set-points of speed are in rad/s."""
    sines = [p.recipe.signal for p in planned if isinstance(p.recipe.signal, Sine)]
    assert max(each.omega * each.amplitude for each in sines) == pytest.approx(3.6, rel=0.05)
    law = ServoLoop.of({"law": "odrive-velocity", "kp": 0.5, "ki": 0.1})
    of_speed = [plan.recipe for plan in _ranked(law)]
    peaks = {round(each.signal.amplitude, 1) for each in of_speed if "sine of" in each.what[:20]}
    assert max(peaks) == pytest.approx(3.6, rel=0.05)
    assert all("rad/s (kp 0.5, ki 0.1)" in each.what for each in of_speed if "set" in each.what)


def test_a_loop_that_is_not_stable_is_planned_nothing_without_a_warning():
    runs_away = ServoLoop.of({"law": "moteus", "kp": 2000.0, "kd": 1.0})
    ranked = _ranked(runs_away, latency=0.05)
    told = [p.recipe.warning for p in ranked if not isinstance(p.recipe.signal, FreeDecay)]
    assert all(warning.startswith("swings") for warning in told)
    assert np.isfinite([each.errors for each in ranked]).all()


def test_a_plan_tells_of_the_delay_of_a_slow_clock(data, found):
    """It takes the second half of a run: what nothing shows could not become better known."""
    covariance = np.zeros((found.values.size + 1,) * 2)
    covariance[:-1, :-1], covariance[-1, -1] = found.covariance, 4e-4
    own = {"values": -1e-3, "lower": -0.04, "upper": 0.04, "freedom": 10.0}
    more = {name: np.append(getattr(found, name), value) for name, value in own.items()}
    more |= {"names": (*found.names, "slow_delay"), "covariance": covariance}
    slow = replace(found, **more, fixed={**found.fixed, "slow_interval": 2e-3})
    assert min(each.errors[-1] for each in next_runs(data, slow)) < 0.9
