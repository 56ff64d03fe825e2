"""Servos in their loops, against differences, another integrator and their laws in formulas."""

import json
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from butterfly.api.identification import Identification
from butterfly.errors import InputError
from butterfly.identification.chosen_terms import offered_rows
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.output_error import OutputError
from butterfly.identification.estimators.start import servo_start, starts
from butterfly.identification.identify import simulated
from butterfly.identification.segments import driven, driven_alone
from butterfly.identification.simulation import Simulation, segment_length
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import NO_PRIOR, Known, Prior
from butterfly.model.servo import LAWS, Output, ServoLoop
from butterfly.model.terms import LOOP_TERMS
from butterfly.report.format import fit_text
from butterfly.report.summary import loop_table

TIME = np.arange(0.0, 1.2, 0.004) + np.random.default_rng(0).uniform(0, 5e-4, 300)
GOAL = 0.8 * np.sin(2 * TIME + TIME**2) + np.where(TIME > 0.5, 0.4, 0.0)
ENABLED = np.where((TIME > 0.8) & (TIME < 0.95), 0.0, 1.0)
JOINT = LumpedParameters(
    p1=0.0066, p2=0.031, p3=0.3, p4=0.09, coulomb=0.02, stribeck=0.01, motor_friction=0.15,
    load_friction=0.1, delay=0.0045, dead_zone=0.02, compression=0.02, back_emf=0.01, latency=0.003,
)  # fmt: skip
OF_OUTPUT = {Output.CURRENT: 0.4, Output.TORQUE: 1.0}
LOOPS = {
    "dynamixel-xl330": {"kp": 400, "ki": 2000, "kd": 40},
    "dynamixel-x": {"kp": 300, "dead_band": 0.01},
    "dynamixel-x-velocity": {"kp": 800, "ki": 600},
    "feetech-sts": {"kp": 16, "speed_limit": 1.5},
    "odrive": {"kp": 20, "kd": 0.5, "ki": 2.0, "speed_limit": 6.0, "limit": 0.4},
    "odrive-velocity": {"kp": 0.5, "ki": 2, "limit": 0.4},
    "moteus": {"kp": 8, "kd": 0.3, "ki": 10, "limit": 0.5},
    "pid-current": {"kp": 4, "kd": 0.1, "limit": 2, "slew": 19, "resistance": 3}
    | {"back_emf_constant": 0.3},
    "pid-voltage": {"kp": 20, "current_limit": 1, "resistance": 3, "back_emf_constant": 0.3}
    | {"clock": 0.012},
}


def _log(law, **more):
    servo = ServoLoop.of({"law": law, "supply": 7.0, **LOOPS[law]})
    told = {"input_kind": "setpoint", "servo": servo, "enabled": ENABLED} | more
    return driven(Log(TIME, input=GOAL, angle=0.3 * np.sin(2 * TIME), **told))


@pytest.mark.parametrize("input_kind", ["voltage", "torque"])
def test_back_emf_is_tried_of_drives_that_feel_it(input_kind):
    log = replace(_log("moteus"), input_kind=input_kind)
    rows, _ = offered_rows([log], NO_PRIOR)
    assert ("back_emf" in rows) == (input_kind == "voltage")


@pytest.mark.parametrize(
    ("law", "lag"), [(law, 0.003 * (law == "dynamixel-xl330")) for law in LOOPS]
)
def test_derivatives_in_a_loop_are_those_of_differences(law, lag):
    log = _log(law)
    own = OF_OUTPUT.get(LAWS[law].output, 0.09)
    joint = replace(JOINT, p4=own, time_constant=lag)
    simulation = Simulation(log, joint)
    names = ["p1", "p2", "p3", "p4", "coulomb", "stribeck", "delay", "back_emf"]
    names += ["motor_friction", "load_friction", "dead_zone", "compression", "loop_kp", "loop_ki"]
    names += ["loop_kd", "latency", "zero", "velocity", *["time_constant"][: bool(lag)]]
    values, found = simulation.linearised(names, joint, 0.1, 0.2)
    alone, *_ = simulation.linearised([], joint, 0.1, 0.2)
    np.testing.assert_allclose(alone, values, rtol=0, atol=1e-12)
    assert {each.size for each in simulation.averages(joint)} == {values.size}

    def errors(name, step):
        point = {"zero": 0.1, "velocity": 0.2} | {name: step + getattr(joint, name, 0.0)}
        point |= {n: v + step for n, v in (("zero", 0.1), ("velocity", 0.2)) if n == name}
        moved = {n: v for n, v in point.items() if n not in {"zero", "velocity"}}
        at = replace(joint, **moved)
        return simulation.linearised(["p1"], at, point["zero"], point["velocity"])[0]

    for column, name in zip(found.T, names, strict=True):
        for share in (1e-6, 1e-5, 1e-7):
            h = share * (abs(getattr(joint, name, 1.0)) or 1.0)
            difference = (errors(name, h) - errors(name, -h)) / (2 * h)
            if np.linalg.norm(difference - column) <= 1e-5 * np.linalg.norm(difference):
                break
        else:
            pytest.fail(name)


