"""URDF and the fields of actuators move a joint as the equation says, and tell what they lack."""

import json
import math

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from butterfly.logs.log import InputKind
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import Prior
from butterfly.model.servo import ServoLoop
from butterfly.twin.forms import Options, write_as
from butterfly.twin.stand_alone import inertial
from tests.twin.in_mjlab import needs_mjlab, said_by_mjlab
from tests.twin.moving import (
    DRIVEN,
    KINDS,
    PARAMETERS,
    STEP,
    acceleration,
    moved,
    ours,
    parsed,
    twin,
)

RANDOM = np.random.default_rng(3).uniform(-2, 2, (20, 3))  # angle, velocity, torque over p1


def _loaded(joint):
    model = mujoco.MjModel.from_xml_string(write_as("urdf", joint).text)
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("kind", ["smooth", "delayed", "motor", "slide"])
def test_mujoco_accelerates_it_as_the_equation_says(kind):
    joint = twin(kind)
    model, data = _loaded(joint)
    model.dof_frictionloss[0] = 0  # which is ours to add
    for angle, velocity, push in RANDOM:
        p, torque = joint.loaded, push * joint.loaded.p1
        data.qpos[0], data.qvel[0], data.qfrc_applied[0] = angle, velocity, torque
        mujoco.mj_forward(model, data)
        dry = p.coulomb * np.sign(velocity)
        expected = acceleration(p, angle, velocity, torque + dry)
        assert data.qacc[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_driven_as_its_comments_say_it_strays_by_the_error_that_they_print(kind):
    joint = twin(kind)
    written = write_as("urdf", joint)
    late = round(joint.parameters.delay / STEP)
    driven = np.concatenate([np.zeros(late), DRIVEN[: DRIVEN.size - late]])
    angles = moved(_loaded(joint)[0], joint.parameters.p4 * driven, "qfrc_applied")
    error = np.abs(angles[:-1] - ours(joint)).max()
    assert error == pytest.approx(written.accuracy.worst, rel=0.02, abs=1e-9)
    assert written.accuracy.sentence in written.text


@pytest.mark.parametrize("kind", KINDS)
def test_pinocchio_accelerates_it_as_the_equation_says(kind):
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio is not installed (pip: pin)")
    joint = twin(kind)
    model = pinocchio.buildModelFromXML(write_as("urdf", joint).text)
    p, data = joint.loaded, model.createData()
    assert model.damping[0] == pytest.approx(p.p2)
    friction = model.upperDryFrictionLimit[0]
    assert friction == pytest.approx(p.coulomb)
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    for angle, velocity, push in RANDOM:
        torque = push * p.p1
        q = np.array([angle] if model.nq == 1 else [np.cos(angle), np.sin(angle)])
        braked = torque - model.damping[0] * velocity - friction * np.sign(velocity)
        found = pinocchio.aba(model, data, q, np.array([velocity]), np.array([braked]))[0]
        expected = acceleration(p, angle, velocity, torque)
        assert found == pytest.approx(expected, rel=1e-10, abs=1e-10)


def test_what_urdf_cannot_say_is_in_a_comment_and_told():
    loop = ServoLoop.of({"law": "dynamixel-x", "kp": 400})
    joint = twin("sticking", limit=12.0, servo=loop, resolution=0.1)
    written = write_as("urdf", joint)
    said = " ".join(written.left_out)
    for each in ("0.04 N m per V", "stribeck 0.002 N m", "bias 0.001 N m", "dynamixel-x", "0.1"):
        assert each in said
    for sentence in written.left_out:
        assert f"<!-- {sentence} -->" in written.text
    late = " ".join(write_as("urdf", twin("delayed")).left_out)
    assert "by 2 steps of 2 ms" in late
    assert "Importers may drop damping and friction" in late
    assert "drag 0.0001 N m s²/rad², spring 0.01 N m/rad" in late


def test_limits_are_those_of_the_drive_and_a_turning_joint_without_any_has_none():
    def limit(kind, **more):
        found = parsed(write_as("urdf", twin(kind, **more)).text).find(".//limit")
        return {} if found is None else {key: float(each) for key, each in found.attrib.items()}

    assert limit("smooth") == {}
    motor = limit("motor", limit=12.0)
    assert motor == pytest.approx({"effort": 0.48, "velocity": 480.0})
    assert limit("slide")["upper"] == 1e6


STEPS = Options(timestep=STEP, integrator="implicitfast")  # mjlab has no RK4
ISAAC_LAB = {
    *("joint_names_expr", "actuator_effort_limit", "actuator_velocity_limit", "stiffness"),
    *("damping", "armature", "friction", "dynamic_friction", "viscous_friction"),
}
OWN = {"DCMotorCfg": {"saturation_effort"}, "DelayedPDActuatorCfg": {"min_delay", "max_delay"}}
"""Fields of Isaac Lab 3.0: of all actuators, and of single ones."""


def _content(kind="smooth", /, **more):
    return json.loads(write_as("actuator", twin(kind, **more), STEPS).text)


CLASSES = {"smooth": "IdealPDActuatorCfg", "delayed": "DelayedPDActuatorCfg"}


@pytest.mark.parametrize(
    ("kind", "limit"), [("smooth", math.inf), ("smooth", 5.0), ("delayed", 5.0), ("motor", 5.0)]
)
def test_isaac_lab_s_classes_have_all_fields(kind, limit):
    told = _content(kind, limit=limit)["isaaclab"]
    assert told["class"] == CLASSES.get(kind, "DCMotorCfg")
    assert told["fields"].keys() <= ISAAC_LAB | OWN.get(told["class"], set())
    assert told["fields"].get("actuator_effort_limit", math.inf) == pytest.approx(0.04 * limit)


def test_a_motor_s_curve_clips_as_its_limit_of_voltage_does():
    limit, p = 5.0, twin("motor").parameters
    told = _content("motor", limit=limit)["isaaclab"]["fields"]
    damping, saturation = told["damping"], told["saturation_effort"]
    volts, velocity = np.random.default_rng(1).uniform(-9, 9, (2, 500))
    falls = saturation * velocity / told["actuator_velocity_limit"]
    curve = np.clip(p.p4 * volts - damping * velocity, -saturation - falls, saturation - falls)
    ours_of = p.p4 * np.clip(volts, -limit, limit) - p.back_emf * velocity
    np.testing.assert_allclose(curve, ours_of, atol=1e-12)
    assert told["damping"] + told["viscous_friction"] == pytest.approx(p.p2)


@pytest.mark.parametrize(
    ("known", "back_emf"), [({}, 2e-3), ({"resistance": 0.5}, 0.04**2 * 0.5)], ids=str
)
def test_a_voltage_drives_mjlab_s_native_motor(known, back_emf):
    """Its torque is K (V - K v)/R: p4 is K/R, and K²/R is the part of p2 that is back EMF."""
    made = _content(known=Prior.of(known), limit=12.0)
    told = made["mjlab"]["fields"]
    kt, ke, resistance = (told["motor_params"][name] for name in ("kt", "ke", "resistance"))
    assert made["mjlab"]["class"] == "BuiltinDcMotorActuatorCfg"
    assert (told["mode"], told["voltage_limit"], kt) == (0, 12.0, ke)
    assert kt / resistance == pytest.approx(0.04)
    assert kt * ke / resistance == pytest.approx(back_emf)
    assert told["viscous_damping"] == pytest.approx(2e-3 - back_emf)
    assert "command itself, in V; it does not clip it: do so at ±12." in " ".join(made["notes"])


def test_other_drives_are_mjlab_s_native_motor_with_p4_as_its_gear():
    made = _content(kind=InputKind.CURRENT, limit=3.0)
    told = made["mjlab"]["fields"]
    assert made["mjlab"]["class"] == "BuiltinMotorActuatorCfg"
    assert (told["gear"], told["effort_limit"], told["viscous_damping"]) == (0.04, 3.0, 2e-3)
    assert "command itself, in A." in " ".join(made["notes"])


def test_it_is_said_that_mjlab_needs_an_environment_of_its_own():
    written = write_as("actuator", twin())
    assert "mjlab/bin/pip install mjlab" in written.notes[-1]
    assert written.notes[-1] in json.loads(written.text)["notes"]


OF_ANGLE = 7.4 * 400 * 4096 / (2 * math.pi) / (256 * 885)  # V/rad by ROBOTIS's units:
OF_SPEED = 12.0 * 100 * (9.5492966 / 0.229) / (128 * 885)  # 1 rad/s is 9.55 rpm, a unit 0.229


@pytest.mark.parametrize(
    ("loop", "stiffness", "damping"),
    [
        ({"law": "dynamixel-xl330", "kp": 400, "supply": 7.4}, OF_ANGLE, 0.0),
        ({"law": "dynamixel-x-velocity", "kp": 100, "supply": 12.0}, 0.0, OF_SPEED),
        ({"law": "pid-torque", "kp": 3.0, "kd": 0.2}, 3.0, 0.2),
        ({"law": "cascade-torque", "kp": 3.0, "kd": 0.2}, 0.6, 0.2),
        ({"law": "speed-torque", "kp": 3.0}, 0.0, 3.0),
    ],
)
def test_a_servo_s_loop_is_a_stiffness_and_a_damping(loop, stiffness, damping):
    kind = InputKind.VOLTAGE if "supply" in loop else InputKind.TORQUE
    made = _content(servo=ServoLoop.of(loop), kind=kind)
    fields = made["isaaclab"]["fields"]
    assert fields["stiffness"] == pytest.approx(0.04 * stiffness)
    assert fields["damping"] == pytest.approx(0.04 * damping)
    native = made["mjlab"]["fields"]
    worth = 1.0 if "supply" in loop else 0.04  # their motor's gains are in volts
    if native.get("mode") == 2:
        assert native["stiffness"] == pytest.approx(damping)
    else:
        assert native.get("stiffness", 0.0) == pytest.approx(worth * stiffness)
        assert native["damping"] == pytest.approx(worth * damping)
    assert native.get("voltage_limit", loop.get("supply")) == loop.get("supply")


@pytest.mark.parametrize(
    ("loop", "said"),
    [
        ({"law": "dynamixel-x", "kp": 400}, "needs its supply in V"),
        ({"law": "pid-torque", "ki": 1.0}, "kp of the loop (pid-torque) is unknown"),
        ({"law": "pid-torque", "kp": 1.0, "ki": 2.0}, "Not included from that loop: ki 2.0"),
    ],
)
def test_what_is_missing_of_a_loop_is_said(loop, said):
    made = _content(servo=ServoLoop.of(loop, whole=False))
    assert said in " ".join(made["notes"])
    assert (made["isaaclab"]["fields"]["stiffness"] > 0) == ("Not included" in said)


def test_the_armature_is_that_of_a_rotor_that_was_known():
    known = Prior.of({"rotor_inertia": 1e-6, "gear_ratio": 20.0})
    assert _content(known=known)["isaaclab"]["fields"]["armature"] == pytest.approx(4e-4)
    made = _content()
    assert "armature" not in made["mjlab"]["fields"]
    assert "Set armature yourself" in " ".join(made["notes"])


def test_friction_at_rest_and_in_motion_have_their_fields():
    made = _content("sticking")
    assert made["isaaclab"]["fields"]["friction"] == pytest.approx(4e-3)
    assert made["isaaclab"]["fields"]["dynamic_friction"] == pytest.approx(2e-3)
    assert made["mjlab"]["fields"]["frictionloss"] == pytest.approx(2e-3)
    assert "stribeck 0.002 N m" in " ".join(made["notes"])


def _in_mjlab(joint, told, commands, target="effort"):
    """The angles of a joint in mjlab, in whose own environment it is moved."""
    turned = np.rad2deg(-joint.parameters.tilt)
    body = (
        f'<mujoco><worldbody><body euler="{turned} 0 0"><joint name="hinge" axis="0 -1 0"/>'
        f"{inertial(joint)}</body></worldbody></mujoco>"
    )
    asked = {**told, "body": body, "step": STEP, "commands": [*map(float, commands)]}
    return said_by_mjlab("joint_in_mjlab.py", asked | {"target": target})["angles"]


def _cogging():
    terms = PARAMETERS | {"cogging": 4e-3, "cogging_cosine": -3e-3, "cogging_periods": 3}
    return {"parameters": LumpedParameters(**terms)}


@needs_mjlab
@pytest.mark.parametrize(
    ("kind", "more"),
    [
        ("delayed", {}),
        ("smooth", {"kind": InputKind.TORQUE, "limit": 0.4}),
        ("motor", {"limit": 0.4}),
        ("smooth", _cogging()),
    ],
)
def test_mjlab_moves_a_joint_by_commands_with_the_printed_error(kind, more):
    joint = twin(kind, **more)
    written = write_as("actuator", joint, STEPS)
    told = json.loads(written.text)["mjlab"]
    angles = _in_mjlab(joint, told, np.clip(DRIVEN, -joint.limit, joint.limit))
    error = np.abs(angles - ours(joint)).max()
    assert np.ptp(angles) > 0.1
    assert error == pytest.approx(written.accuracy.worst, rel=0.01, abs=1e-5)


@needs_mjlab
@pytest.mark.parametrize(
    ("kind", "loop"),
    [
        (InputKind.VOLTAGE, {"law": "pid-voltage", "kp": 3.0, "kd": 0.2, "limit": 0.5}),
        (InputKind.VOLTAGE, {"law": "speed-voltage", "kp": 2.0, "limit": 9.0}),
        (InputKind.TORQUE, {"law": "pid-torque", "kp": 3.0, "kd": 0.2, "limit": 0.5}),
        (InputKind.TORQUE, {"law": "speed-torque", "kp": 2.0, "limit": 0.5}),
    ],
)
def test_mjlab_closes_the_loop_of_a_servo(kind, loop):
    joint = twin(kind=kind, servo=ServoLoop.of(loop))
    told = json.loads(write_as("actuator", joint, STEPS).text)["mjlab"]
    speed, p = "speed" in loop["law"], joint.parameters
    wanted = 3.0 * speed + 0.7

    def rates(_, state):
        angle, velocity = state
        law = loop["kp"] * (wanted - (velocity if speed else angle)) - loop.get("kd", 0) * velocity
        torque = p.p4 * np.clip(law, -loop["limit"], loop["limit"])
        loaded = joint.loaded
        return velocity, (torque - p.p2 * velocity - loaded.p3 * np.sin(angle)) / loaded.p1

    times = STEP * np.arange(500)
    expected = solve_ivp(rates, (0, 1), [0, 0], t_eval=times, rtol=1e-9, atol=1e-9).y[0]
    target = "velocity" if speed else "position"
    angles = _in_mjlab(joint, told, np.full(500, wanted), target)
    assert np.ptp(expected) > 0.1
    np.testing.assert_allclose(angles, expected, atol=0.01 * np.ptp(expected))
