"""A joint attached to an arm that is held still moves as it does alone."""

import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from butterfly.api.identification import IdentifiedModel
from butterfly.model.parameters import LumpedParameters
from tests.twin.moving import MASS, PARAMETERS, STEP, moved

ARM = """
<mujoco>
  <compiler angle="degree"/>
  <worldbody>
    <body pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" range="-90 90"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" density="500"/>
      <body pos="0.3 0 0" euler="0 0 30">
        <joint name="elbow" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" density="500"/>
        <site name="tool" pos="0.2 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="shoulder" joint="shoulder"/></actuator>
</mujoco>"""
"""Two links."""
OPEN_ARM = Path(sys.prefix, "share/openarm_mujoco/v2/openarm_bimanual.xml")
"""A public robot, of the package openarm-mujoco."""
INERT = 1e9  # kg m², of joints that do not give way


@pytest.fixture(scope="module", params=[{}, {"coulomb": 2e-3, "delay": 0.004, "spring": 0.02}])
def model(request):
    return IdentifiedModel(LumpedParameters(**PARAMETERS | request.param))


@pytest.fixture(scope="module")
def printed(model, tmp_path_factory):
    """The error in rad that an export of the joint prints."""
    path = tmp_path_factory.mktemp("twin") / "twin.xml"
    return model.export(path, MASS, timestep=STEP).accuracy.worst


@pytest.fixture(scope="module")
def alone(model):
    return model.mjspec(MASS, timestep=STEP)


def _on_arm(arm, part, site):
    """An arm that stands still and carries the joint upright at a site."""
    arm.option.timestep, arm.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    arm.option.tolerance = 0  # MuJoCo's is relative to the mean inertia of the whole robot
    for joint in arm.joints:
        joint.armature = INERT
    tool, quaternions = arm.site(site), np.zeros((3, 4))
    data = mujoco.MjData(arm.copy().compile())
    mujoco.mj_kinematics(data.model, data)
    turned, back, own = quaternions
    mujoco.mju_mat2Quat(turned, data.site(site).xmat)
    mujoco.mju_negQuat(back, turned)
    mujoco.mju_mulQuat(own, tool.quat, back)
    frame = tool.parent.add_frame(pos=tool.pos, quat=own)
    arm.attach(part, frame=frame, prefix="wrist_")
    return arm.compile()


@pytest.mark.parametrize("arm", ["two links", "OpenArm"])
def test_on_an_arm_that_is_held_still_it_moves_as_alone(alone, printed, arm):
    if arm == "OpenArm" and not OPEN_ARM.exists():
        pytest.skip("OpenArm is not installed (pip: openarm-mujoco)")
    spec, site = mujoco.MjSpec.from_string(ARM), "tool"
    if arm == "OpenArm":
        spec, site = mujoco.MjSpec.from_file(str(OPEN_ARM)), "left_ee_control_point"
    angles = moved(alone.compile())
    whole = _on_arm(spec, alone.copy(), site)
    error = np.abs(moved(whole, which=whole.actuator("wrist_motor").id) - angles).max()
    assert error < printed
    assert np.ptp(angles) > 0.1


def test_it_brings_its_body_and_drive_and_neither_light_nor_camera(alone):
    compiled = _on_arm(mujoco.MjSpec.from_string(ARM), alone.copy(), "tool")
    assert (compiled.njnt, compiled.nu, compiled.nlight, compiled.ncam) == (3, 2, 0, 0)
    assert compiled.joint("wrist_hinge").type == mujoco.mjtJoint.mjJNT_HINGE
    assert compiled.joint("shoulder").range[1] == pytest.approx(np.pi / 2)