@pytest.mark.parametrize("law", ["pid-torque", "cascade-torque"])
def test_a_fast_loop_moves_the_joint_as_its_continuous_law_does(law):
    gains = {"kp": 6.0, "kd": 0.2, "ki": 3.0}
    servo = ServoLoop.of({"law": law, "clock": 1e-4, **gains})
    joint = LumpedParameters(p1=0.01, p2=0.02, p3=0.3, p4=1.0)
    log = driven(Log(TIME, input=0.5 * np.sin(5 * TIME), angle=0 * TIME, input_kind="setpoint",
                     intersample="first_order_hold", servo=servo))  # fmt: skip

    def rates(t, state):
        x, v, z = state
        e = 0.5 * np.sin(5 * t) - x
        rise = e if law == "pid-torque" else gains["kp"] * e - v
        steep = gains["kp"] if law == "pid-torque" else gains["kd"]
        torque = steep * rise + gains["ki"] * z - (gains["kd"] * v if law == "pid-torque" else 0.0)
        return v, (torque - joint.p2 * v - joint.p3 * np.sin(x)) / joint.p1, rise

    wanted = solve_ivp(rates, (TIME[0], TIME[-1]), (0, 0, 0), t_eval=TIME, rtol=1e-9, atol=1e-11)
    errors = {}
    for clock in (1e-3, 5e-4):
        own = replace(log, servo=replace(servo, clock=clock))
        found = Simulation(own, joint).run(joint, 0.0).at(TIME)
        errors[clock] = np.abs(found - wanted.y[0]).max()
    assert errors[5e-4] < 1e-3
    assert errors[5e-4] == pytest.approx(errors[1e-3] / 2, rel=0.1)  # of the hold's half period


def test_the_drive_is_rebuilt_as_the_law_says_and_0_while_off():
    supply = np.linspace(7.4, 6.9, TIME.size)
    log = _log("dynamixel-xl330", supply=supply, servo=ServoLoop.of({"law": "dynamixel-xl330",
                                                                     "kp": 800}))  # fmt: skip
    share = 0.5 - 0.5 * 1e-3 / np.mean(np.diff(TIME))  # of a step, when its mean angle is seen
    seen = log.angle + share * np.append(np.diff(log.angle), 0.0)
    duty = np.clip((GOAL - seen) * 4096 / (2 * np.pi) * 800 / (256 * 885), -1, 1)
    np.testing.assert_allclose(log.input, supply * duty * ENABLED, atol=1e-12)
    assert log.input_kind is InputKind.VOLTAGE
    assert np.all(log.setpoint == GOAL)


def test_a_rebuilt_drive_is_that_of_set_points_that_arrive_late():
    servo = ServoLoop.of({"law": "pid-torque", "kp": 2.0})
    goal = np.sin(3 * TIME)
    log = driven(Log(TIME, input=goal, angle=0 * TIME, input_kind="setpoint", servo=servo))
    alone = driven_alone(log, replace(JOINT, delay=0.02, loop_kp=1.5))
    wanted = 3.0 * np.sin(3 * (TIME - 0.02))  # steps hold what was there half a step before
    np.testing.assert_allclose(alone.input[20:], wanted[20:], atol=0.006)
    recorded = replace(log, rebuilt=False)
    assert driven_alone(recorded, JOINT).input is recorded.input


@pytest.mark.parametrize(
    ("law", "gain", "lag"), [("odrive-velocity", "kp", 2e-3), ("moteus", "kd", 8e-4)]
)
def test_firmware_sees_a_velocity_through_its_filter(law, gain, lag):
    servo = ServoLoop.of({"law": law, "kp": 1e-9, gain: 2.0, "clock": 4.25e-3})  # a sample's
    told = {"input_kind": "setpoint", "servo": servo, "velocity": 40 * TIME}
    log = driven(Log(TIME, input=0 * TIME, angle=0 * TIME, **told))
    seen = -log.input / (2.0 / (2 * np.pi))
    np.testing.assert_allclose(seen[50:], 40 * (TIME[50:] - lag), atol=0.01)


SIMPLE = LumpedParameters(p1=0.0066, p2=0.031, p3=0.3, p4=0.09, coulomb=0.01)


