"""Orbits that turn over: closed forms, the law over the top, margins, re-calibration."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipe, ellipk

from butterfly.experiment.run import perform
from butterfly.experiment.schema import Experiment, TargetSpec
from butterfly.logs.health import Repair, examine
from butterfly.model.energy import Orbit, energy
from butterfly.model.parameters import NO_ADDED_MASS, LumpedParameters, TorqueDrive
from butterfly.orbit.controller import EnergyShaping, Observer, gain_for, loop_margins
from butterfly.orbit.loop import mean_speed
from butterfly.orbit.online import OnlineRecalibration, SelfTuning
from butterfly.orbit.recalibration import recalibrate
from butterfly.plant.joints import GreyBoxJoint
from butterfly.plant.motor import CommandPath
from butterfly.report.orbit_page import orbit_page
from tests.orbit import setting
from tests.plant.setting import JOINTS, robot, under_law

THESIS = LumpedParameters(p1=0.00325, p2=0.001, p3=0.04905, p4=10)
TOP = 2 * THESIS.p3
UNEVEN = {"p3_offset": 0.01, "cogging": 5e-3, "cogging_periods": 3, "bias": 2e-3}
WAYS = (1, -1)

ways = st.sampled_from(WAYS)


@settings(max_examples=30)
@given(st.floats(1e-4, 0.1), st.floats(1e-3, 1.0), st.floats(1.0015, 60.0), ways)
def test_period_and_speeds_are_the_elliptic_integrals(p1, p3, share, direction):
    orbit = Orbit.of_energy(replace(THESIS, p1=p1, p3=p3), share * 2 * p3, direction)
    fastest, m = math.sqrt(2 * orbit.energy / p1), 1 / share
    assert orbit.period == pytest.approx(4 * ellipk(m) / fastest, rel=1e-9)
    assert orbit.squared_speed == pytest.approx(4 * ellipe(m) * fastest, rel=1e-9)
    mean = direction * math.pi * fastest / (2 * ellipk(m))
    assert orbit.mean_speed == orbit.size == pytest.approx(mean, rel=1e-9)
    assert Orbit.of_speed(orbit.parameters, mean).energy == pytest.approx(orbit.energy, rel=1e-9)


@settings(max_examples=5)
@given(st.floats(-0.02, 0.02), st.floats(-0.01, 0.01), st.floats(1.05, 5.0), ways)
def test_an_uneven_hand_makes_a_turn_in_its_period(offset, cogging, share, direction):
    p = replace(THESIS, p3_offset=offset, cogging=cogging, cogging_periods=3, bias=1e-3)
    orbit = Orbit.of_energy(p, share * (TOP + 0.06), direction)
    angle, velocity = orbit.solution(np.linspace(0, orbit.period, 40))
    assert angle[-1] - angle[0] == pytest.approx(direction * 2 * math.pi, abs=1e-8)
    assert np.abs(energy(orbit.conserving, angle, velocity) - orbit.energy).max() < 1e-10
    assert Orbit.of_state(p, angle[7], velocity[7]).period == pytest.approx(orbit.period, rel=1e-7)
    mean_square = np.mean(velocity[:-1] ** 2)  # of a periodic motion
    assert orbit.squared_speed == pytest.approx(mean_square * orbit.period, rel=1e-6)


def test_a_balanced_hand_turns_evenly_at_any_speed():
    orbit = Orbit.of_speed(replace(THESIS, p3=0.0), -3.0)
    assert orbit.energy == pytest.approx(THESIS.p1 * 9 / 2)
    assert orbit.period == pytest.approx(2 * math.pi / 3)


@pytest.mark.parametrize(
    ("build", "named"),
    [
        (lambda: Orbit.of_energy(THESIS, 0.9995 * TOP), "0.1% in the model decides"),
        (lambda: Orbit.of_energy(THESIS, 1.0005 * TOP), r"at least 0\.0981981 J"),
        (lambda: Orbit.of_speed(THESIS, -2.5), r"more than 2\.52.* rad/s in either direction"),
        (lambda: Orbit.of_energy(THESIS, 2 * TOP, 0), "direction"),
        (lambda: TargetSpec(speed=3.0, direction=-1), "direction goes with energy"),
    ],
)
def test_what_is_too_near_the_top_or_has_no_direction_is_refused_with_the_reason(build, named):
    with pytest.raises(ValueError, match=named):
        build()


@pytest.mark.parametrize("target", [{"energy": 0.2, "direction": -1}, {"speed": -9.44}])
def test_an_experiment_names_it_by_energy_or_speed(target):
    orbit = TargetSpec(**target)(THESIS)
    assert orbit.mean_speed == pytest.approx(-9.44, abs=0.01)
    assert orbit.of_same_size(replace(THESIS, p3=0.06)).mean_speed == pytest.approx(-9.44, abs=0.01)


@pytest.mark.parametrize("direction", WAYS)
@pytest.mark.parametrize(("share", "changes"), [(1.05, {}), (1.5, UNEVEN)])
def test_without_delay_the_multiplier_is_the_closed_form(share, changes, direction):
    """exp(-p4 gamma oint thd^2 dt), which is 0.3 at the gain for it."""
    p = replace(THESIS, **changes)
    orbit = Orbit.of_energy(p, share * (TOP + 0.03), direction)
    margins = loop_margins(orbit, 2 * gain_for(orbit, 0.3))
    assert margins.multiplier == pytest.approx(0.09, rel=1e-6)
    assert margins.gain == (0.0, math.inf)


def test_of_a_fast_hand_the_delay_margin_is_that_of_an_even_turn():
    """Then dv/dt = -a v(t - d), a = p4 gamma speed^2, which is stable for a d < pi/2."""
    orbit = Orbit.of_speed(THESIS, 60.0)
    gamma = gain_for(orbit, 0.01)
    expected = math.pi / 2 / (THESIS.p4 * gamma * orbit.mean_speed**2)
    assert loop_margins(orbit, gamma).delay == pytest.approx(expected, rel=0.01)


def _late(orbit, gamma, delay):
    """Energies over the orbit's in the last of 50 turns of a hand whose commands are late."""
    begin, speed = orbit.start
    turned = robot(TorqueDrive(gain=10.0), viscous=orbit.parameters.p2)
    joint = GreyBoxJoint(turned, angle=begin, velocity=1.01 * speed)

    class Exact:
        def update(self, *_):
            return joint.velocity

    law = EnergyShaping(orbit, gamma, velocity=Exact())
    log = under_law(joint, law, 50 * orbit.period, 2e-3, path=CommandPath(delay=delay))
    last = log.time > 45 * orbit.period
    velocity = np.gradient(log.angle[last], log.time[last])
    return energy(THESIS, log.angle[last], velocity) / orbit.energy


