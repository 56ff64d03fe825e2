"""An exported robot moves by itself, in MuJoCo alone, as our free run with the same parameters."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from butterfly.api.identified_model import IdentifiedModel
from butterfly.errors import InputError
from butterfly.experiment.source import read_experiment
from butterfly.files import shipped
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.parameters import LumpedParameters, TorqueDrive
from butterfly.plant.joints import GreyBoxJoint
from butterfly.plant.mjcf import mjcf
from butterfly.plant.robot import HAND_MASS, Clutch, Robot
from butterfly.plant.rollout import replay_input
from butterfly.plant.stand_alone import AIM, command_of, models, stand_alone
from butterfly.signals import hold
from tests.plant.setting import ADDED, MOTOR, grey_box, mujoco_alone, robot

MASS = 2.0  # kg, which carries all that is drawn
PLAIN = LumpedParameters(p1=0.003, p2=1e-3, p3=0.05, p4=1)


def _log(inputs, intersample=Intersample.ZERO_ORDER_HOLD):
    return Log(
        time=1e-3 * np.arange(inputs.size),
        input=inputs,
        angle=np.zeros(inputs.size),
        input_kind=InputKind.TORQUE,
        intersample=intersample,
        added_mass=ADDED,
    )


def _moved(text, log, zero=0.0):
    """(n,) angles at a log's stamps: MuJoCo alone, given the mean of the input over each step."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[0] = log.angle[0] - zero
    if model.nhistory and log.intersample is Intersample.FIRST_ORDER_HOLD:
        begun = np.full((model.actuator_history[0, 0], 1), log.input[0])
        mujoco.mj_initCtrlHistory(model, data, 0, None, begun)
    step = model.opt.timestep
    instants = np.arange(log.time[0], log.time[-1] + step, step)
    angles = [data.qpos[0]]
    for command in hold.mean(log.time, log.input, instants, log.intersample).tolist():
        data.ctrl[0] = command
        mujoco.mj_step(model, data)
        angles.append(data.qpos[0])
    return zero + np.interp(log.time, instants, angles)


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
    terms = {
        "smooth": {},
        "dry": {"coulomb": coulomb, "load": 1e-4},
        "pulled": {
            "coulomb": coulomb,
            "bias": p3 * draw(-0.03, 0.03),
            "drag": p1 * draw(0, 0.05),
            "p3_offset": p3 * draw(-0.03, 0.03),
            "cogging": p3 * draw(-0.02, 0.02),
            "cogging_periods": 7.0,
        },
        "sticking": level | {"stribeck_velocity": draw(0.05, 0.5)},
        "bristles": level
        | {"bristle_stiffness": p3 * draw(3, 30), "bristle_damping": p1 * draw(1, 5)},
    }
    parameters = replace(parameters, **terms[kind])
    time = 1e-3 * np.arange(2000)
    most = p3 / parameters.p4 * (0.05 + 4 * parameters.holding / p3)
    inputs = most * (np.sin(0.9 * omega * time) + 0.5 * np.sin(1.4 * omega * time))
    if seed % 2:
        return parameters, _log(inputs, Intersample.FIRST_ORDER_HOLD)
    inputs = most * np.round(inputs / most, 1)  # steps, and a stretch without any
    inputs[1000:1200] = 0
    return parameters, _log(inputs)


@pytest.mark.parametrize("kind", ["smooth", "dry", "pulled", "sticking", "bristles"])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_file_alone_moves_within_a_ten_thousandth_of_a_radian_of_our_free_run(
    kind, seed, tmp_path
):
    parameters, log = _drawn(seed, kind)
    path = tmp_path / "twin.xml"
    IdentifiedModel(parameters).export(path, ADDED, mass=MASS)
    ours = IdentifiedModel(parameters).simulate(log, velocity=0.0).angle
    assert np.ptp(ours) > 0.1
    step = mujoco.MjModel.from_xml_path(str(path)).opt.timestep
    assert (parameters.delay / step) % 1 > 1e-3
    assert np.abs(_moved(path.read_text(), log) - ours).max() < AIM


def test_without_its_delay_the_file_would_move_otherwise():
    parameters, log = _drawn(0, "smooth")
    ours = IdentifiedModel(parameters).simulate(log, velocity=0.0).angle
    undelayed = stand_alone(Robot.of_lumped(parameters, MASS), ADDED).text
    assert np.abs(_moved(undelayed, log) - ours).max() > 10 * AIM