def _simulated(*goals, joint=SIMPLE, enabled=None, gains=MappingProxyType({}), **told):
    """The data set of a servo of kp 20 that followed some goals, its loop as told."""
    servo = ServoLoop.of({"law": "pid-voltage", "kp": 20.0, "limit": 6.0, **gains})
    logs = []
    for number, goal in enumerate(goals):
        log = Log(TIME, input=goal, angle=0 * TIME, input_kind="setpoint", servo=servo)
        log = replace(log, enabled=enabled)
        angle = Simulation(driven(log), joint).run(joint, 0.0).at(TIME)
        own = replace(servo, **told)
        logs.append(replace(log, angle=angle, servo=own, zero=Known(value=0.0), name=f"{number}"))
    return DataSet.of(logs, known=Prior.of({"p3": 0.3}))


def _values(estimate):
    return dict(zip(estimate.names, estimate.values.tolist(), strict=True))


def test_a_servo_is_identified_from_its_set_points_and_an_uncertain_gain_with_it():
    data = _simulated(GOAL, kp=Known(value=16.0, uncertainty=8.0))
    assert data.input_kind is InputKind.VOLTAGE
    values = _values(OutputError(terms=())(data))
    assert values["loop_kp"] == pytest.approx(1.25, rel=0.01)
    for name in ("p1", "p2", "p4"):
        assert values[name] == pytest.approx(getattr(SIMPLE, name), rel=0.01)
    found = simulated(data, OutputError(terms=())(data))
    assert found.open_loop_fits["0"] > 95  # by the drive that the gain of 20 makes
    with pytest.raises(InputError, match=r"servo_loop: got open; expected closed, as a gain"):
        OutputError(terms=(), servo_loop="open")(data)


@pytest.mark.parametrize("term", ["back_emf", *LOOP_TERMS])
def test_a_term_of_a_servo_is_recovered(term):
    """The back EMF is that part of p2 which is gone where the servo is off."""
    size = {"back_emf": 0.02, "latency": 0.006}.get(term, 1.2)
    joint = replace(SIMPLE, **{term: size})
    off = ENABLED if term == "back_emf" else None
    data = _simulated(GOAL, joint=joint, enabled=off, gains={"ki": 5.0, "kd": 0.4})
    assert _values(OutputError(terms=(term,))(data))[term] == pytest.approx(size, rel=0.01)


@pytest.mark.parametrize("size", [1.0, 1.2])
def test_a_gain_is_chosen_among_candidates_where_it_differs_from_what_was_given(size):
    data = _simulated(GOAL, 0.7 * GOAL, joint=replace(SIMPLE, loop_kp=size))
    assert OutputError().path(data, ("loop_kp",))[-1] == (("loop_kp",) if size != 1 else ())


def test_d_answers_a_step_of_the_set_point_with_the_limit_for_a_period_at_most():
    servo = ServoLoop.of({"law": "dynamixel-x", "kp": 1e-6, "kd": 500, "limit": 0.4})
    goal = np.where(TIME > 0.5, 1.0, 0.0)
    log = driven(Log(TIME, input=goal, angle=0 * TIME, input_kind="setpoint", servo=servo))
    pushes = log.input.sum() * log.mean_step  # of a duty of 0.4 for a millisecond
    assert pushes == pytest.approx(0.4 * 1e-3, rel=0.01)
    joint = LumpedParameters(p1=0.0066, p2=0.0, p3=0.0, p4=1.0)
    angle = Simulation(log, joint).run(joint, 0.0).at(TIME)
    assert joint.p1 * (np.diff(angle) / np.diff(TIME)).max() == pytest.approx(pushes, rel=0.02)


def test_the_delay_of_a_servo_is_known_but_for_the_wait_for_its_next_look():
    data = _simulated(GOAL, GOAL[::-1].copy())
    widths = {}
    for clock in (1e-3, 4e-3):
        logs = [replace(log, servo=replace(log.servo, clock=clock)) for log in data.logs]
        estimate = OutputError(terms=()).of_logs(logs, starts(data, ()), data.known)
        widths[clock] = (estimate.upper - estimate.values)[estimate.names.index("delay")]
    assert widths[4e-3] > 1.9 * 4e-3 / 12**0.5
    assert widths[1e-3] < widths[4e-3]


def _over(terms, fixed, horizon):
    return OutputError(terms=tuple(terms), fixed=tuple(fixed), horizon=horizon).problem


def test_fits_of_servos_begin_with_the_delay_of_their_set_points():
    data = _simulated(GOAL, joint=replace(SIMPLE, delay=0.018))
    first = starts(data, ())[0]
    begun = servo_start(_over, ((), ()), data.logs, first, data.known)
    assert begun.parameters.delay == pytest.approx(0.018, abs=1e-3)
    assert begun.parameters.p1 == pytest.approx(SIMPLE.p1, rel=0.03)
    assert begun.parameters.motor_friction == begun.parameters.load_friction == 0.0  # not asked