@pytest.mark.slow
@pytest.mark.parametrize("share", [1.5, 4.0])
def test_the_loop_holds_the_turn_within_the_delay_margin_and_loses_it_beyond(share):
    orbit = Orbit.of_energy(replace(THESIS, p2=0.0), share * TOP)
    gamma = gain_for(orbit, 0.02)
    late = loop_margins(orbit, gamma, lag=1e-3).delay
    assert np.abs(_late(orbit, gamma, 0.9 * late) - 1).max() < 0.02
    assert np.abs(_late(orbit, gamma, 1.1 * late) - 1).max() > 0.1


@pytest.mark.slow
@pytest.mark.parametrize(("p2", "share", "multiplier"), [(1e-3, 1.05, 0.5), (2e-3, 1.2, 0.7)])
def test_friction_made_up_for_late_brings_the_hand_back_below_the_top(p2, share, multiplier):
    """The balance of powers says so a little early: slower turns gain some more while they last."""
    orbit = Orbit.of_energy(replace(THESIS, p2=p2), share * TOP)
    gamma = gain_for(orbit, multiplier)
    late = loop_margins(orbit, gamma, lag=1e-3).delay
    assert _late(orbit, gamma, 0.9 * late).min() * share > 0.97
    assert _late(orbit, gamma, 1.4 * late).min() * share < 0.9