def _quick_start():
    plant = read_experiment(shipped("experiments/quickstart.yaml")).plant
    return plant.robot, vars(plant.path)


@pytest.mark.parametrize(
    ("driven", "path"),
    [
        (robot(viscous=1e-3, coulomb=3e-4), {"delay": 0.00213}),
        (robot(replace(MOTOR, inductance=2e-3), coulomb=3e-4), {"delay": 0.00213}),
        (robot(TorqueDrive(gain=0.025), viscous=1e-3, coulomb=3e-4), {"delay": 0.00213}),
        _quick_start(),
    ],
    ids=["voltage", "inductance", "torque", "quick start"],
)
def test_any_drive_is_delayed_without_help(driven, path):
    written = stand_alone(driven, ADDED, **path)
    assert written.left_out == ()
    log = _log(0.5 * np.sin(4e-3 * np.arange(300)))
    ours = replay_input(GreyBoxJoint(driven, ADDED), log, path["delay"])
    assert np.abs(_moved(written.text, log) - ours).max() < AIM


def test_the_twin_of_the_real_robot_moves_alone(real, tmp_path):
    """It sticks harder than it slides, and its logs have stamps of their own."""
    whole = real.data.logs[20]
    log = whole.piece(0, int(np.searchsorted(whole.time, whole.time[0] + 1.5)))
    model = IdentifiedModel(real.estimate.parameters)
    assert model.parameters.stribeck > 0
    model.export(tmp_path / "twin.xml", log.added_mass)
    ours = model.simulate(log, zero=log.angle[0], velocity=0.0).angle
    moved = _moved((tmp_path / "twin.xml").read_text(), log, log.angle[0])
    assert np.ptp(ours) > 0.1
    assert np.abs(moved - ours).max() < AIM


def test_friction_that_sticks_harder_is_that_of_the_equation_at_every_velocity():
    parameters = replace(PLAIN, p2=0, coulomb=2e-3, stribeck=3e-3, stribeck_velocity=0.2)
    model = mujoco.MjModel.from_xml_string(stand_alone(Robot.of_lumped(parameters)).text)
    data = mujoco.MjData(model)
    for velocity in (-3.0, -0.5, -0.2, -0.05, 0.01, 0.1, 0.3, 0.55, 0.7, 5.0):
        data.qvel[0] = velocity
        mujoco.mj_forward(model, data)
        braked = data.qfrc_constraint[0] + data.qfrc_actuator[0]
        level = parameters.level(abs(velocity))
        assert braked == pytest.approx(-np.sign(velocity) * level, abs=0.002 * parameters.stribeck)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ({"delay": -2e-4}, r"The delay of -0\.2 ms is left out: no robot moves before"),
        ({"delay": 2e-5}, r"The delay of 0\.02 ms is left out"),
        ({"slow_delay": -9.4e-4}, r"fast clock: of the -0\.94 ms in a clock's slow regime nothing"),
        ({"compression": 0.05}, r"set ctrl to u/\(1 \+ 0\.05 \|u\|\) yourself"),
        ({"dead_zone": 0.02}, r"take up to 0\.02 towards 0 from ctrl yourself"),
        ({"resolution": 0.01}, r"set ctrl to multiples of 0\.01 yourself"),
    ],
)
def test_what_mujoco_cannot_do_is_said_to_the_user_and_in_the_file(command, said, tmp_path):
    written = stand_alone(Robot.of_lumped(PLAIN), **command)
    (sentence,) = written.left_out
    assert re.search(said, sentence)
    assert f"<!-- {sentence} -->" in written.text
    if command.keys() <= command_of(PLAIN).keys():
        with pytest.warns(UserWarning, match=said):
            IdentifiedModel(replace(PLAIN, **command)).export(tmp_path / "twin.xml")


@pytest.mark.parametrize("delay", [-8e-6, 0.0, 8e-6])
def test_a_delay_too_short_to_be_seen_is_none(delay):
    assert stand_alone(Robot.of_lumped(PLAIN), delay=delay).left_out == ()


