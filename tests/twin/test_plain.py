"""URDF and the fields of actuators move a joint as the equation says, and tell what they lack."""

import json
import math

import mujoco
import numpy as np
import pytest

from butterfly.logs.log import InputKind
from butterfly.model.prior import Prior
from butterfly.model.servo import ServoLoop
from butterfly.twin.forms import Options, write_as
from butterfly.twin.snippet import inertial
from tests.twin.moving import DRIVEN, KINDS, STEP, acceleration, moved, ours, parsed, twin

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
    *("joint_names_expr", "effort_limit", "velocity_limit", "stiffness", "damping", "armature"),
    *("friction", "dynamic_friction", "viscous_friction"),
}
OWN = {"DCMotorCfg": {"saturation_effort"}, "DelayedPDActuatorCfg": {"min_delay", "max_delay"}}
"""Fields of Isaac Lab 2.3.2: of all actuators, and of single ones."""


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
    assert told["fields"].get("effort_limit", math.inf) == pytest.approx(0.04 * limit)


def test_a_motor_s_curve_clips_as_its_limit_of_voltage_does():
    limit, p = 5.0, twin("motor").parameters
    told = _content("motor", limit=limit)["mjlab"]["fields"]
    damping, saturation = told["damping"], told["saturation_effort"]
    volts, velocity = np.random.default_rng(1).uniform(-9, 9, (2, 500))
    falls = saturation * velocity / told["velocity_limit"]
    curve = np.clip(p.p4 * volts - damping * velocity, -saturation - falls, saturation - falls)
    ours_of = p.p4 * np.clip(volts, -limit, limit) - p.back_emf * velocity
    np.testing.assert_allclose(curve, ours_of, atol=1e-12)
    assert told["damping"] + told["viscous_damping"] == pytest.approx(p.p2)


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
    for fields in (made["mjlab"]["fields"], made["isaaclab"]["fields"]):
        assert fields["stiffness"] == pytest.approx(0.04 * stiffness)
        assert fields["damping"] == pytest.approx(0.04 * damping)


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
    assert (made["mjlab"]["fields"]["stiffness"] > 0) == ("Not included" in said)


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


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("kind", "limit"), [("delayed", math.inf), ("motor", 0.4)])
def test_mjlab_moves_a_joint_by_them_with_the_printed_error(kind, limit):
    actuator = pytest.importorskip("mjlab.actuator", reason="mjlab is not installed")
    entity, sim, torch = map(pytest.importorskip, ("mjlab.entity", "mjlab.sim", "torch"))
    joint = twin(kind, limit=limit)
    written = write_as("actuator", joint, STEPS)
    told = json.loads(written.text)["mjlab"]
    drive = getattr(actuator, told["class"])(**told["fields"])
    turned = np.rad2deg(-joint.parameters.tilt)
    body = (
        f'<mujoco><worldbody><body euler="{turned} 0 0"><joint name="hinge" axis="0 -1 0"/>'
        f"{inertial(joint)}</body></worldbody></mujoco>"
    )
    robot = entity.EntityCfg(
        spec_fn=lambda: mujoco.MjSpec.from_string(body),
        articulation=entity.EntityArticulationInfoCfg(actuators=(drive,)),
    ).build()
    settings = sim.SimulationCfg(mujoco=sim.MujocoCfg(timestep=STEP))
    simulation = sim.Simulation(1, settings, model=robot.spec.compile(), device="cpu")
    robot.initialize(simulation.mj_model, simulation.model, simulation.data, "cpu")
    angles = []
    for command in DRIVEN:
        angles.append(float(robot.data.joint_pos[0, 0]))
        effort = joint.parameters.p4 * float(command)
        robot.set_joint_effort_target(torch.tensor([[effort]]))
        robot.write_data_to_sim()
        simulation.step()
        robot.update(STEP)
    error = np.abs(angles - ours(joint)).max()
    assert np.ptp(angles) > 0.1
    assert error == pytest.approx(written.accuracy.worst, rel=0.01, abs=1e-5)