@pytest.mark.parametrize("direction", WAYS)
@pytest.mark.parametrize("joint", JOINTS)
def test_a_kick_pumps_a_hanging_hand_over_the_top_the_way_that_is_wanted(joint, direction):
    rough = robot(TorqueDrive(gain=10.0), viscous=1e-3, coulomb=4e-4, bias=1e-3)
    orbit = Orbit.of_speed(rough.lumped, direction * 8.0)
    law = EnergyShaping(orbit, gain_for(orbit, 0.2), kick=4e-4)
    log = under_law(joint(rough), law, 20.0, 4e-3)
    assert mean_speed(log, 0.0, 14.0) == pytest.approx(direction * 8.0, rel=5e-3)
    backwards = direction * log.angle[log.time < 14]
    assert backwards.min() > -math.pi


@pytest.mark.parametrize("direction", WAYS)
def test_a_hand_that_turns_the_wrong_way_is_turned_round(direction):
    orbit = Orbit.of_speed(THESIS, direction * 8.0)
    joint = GreyBoxJoint(robot(TorqueDrive(gain=10.0), viscous=1e-3), velocity=-direction * 12.0)
    log = under_law(joint, EnergyShaping(orbit, gain_for(orbit, 0.3)), 20.0, 4e-3)
    assert (direction * log.angle).min() < -math.pi
    assert mean_speed(log, 0.0, 14.0) == pytest.approx(direction * 8.0, rel=5e-3)


def test_a_kick_starts_a_hand_that_friction_holds_upright():
    stuck = robot(TorqueDrive(gain=10.0), viscous=1e-3, coulomb=4e-3)
    orbit = Orbit.of_speed(stuck.lumped, 8.0)
    law = EnergyShaping(orbit, gain_for(orbit, 0.3), kick=1e-3)
    log = under_law(GreyBoxJoint(stuck, angle=math.pi), law, 15.0, 4e-3)
    assert mean_speed(log, 0.0, 10.0) == pytest.approx(8.0, rel=0.01)


def test_the_invariant_decays_as_the_closed_form_says():
    orbit = Orbit.of_speed(THESIS, 8.0)
    gamma = gain_for(orbit, 0.6)
    law = EnergyShaping(orbit, gamma, velocity=Observer(THESIS, bandwidth=200.0))
    joint = GreyBoxJoint(robot(TorqueDrive(gain=10.0), viscous=1e-3), velocity=11.0)
    log = under_law(joint, law, 4 * orbit.period)
    velocity = np.gradient(log.angle, log.time)
    values = energy(THESIS, log.angle, velocity) - orbit.energy
    areas = np.concatenate([[0], np.cumsum(velocity[:-1] ** 2 * np.diff(log.time))])
    after = 100  # the observer began at rest
    expected = values[after] * np.exp(-THESIS.p4 * gamma * (areas - areas[after]))  # (114)
    np.testing.assert_allclose(values[after:], expected[after:], atol=0.03 * values[after])


@pytest.fixture(scope="module")
def turning():
    """Logs of a badly informed controller that turns a hand over."""
    spec = setting.plant({"coulomb": 4e-4}, step=2e-3)
    rng = np.random.default_rng(2)
    believed = setting.wrong(spec.robot.lumped, rng)
    orbit = Orbit.of_speed(believed, -8.0)
    rig = setting.grey_rig(spec, rng)
    laws = [(start, EnergyShaping(orbit, gain_for(orbit, 0.3))) for start in setting.STARTS]
    logs = [rig(law, start, 20.0, NO_ADDED_MASS) for start, law in laws]
    return spec.robot.lumped, logs


def test_logs_that_wind_give_the_parameters(turning):
    true, logs = turning
    assert min(np.abs(log.angle).max() for log in logs) > 50
    found = recalibrate(logs, 0.0).estimate
    assert found.names == ("p2", "p3", "p4", "coulomb")
    ratios = np.array([getattr(true, name) / true.p1 for name in found.names])
    assert (np.abs(found.values / ratios - 1) < [1e-3, 1e-4, 1e-3, 0.02]).all()
    assert ((found.lower < ratios) & (ratios < found.upper)).all()


