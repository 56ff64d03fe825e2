"""Servos in their loops, against differences, another integrator and their laws in formulas."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from butterfly.identification.segments import driven, driven_alone
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import LumpedParameters
from butterfly.model.servo import LAWS, Output, ServoLoop
from tests.model.loops import ENABLED, GOAL, JOINT, LOOPS, TIME, log_of

OF_OUTPUT = {Output.CURRENT: 0.4, Output.TORQUE: 1.0}


@pytest.mark.parametrize(
    ("law", "lag"), [(law, 0.003 * (law == "dynamixel-xl330")) for law in LOOPS]
)
def test_derivatives_in_a_loop_are_those_of_differences(law, lag):
    log = log_of(law)
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
    log = log_of("dynamixel-xl330", supply=supply, servo=ServoLoop.of({"law": "dynamixel-xl330",
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


def test_d_answers_a_step_of_the_set_point_with_the_limit_for_a_period_at_most():
    servo = ServoLoop.of({"law": "dynamixel-x", "kp": 1e-6, "kd": 500, "limit": 0.4})
    goal = np.where(TIME > 0.5, 1.0, 0.0)
    log = driven(Log(TIME, input=goal, angle=0 * TIME, input_kind="setpoint", servo=servo))
    pushes = log.input.sum() * log.mean_step  # of a duty of 0.4 for a millisecond
    assert pushes == pytest.approx(0.4 * 1e-3, rel=0.01)
    joint = LumpedParameters(p1=0.0066, p2=0.0, p3=0.0, p4=1.0)
    angle = Simulation(log, joint).run(joint, 0.0).at(TIME)
    assert joint.p1 * (np.diff(angle) / np.diff(TIME)).max() == pytest.approx(pushes, rel=0.02)
