"""The lines for one's own MJCF move a body as the exported model moves."""

from dataclasses import replace
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from butterfly.plant.robot import Clutch
from butterfly.twin.forms import Options, write_as
from butterfly.twin.stand_alone import inertial
from tests.twin.moving import KINDS, STEP, moved, ours, parsed, twin


def _pasted(text, body, *, gravity="0 0 -9.81", armature="0"):
    """A model of somebody's own, with the lines where they say."""
    lines = parsed(text)
    lines.find("joint").set("armature", armature)
    joint, actuators = (ElementTree.tostring(each, encoding="unicode") for each in lines)
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP}" integrator="RK4" gravity="{gravity}"/><worldbody>'
        f"<body>{joint}{body}</body></worldbody>{actuators}</mujoco>"
    )


def _gravity(joint):
    tilt = joint.parameters.tilt
    return f"0 {9.81 * np.sin(tilt)} {-9.81 * np.cos(tilt)}"


@pytest.mark.parametrize("kind", KINDS)
def test_pasted_into_a_body_without_numbers_it_moves_as_the_exported_model(kind):
    joint = twin(kind)
    written = write_as("snippet", joint)
    model = _pasted(written.text, inertial(joint), gravity=_gravity(joint))
    whole = mujoco.MjModel.from_xml_string(write_as("mjcf", joint).text)
    np.testing.assert_allclose(moved(model), moved(whole), atol=1e-9)
    error = np.abs(moved(model)[:-1] - ours(joint)).max()
    assert error == pytest.approx(written.accuracy.worst, rel=0.02, abs=1e-9)
    assert np.ptp(moved(model)) > 0.1


def test_the_armature_makes_up_for_what_one_s_own_body_lacks():
    joint = twin("delayed")
    text = write_as("snippet", joint).text
    assert f"<!--  {inertial(joint)}  -->" in text  # the one to uncomment
    p1, p3 = joint.loaded.p1, joint.loaded.p3
    own, arm = p1 / 3, 0.02  # which has the gravity moment, and a third of the inertia
    mass = p3 / 9.81 / arm
    about = own - mass * arm**2
    body = f'<inertial pos="0 0 {-arm}" mass="{mass}" diaginertia="{about} {about} {about}"/>'
    assert f"armature = {p1:.6g} - I" in text
    theirs = moved(_pasted(text, body, armature=str(p1 - own)))
    np.testing.assert_allclose(theirs, moved(_pasted(text, inertial(joint))), atol=1e-9)


def test_a_clutch_is_not_in_the_lines_and_no_error_is_claimed():
    joint = twin("smooth")
    robot = replace(joint.built[0], clutch=Clutch(backlash=0.1, rotor_inertia=1e-4))
    written = write_as("snippet", replace(joint, robot=robot))
    assert "the clutch" in written.text
    assert "the clutch" in written.left_out[-1]
    assert written.accuracy is None


def test_names_are_the_data_set_s_and_the_step_is_the_one_asked():
    text = write_as("snippet", twin("sticking"), Options(timestep=0.001)).text
    assert 'timestep="0.001"' in text
    lines = parsed(text)
    assert lines.find("joint").get("name") == "my_joint_sticking"
    names = [each.get("name") for each in lines.find("actuator")]
    assert names[:3] == [f"my_joint_sticking_{each}" for each in ("motor", "bias", "slip_1")]
