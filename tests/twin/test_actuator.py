"""An actuator's fields are those of mjlab and Isaac Lab, and move a joint there as they say."""

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
from tests.twin.moving import DRIVEN, STEP, ours, twin

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