def test_a_first_guess_without_gravity_and_damping_is_one_to_begin_with():
    data = _simulated(GOAL)
    first = starts(data, ())[0]
    poor = replace(first.parameters, p1=1.5 * SIMPLE.p1, p2=0.0, p3=0.0)
    guess = replace(first, parameters=poor)
    begun = servo_start(_over, ((), ()), data.logs, guess, Prior.of({"p4": 0.09}))
    assert begun.parameters.p1 == pytest.approx(SIMPLE.p1, rel=0.05)


def test_a_loop_of_speed_keeps_where_it_began_and_a_fit_finds_out():
    whole, still = {"horizon": np.inf, "velocity_known": False}, np.maximum(TIME - 0.5, 0.0)
    of_speed, of_angle = (
        replace(_log(law), angle=still) for law in ("dynamixel-x-velocity", "dynamixel-x")
    )
    assert segment_length(of_speed, JOINT, **whole) == np.inf
    assert segment_length(of_angle, JOINT, **whole) is None
    moving = replace(of_angle, angle=np.sin(TIME))
    assert segment_length(moving, JOINT, **whole) == np.inf


def test_a_fit_with_the_loop_open_follows_the_drive():
    data = _simulated(GOAL, kp=Known(value=25.0))  # a drive that is 25 % too large
    errors = {}
    for way in ("closed", "open"):
        found = OutputError(terms=(), servo_loop=way)(data)
        for moved in (data.logs[0], data.logs[0].opened):
            angle = Simulation(moved, found.parameters).run(found.parameters, 0.0).at(TIME)
            errors[way, moved.closed] = np.std(angle - moved.angle)
    assert errors["open", False] < 0.8 * errors["closed", False]
    assert errors["closed", True] < 0.8 * errors["open", True]
    with pytest.raises(InputError, match=r"servo_loop.*'closed'"):
        OutputError(servo_loop="ajar")


def test_what_follows_in_the_loop_and_by_the_drive_alone_is_told_of_each_log():
    data = _simulated(GOAL, 0.5 * GOAL).holding_out(["1"])
    off = replace(SIMPLE, p2=0.04)
    names = ("p1", "p2", "p4", "coulomb")
    values = np.array([getattr(off, name) for name in names])
    told = {"covariance": 1e-6 * np.eye(4), "lower": 0.9 * values, "upper": 1.1 * values}
    estimate = Estimate(method="oe", names=names, values=values, fixed={"p3": 0.3}, **told)
    found = Identification.of(simulated(data, estimate))
    runs = {log.name: log for part in (data, data.test_logs) for log in part.logs}
    for name, log in runs.items():
        for moved, told in ((log, found.mean_errors), (log.opened, found.open_loop_fits)):
            angle = Simulation(moved, off).run(off, 0.0).at(TIME)
            error = np.abs(angle - log.angle)
            share = 1 - np.sqrt(np.mean(error**2)) / np.std(log.angle)
            expected = np.mean(error) if moved.closed else 100 * share
            assert told[name] == pytest.approx(expected, rel=1e-6)
    again = Identification.from_dict(json.loads(json.dumps(found.to_dict())))
    assert (again.open_loop_fits, again.mean_errors) == (found.open_loop_fits, found.mean_errors)
    rows = {row[0]: row[1:] for row in loop_table(again).rows}
    assert rows["in the loop"][3] == f"{1e3 * found.mean_errors['0']:.1f}"
    assert rows["by the drive alone, held out"][0] == fit_text(found.open_loop_fits["1"])
    (line,) = [line for line in found.summary if line.startswith("FIT in the loop")]
    assert f"{rows['in the loop'][3]} mrad off on average; by the drive alone" in line
    drawn = found.page().series["time"]
    assert [trace.get("name") for trace in drawn.data][-1] == "set-point"


@pytest.mark.parametrize(
    ("told", "field"),
    [
        ({"kp": 1}, "loop.law"),
        ({}, "loop.law"),
        ({"law": "pid-duty", "kp": -1}, "loop.kp"),
        ({"law": "dynamixel", "kp": 1}, "loop.law"),
        ({"law": "pid-duty", "gain": 1}, "loop.gain"),
        ({"law": "pid-duty"}, "loop.kp"),
        ({"law": "odrive", "kp": 20}, "loop.kd"),
        ({"law": "pid-duty", "kp": 1, "clock": 0}, "loop.clock"),
        ({"law": "pid-duty", "kp": 1, "limit": -1}, "loop.limit"),
        ({"law": "pid-duty", "kp": 1, "current_limit": 1}, "loop.current_limit"),
    ],
)
def test_a_slip_in_a_loop_is_named(told, field):
    with pytest.raises(InputError) as refusal:
        ServoLoop.of(told)
    assert refusal.value.field == field
    with pytest.raises(InputError, match="loop"):
        Log(TIME, input=GOAL, angle=GOAL, input_kind="setpoint")