def test_friction_of_a_gear_is_left_out_and_named():
    geared = Robot.of_lumped(replace(PLAIN, motor_friction=0.1, load_stribeck=0.2))
    (sentence,) = stand_alone(geared).left_out
    assert sentence.endswith("in each step, for motor_friction, load_stribeck")
    with pytest.raises(InputError, match="MuJoCo alone has no friction that torque or angle"):
        mjcf(geared)
    with pytest.raises(InputError, match="bristles with friction that torque or angle change"):
        replace(geared.friction, coulomb=1e-3, bristle_stiffness=5.0)


def test_friction_too_strong_for_any_step_is_said():
    strong = LumpedParameters(p1=1e-4, p2=1e-3, p3=0.0, p4=1, coulomb=0.1)
    (sentence,) = stand_alone(Robot.of_lumped(strong)).left_out
    assert sentence.startswith("Friction this strong is up to some 0.03 rad off")


def test_a_limit_of_the_command_is_its_range():
    model = mujoco.MjModel.from_xml_string(stand_alone(robot(), limit=3.5).text)
    np.testing.assert_array_equal(model.actuator("motor").ctrlrange, [-3.5, 3.5])


def test_a_clutch_s_friction_brakes_the_rotor_alone_and_asks_for_shorter_steps():
    rigid = robot(TorqueDrive(gain=1), coulomb=1e-3)
    loose = replace(rigid, clutch=Clutch(backlash=0.01, rotor_inertia=3e-4))
    assert stand_alone(loose).step < stand_alone(rigid).step
    assert mujoco.MjModel.from_xml_string(stand_alone(loose).text).njnt == 2


def test_a_twin_takes_numbers_of_any_kind():
    plain = replace(PLAIN, coulomb=0.003, delay=0.004)
    drawn = replace(plain, **{name: np.float64(number) for name, number in vars(plain).items()})
    texts = [stand_alone(Robot.of_lumped(each), **command_of(each)).text for each in (plain, drawn)]
    assert texts[0] == texts[1]
    assert mujoco.MjModel.from_xml_string(texts[0]).nhistory


def _drawn_about(seed, **more):
    factor = 1 + 0.1 * np.random.default_rng(seed).standard_normal(5)
    values = factor * np.array([0.003, 1e-3, 0.04, 0.5, 8e-4])
    return LumpedParameters(
        **dict(zip(("p1", "p2", "p3", "p4", "coulomb"), values, strict=True)), **more
    )


COMMANDS = 0.02 * np.sin(5e-3 * np.arange(8000))


def _beside_the_grey_box(text, parameters):
    """Angles from 0.3 rad on in plain MuJoCo, and by the equation."""
    states, step = mujoco_alone(text, COMMANDS, 0.3)
    angles = states[:, 0]
    return angles, grey_box(parameters, step * np.arange(angles.size), COMMANDS, 0.3)[0]


def test_each_model_moves_as_the_grey_box_with_its_draw():
    drawn = [_drawn_about(seed, drag=1e-5 * seed, bias=1e-3) for seed in range(4)]
    ends = []
    for parameters, text in zip(drawn, models(drawn, ADDED), strict=True):
        angles, expected = _beside_the_grey_box(text, parameters.with_added_mass(ADDED))
        assert np.abs(angles - expected).max() < 2e-3
        ends.append(expected[-1])
    assert np.ptp(ends) > 1e-2


def test_a_hand_too_light_for_its_parameters_is_made_heavier_or_refused():
    ordinary = LumpedParameters(p1=0.012, p2=0.02, p3=0.62, p4=1.0)
    lumped = Robot.of_lumped(ordinary).lumped
    assert (lumped.p1, lumped.p3) == pytest.approx((0.012, 0.62))
    assert Robot.of_lumped(_drawn_about(0)).hand.mass == HAND_MASS
    (text,) = models([ordinary])
    mujoco.MjModel.from_xml_string(text)
    with pytest.raises(InputError, match=r"--hand-mass.*more than 0\.333 kg"):
        Robot.of_lumped(ordinary, 0.3)


def test_friction_that_is_larger_at_rest_needs_bristles():
    drawn = [_drawn_about(0, stribeck=3e-4), _drawn_about(1)]
    with pytest.raises(InputError, match="bristles"):
        list(models(drawn))
    first, second = models(drawn, bristle_stiffness=10.0)
    assert "lugre" in first
    assert "lugre" not in second
    angles, expected = _beside_the_grey_box(first, drawn[0])
    assert np.abs(angles - expected).max() < 0.02
