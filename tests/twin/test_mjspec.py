"""A joint attached to an arm that is held still moves as it does alone."""

import os

import mujoco
import numpy as np
import pytest

from butterfly.api.identified_model import IdentifiedModel
from butterfly.model.parameters import LumpedParameters
from tests.twin.moving import DRIVEN, MASS, PARAMETERS, STEP, moved

ARM = """
<mujoco>
  <compiler angle="degree"/>
  <worldbody>
    <body pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" armature="1e9" range="-90 90"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" density="500"/>
      <body pos="0.3 0 0" euler="0 0 30">
        <joint name="elbow" axis="0 1 0" armature="1e9"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" density="500"/>
        <site name="tool" pos="0.2 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="shoulder" joint="shoulder"/></actuator>
</mujoco>"""
"""Two links, too inert to give way."""


@pytest.fixture(scope="module", params=[{}, {"coulomb": 2e-3, "delay": 0.004, "spring": 0.02}])
def model(request):
    return IdentifiedModel(LumpedParameters(**PARAMETERS | request.param))


@pytest.fixture(scope="module")
def alone(model):
    return model.mjspec(MASS, timestep=STEP)


def _on_arm(arm, part, site):
    """An arm that carries the joint upright at a site, both compiled, and where the joint is."""
    tool = arm.site(site)
    still = arm.copy().compile()
    data = mujoco.MjData(still)
    mujoco.mj_kinematics(still, data)
    turned, upright, own = data.site(site).xmat, np.zeros(4), np.zeros(4)
    mujoco.mju_mat2Quat(own, turned)
    mujoco.mju_negQuat(upright, own)
    local = np.zeros(4)
    mujoco.mju_mulQuat(local, np.array(tool.quat), upright)
    frame = tool.parent.add_frame(pos=tool.pos, quat=local)
    arm.attach(part, frame=frame, prefix="wrist_")
    arm.option.timestep, arm.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    return arm.compile()


def _moved_on(model):
    motor = model.actuator("wrist_motor").id
    joint = model.jnt_qposadr[model.actuator_trnid[motor, 0]]
    data = mujoco.MjData(model)
    angles = [0.0]
    for command in DRIVEN:
        data.ctrl[motor] = command
        mujoco.mj_step(model, data)
        angles.append(data.qpos[joint])
    return np.array(angles)


def test_on_an_arm_that_is_held_still_it_moves_as_alone(alone):
    compiled = _on_arm(mujoco.MjSpec.from_string(ARM), alone.copy(), "tool")
    angles = moved(alone.compile())
    np.testing.assert_allclose(_moved_on(compiled), angles, atol=1e-6)
    assert np.ptp(angles) > 0.1


def test_it_brings_its_body_and_drive_and_neither_light_nor_camera(alone):
    compiled = _on_arm(mujoco.MjSpec.from_string(ARM), alone.copy(), "tool")
    assert (compiled.njnt, compiled.nu, compiled.nlight, compiled.ncam) == (3, 2, 0, 0)
    assert compiled.joint("wrist_hinge").type == mujoco.mjtJoint.mjJNT_HINGE
    assert compiled.joint("shoulder").range[1] == pytest.approx(np.pi / 2)
