"""The URDF moves in MuJoCo and in Pinocchio as the equation says, and tells what it cannot say."""

import mujoco
import numpy as np
import pytest

from butterfly.model.servo import ServoLoop
from butterfly.twin.forms import write_as
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
