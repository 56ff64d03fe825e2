"""An exported joint moves by itself, in MuJoCo alone, as far from our free run as the file says."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from butterfly.identification.simulation import Simulation
from butterfly.logs.log import Intersample
from butterfly.model.parameters import AddedMass, JointKind, LumpedParameters, TorqueDrive
from butterfly.plant.mjcf import text_of
from butterfly.plant.robot import HAND_MASS, Clutch, Robot
from butterfly.signals import hold
from butterfly.twin.forms import Options, write_as
from butterfly.twin.stand_alone import models, stand_alone
from butterfly.twin.twin import Twin
from tests.plant.setting import ADDED, MOTOR, grey_box, mujoco_alone, robot
from tests.twin.alone import PLAIN, log_of, twin_of


def _moved(text, log):
    """Angles and their instants: MuJoCo alone, step by step, under the input's means."""
    model = mujoco.MjModel.from_xml_string(text)
    instants = np.arange(log.time[0], log.time[-1] + 1e-9, model.opt.timestep)
    commands = hold.mean(log.time, log.input, instants, log.intersample)
    return mujoco_alone(model, commands, log.angle[0])[0][:, 0], instants


def _drawn(seed, kind):
    """A random robot whose delay is no multiple of any step, and a log to drive it with."""
    draw = np.random.default_rng(seed).uniform
    p1, omega = 10 ** draw(-3.3, -1.7), draw(3, 8)
    p3 = p1 * omega**2
    parameters = LumpedParameters(
        p1=p1, p2=p1 * draw(0.1, 1.5), p3=p3, p4=p3 * draw(0.3, 3), delay=draw(1e-4, 8e-3)
    )
    coulomb = p3 * draw(0.001, 0.03)
    level = {"coulomb": coulomb, "stribeck": coulomb * draw(0.3, 1)}
    pulled = {"coulomb": coulomb, "bias": p3 * draw(-0.03, 0.03), "drag": p1 * draw(0, 0.05)}
    pulled |= {"p3_offset": p3 * draw(-0.03, 0.03)}
    pulled |= {"cogging": p3 * draw(-0.02, 0.02), "cogging_periods": 7.0}
    bristles = {"bristle_stiffness": p3 * draw(3, 30), "bristle_damping": p1 * draw(1, 5)}
    terms = {"smooth": {}, "dry": {"coulomb": coulomb, "load": 1e-4}, "pulled": pulled}
    terms |= {"sticking": level | {"stribeck_velocity": 0.2}, "bristles": level | bristles}
    parameters = replace(parameters, **terms[kind])
    time = 1e-3 * np.arange(1200)
    most = p3 / parameters.p4 * (0.05 + 4 * parameters.holding / p3)
    inputs = most * (np.sin(0.9 * omega * time) + 0.5 * np.sin(1.4 * omega * time))
    if seed % 2:
        return parameters, log_of(inputs, Intersample.FIRST_ORDER_HOLD)
    inputs = most * np.round(inputs / most, 1)  # steps, and a stretch without any
    inputs[600:750] = 0
    return parameters, log_of(inputs)


WORST = {"smooth": (1e-6, 1e-2), "dry": (2e-4, 1e-2), "pulled": (2e-4, 1e-2)}
WORST |= {"sticking": (1e-3, 2e-2), "bristles": (1e-3, 1e-1)}
"""In rad, over 1.2 s, at steps of 0.5 and 5 ms."""


@pytest.mark.parametrize("kind", WORST)
@pytest.mark.parametrize(("seed", "integrator"), [(0, "RK4"), (1, "implicitfast")])
def test_the_file_moves_alone_as_far_from_our_free_run_as_it_says(kind, seed, integrator):
    parameters, log = _drawn(seed, kind)
    ours = Simulation(log, parameters, longest=1e-3).run(parameters, 0.0, 0.0)
    assert np.ptp(ours.at(log.time)) > 0.1
    for step, most in zip((5e-4, 5e-3), WORST[kind], strict=True):
        asked = Options(timestep=step, integrator=integrator)
        written = write_as("mjcf", twin_of(parameters, log), asked)
        moved, instants = _moved(written.text, log)
        error = np.abs(moved - ours.at(instants)).max()
        assert written.accuracy.worst == pytest.approx(error, rel=1e-3, abs=1e-7)
        assert written.accuracy.sentence in written.text
        if integrator == "RK4":
            assert written.accuracy.worst < most


@pytest.mark.parametrize(
    ("delay", "step", "most", "gained"),
    [(0.0033, 1e-3, 1e-6, 1e3), (0.0033, 5e-3, 1e-3, 1.5), (0.004, 1e-3, 1e-6, 1e3)],
)
def test_a_delay_is_written_in_the_way_that_is_nearest(delay, step, most, gained):
    parameters, log = _drawn(0, "smooth")
    parameters = replace(parameters, delay=delay)
    asked = Options(timestep=step)
    error = write_as("mjcf", twin_of(parameters, log), asked).accuracy.worst
    assert error < most
    without = text_of(stand_alone(twin_of(replace(parameters, delay=0.0), log), asked).root)
    moved, instants = _moved(without, log)
    ours = Simulation(log, parameters, longest=1e-3).run(parameters, 0.0, 0.0)
    assert np.abs(moved - ours.at(instants)).max() > gained * error


