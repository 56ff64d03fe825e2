from dataclasses import replace

import mujoco
import numpy as np
import pytest

from butterfly.files import shipped
from butterfly.logs.log import Sine
from butterfly.model.parameters import AddedMass, Friction, Hand, VoltageDrive
from butterfly.plant.mjcf import compile_model, disc_radius
from butterfly.plant.motor import CommandPath
from butterfly.plant.rig import Rig
from butterfly.plant.robot import Robot
from tests.plant.setting import FINE, mjcf, mujoco_alone

ROBOT = Robot(
    hand=Hand(mass=0.1 + 1e-13, com_distance=1 / 30, inertia=0.003 * (1 + 1e-12)),
    drive=VoltageDrive(resistance=2, torque_constant=0.05, back_emf_constant=0.03),
    friction=Friction(viscous=2e-4 / 3, coulomb=1e-4 / 7),
)
ADDED = AddedMass(mass=0.0517, arm=0.1041, own_inertia=3.1e-5)
SMOOTH = replace(ROBOT, friction=Friction(viscous=1e-3))


def test_what_is_drawn_changes_no_bit_of_what_moves_and_an_exported_model_moves_alike():
    drawn, bare = (compile_model(ROBOT, ADDED, scene=scene) for scene in (True, False))
    assert drawn.ngeom > 40
    assert (bare.ngeom, bare.nmesh, bare.nbody, bare.nu) == (0, 0, 3, 1)
    assert not drawn.geom_contype.any()
    assert not drawn.geom_conaffinity.any()
    for name in ("body_mass", "body_inertia", "body_ipos", "dof_M0", "dof_damping"):
        np.testing.assert_array_equal(getattr(drawn, name), getattr(bare, name))
    commands, exported = 0.4 * np.sin(4e-3 * np.arange(1000)), mjcf(ROBOT, ADDED, scene=True)
    states, alike, *others = (mujoco_alone(each, commands)[0] for each in (drawn, bare, exported))
    np.testing.assert_array_equal(states, alike)
    np.testing.assert_allclose(others, [states], rtol=0, atol=1e-12)
    assert np.ptp(states[:, 0]) > 0.1


def _delayed(attributes):
    """Angle of an exported robot in plain MuJoCo, with a delay, under a sine."""
    text = mjcf(SMOOTH, ADDED).replace('name="motor"', f'name="motor" {attributes}', 1)
    return mujoco_alone(text, 0.6 * np.sin(6e-3 * np.arange(3000)))[0][:, 0]


@pytest.mark.parametrize(
    ("delay", "attributes"),
    [
        (0.0029, 'delay="0.0034" nsample="5" interp="linear"'),
        (0.0101, 'delay="0.0106" nsample="13" interp="linear"'),
        (0.001, 'delay="0.001" nsample="3" interp="zoh"'),
    ],
)
def test_mujoco_s_own_delay_can_be_that_of_the_command_path(delay, attributes):
    """As the model's README says."""
    rig = Rig(robot=SMOOTH, encoder=FINE, path=CommandPath(delay=delay))
    sine = Sine(omega=6.0, amplitude=0.6)
    log = rig.play(ADDED, sine, 3.0, np.random.default_rng(0))
    np.testing.assert_allclose(_delayed(attributes), log.angle, atol=1e-6)
    assert np.abs(_delayed("") - log.angle).max() > 1e-3


def test_the_plate_is_the_published_outline():
    model = mujoco.MjModel.from_xml_path(str(shipped("models/butterfly_hand/hand.xml")))
    start, count = model.mesh_vertadr[0], model.mesh_vertnum[0]
    rotated = model.mesh_vert[start : start + count].astype(float)
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.mesh_quat[0])
    x, y, z = (rotated @ turn.reshape(3, 3).T + model.mesh_pos[0]).T
    radius, phi = np.hypot(x, z), np.arctan2(z, x)
    rim = radius > 0.01
    np.testing.assert_allclose(radius[rim], 0.1095 - 0.0405 * np.cos(2 * phi[rim]), atol=1e-6)
    np.testing.assert_allclose(np.abs(y), 0.002, atol=1e-7)


def test_the_shipped_scene_loads_in_plain_mujoco():
    model = mujoco.MjModel.from_xml_path(str(shipped("models/butterfly_hand/scene.xml")))
    assert model.cam("bench").id == 0
    assert {model.sensor(k).name for k in range(model.nsensor)} == {"angle", "velocity", "torque"}


def test_the_sensors_read_state_and_motor_torque():
    model = compile_model(ROBOT)
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0], data.ctrl[0] = 0.3, 2.0, 1.5
    mujoco.mj_forward(model, data)
    assert data.sensor("angle").data[0] == 0.3
    assert data.sensor("velocity").data[0] == 2.0
    torque = 0.05 / 2 * (1.5 - 0.03 * 2.0)
    assert data.sensor("torque").data[0] == pytest.approx(torque, rel=1e-12)


def test_the_disc_is_of_brass_not_too_small_and_drawn_where_the_added_mass_is_if_any():
    model = mujoco.MjModel.from_xml_string(mjcf(ROBOT, AddedMass(mass=0.154, arm=0.104)))
    disc = model.geom("added_mass")
    radius = disc.size[0]
    assert (radius, disc_radius(1e-12)) == (disc_radius(0.154), 0.004)
    assert 8500 * np.pi * radius**2 * (radius / 2) == pytest.approx(0.154)
    assert model.body(disc.bodyid[0]).name == "added_mass"
    assert (disc.pos[0], disc.pos[2]) == (0, 0)
    assert mujoco.MjModel.from_xml_string(mjcf(ROBOT, AddedMass())).ngeom < model.ngeom