def test_an_encoder_that_counts_one_turn_says_the_same(turning):
    _, logs = turning
    wrapped = [replace(log, angle=np.remainder(log.angle, 2 * math.pi)) for log in logs]
    mended = [examine(log, {Repair.UNWRAP})[0] for log in wrapped]
    one, other = (recalibrate(each, 0.0).estimate.values for each in (logs, mended))
    np.testing.assert_allclose(one, other, rtol=1e-6)


@pytest.fixture(scope="module")
def both():
    """An experiment that turns a hand over and swings it, both badly informed at first."""
    hand = {"mass": 0.1, "com_distance": 0.05, "inertia": 0.003}
    plant = {"hand": hand, "drive": {"torque": {"gain": 10.0}}, "simulator": "grey-box"}
    plant |= {"friction": {"viscous": 1e-3, "coulomb": 4e-4}, "clock": {"step": 4e-3}}
    control = {"target": {"speed": -8.0}, "also": {"amplitude": setting.SIXTY}, "multiplier": 0.3}
    control |= {"starts": [1.05, 0.6, 1.5], "duration": 16.0, "rounds": 2}
    control |= {"believed": {"p1": 0.003, "p2": 0.0012, "p3": 0.045, "p4": 9.0}}
    content = {"name": "both", "plant": plant, "duration": 10.0, "control": control}
    content["plant"]["encoder"] = {"steps": 8192, "noise": 2e-4}
    content["added_masses"] = [{"mass": 0.0, "arm": 0.1}]
    result = perform(Experiment.model_validate(content), threads=1)
    assert result.error is None
    return result


def test_an_experiment_turns_over_swings_and_compares(both):
    record = both.record.orbit
    assert (record.target_rad, record.amplitudes_rad) == (None, ())
    assert record.target_rad_s == pytest.approx(-8.0)
    assert record.speeds_rad_s[-1] == pytest.approx(-8.0, rel=0.01)
    assert record.also.amplitudes_rad[-1] == pytest.approx(setting.SIXTY, abs=0.01)
    assert set(record.also.differences) >= {"p2", "p3", "p4"}
    assert {"p3", "p4"}.isdisjoint(record.also.differing)
    assert record.free_run_rms_rad["re-calibrated"] < 0.05 * record.free_run_rms_rad["generic"]
    assert type(both.record).from_json(both.record.to_json()).orbit == record


def test_its_page_names_what_was_wanted_and_whether_both_agree(both):
    page = orbit_page(both.orbit)
    titles = [section.title for section in page.sections]
    assert "Mean speed per round" in titles
    said = " ".join(page.numbers["summary"])
    assert said.startswith("Held: an orbit of -8 rad/s mean speed. Reached ")
    assert "Held: an orbit of 60°. Reached " in said
    assert "Both orbits agree within their 95 % intervals on" in said
    assert page.numbers["also"]["parameters"]["p3"]["value"] == pytest.approx(15.09, rel=1e-3)
    drawn = {name: figure for each in page.sections for name, figure in each.figures.items()}
    angles = np.concatenate([np.array(line.x) for line in drawn["phase-plane"].data])
    assert np.nanmax(np.abs(angles)) <= 180.1
    *_, table = next(each.tables for each in page.sections if each.title.startswith("Two orbits"))
    assert table.headers[1:3] == ("-8 rad/s", "60°")


@pytest.mark.parametrize("speed", [8.0, -8.0])
def test_on_line_the_turn_becomes_the_one_that_is_wanted(speed):
    spec, rng = setting.plant({"coulomb": 4e-4}, step=4e-3), np.random.default_rng(0)
    true, target = spec.robot.lumped, partial(Orbit.of_speed, speed=speed)
    orbit = target(setting.wrong(true, rng))
    online, shaping = OnlineRecalibration(), EnergyShaping(orbit, gain_for(orbit, 0.3))
    how = {"multiplier": 0.3, "inertia": true.p1, "every": 1.0}
    law = SelfTuning(shaping, online, target, **how)
    log = setting.grey_rig(spec, rng)(law, 1.4, 20.0, NO_ADDED_MASS)
    assert mean_speed(log, 0.0, 14.0) == pytest.approx(speed, rel=2e-3)
    assert online.parameters(true.p1).p3 == pytest.approx(true.p3, rel=2e-4)