@pytest.mark.parametrize(
    ("delay", "step", "written"),
    [(0.0033, 0.001, r"3\.3 ms is written as 3\.8 ms, half a step more"), (0.004, 0.001, "")],
)
def test_a_delay_that_is_written_as_another_is_explained_in_the_file(delay, step, written):
    parameters, log = _drawn(0, "smooth")
    made = write_as("mjcf", twin_of(replace(parameters, delay=delay), log), Options(timestep=step))
    late = 1e3 * float(re.search(' delay="(.*?)"', made.text)[1])
    said = re.search("The delay of (.*) is written as (.*) ms,", made.text)
    assert (said is None) == (late == pytest.approx(1e3 * delay))
    assert said is None or float(said[2]) == pytest.approx(late)
    assert re.search(written, made.text)


@pytest.mark.parametrize("drive", [MOTOR, replace(MOTOR, inductance=2e-3), TorqueDrive(gain=0.025)])
def test_any_drive_is_delayed_without_help(drive):
    driven = robot(drive, viscous=1e-3, coulomb=3e-4)
    log = replace(log_of(0.5 * np.sin(4e-3 * np.arange(700))), input_kind=driven.input_kind)
    twin = twin_of(replace(driven.lumped, delay=0.00213), log, robot=driven)
    written = write_as("mjcf", twin, Options(timestep=2.5e-4))
    assert written.left_out == ()
    assert written.accuracy.worst < 3e-4


def test_friction_that_sticks_harder_is_that_of_the_equation_at_every_velocity():
    parameters = replace(PLAIN, p2=0, coulomb=2e-3, stribeck=3e-3, stribeck_velocity=0.2)
    model = _model(twin_of(parameters))
    data = mujoco.MjData(model)
    for velocity in (-3.0, -0.5, -0.2, -0.05, 0.01, 0.1, 0.3, 0.55, 0.7, 5.0):
        data.qvel[0] = velocity
        mujoco.mj_forward(model, data)
        braked = data.qfrc_constraint[0] + data.qfrc_actuator[0]
        level = parameters.level(abs(velocity))
        assert braked == pytest.approx(-np.sign(velocity) * level, abs=0.004 * parameters.stribeck)


def _model(twin, **asked):
    return mujoco.MjModel.from_xml_string(text_of(stand_alone(twin, Options(**asked)).root))


def test_dry_friction_grips_alike_whatever_the_flags_of_the_model_are():
    """A file that is attached to another model has the flags of that one."""
    text = text_of(stand_alone(twin_of(replace(PLAIN, coulomb=2e-3))).root)
    assert "refsafe" not in text
    loose = text.replace("<flag ", '<flag refsafe="disable" ')
    commands = 0.03 * np.sin(0.012 * np.arange(1000))
    states = [mujoco_alone(each, commands)[0] for each in (text, loose)]
    np.testing.assert_array_equal(*states)


def test_a_clutch_is_a_joint_with_play():
    clutch = Clutch(backlash=0.01, rotor_inertia=3e-4)
    loose = robot(TorqueDrive(gain=1), clutch=clutch, coulomb=1e-3)
    assert _model(twin_of(loose.lumped, robot=loose)).njnt == 2


def test_a_plain_joint_is_a_bar_by_the_name_of_its_data():
    model = _model(twin_of(PLAIN, name="My joint, 2nd try"))
    assert model.names.split(b"\0")[0] == b"my_joint_2nd_try"
    assert model.body("my_joint_2nd_try").id == 1
    assert model.joint("hinge").type == mujoco.mjtJoint.mjJNT_HINGE
    assert "mesh" not in write_as("mjcf", twin_of(PLAIN)).text
    assert twin_of(PLAIN, name="42").identifier == "joint_42"


def test_a_slide_is_a_slide_of_its_own_mass():
    p = LumpedParameters(p1=0.8, p2=0.5, p3=0.0, p4=2.0, coulomb=0.1, delay=0.004)
    carried = AddedMass(mass=0.2, joint=JointKind.SLIDE)
    twin = Twin(name="cart", parameters=p, added=carried, joint=JointKind.SLIDE)
    written = write_as("mjcf", twin)
    model = mujoco.MjModel.from_xml_string(written.text)
    assert model.joint("slide").type == mujoco.mjtJoint.mjJNT_SLIDE
    assert model.body("cart").mass[0] == pytest.approx(1.0)
    assert written.accuracy.unit == "m"
    assert written.accuracy.worst < 1e-3


def _drawn_about(seed, **more):
    factor = 1 + 0.1 * np.random.default_rng(seed).standard_normal(6)
    values = factor * np.array([0.003, 1e-3, 0.04, 0.5, 8e-4, 0.004])
    names = ("p1", "p2", "p3", "p4", "coulomb", "delay")
    return LumpedParameters(**dict(zip(names, values, strict=True)), **more)


def test_each_model_moves_as_the_grey_box_with_its_draw_delay_and_stribeck_included():
    drawn = [_drawn_about(seed, drag=1e-5, bias=1e-3, stribeck=2e-4) for seed in range(4)]
    commands = 0.02 * np.sin(5e-3 * np.arange(1000))
    ends = []
    texts = models(drawn, twin_of(drawn[0]), Options(timestep=1e-3))
    for parameters, text in zip(drawn, texts, strict=True):
        states, step = mujoco_alone(text, commands)
        time = step * np.arange(commands.size + 1)
        late = hold.mean(time[:-1], commands, time - parameters.delay, Intersample.ZERO_ORDER_HOLD)
        expected = grey_box(parameters.with_added_mass(ADDED), time, late)[0]
        assert np.abs(states[:, 0] - expected).max() < 1e-3
        ends.append(expected[-1])
    assert np.ptp(ends) > 1e-3
    assert Robot.of_lumped(drawn[0]).hand.mass == HAND_MASS
