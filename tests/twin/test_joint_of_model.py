"""A joint of somebody's model: gravity and inertia in any pose, and what is refused."""

import math

import mujoco
import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.files import shipped
from butterfly.logs.model_facts import LinkMasses
from butterfly.model.parameters import JointKind
from butterfly.twin.joint_of_model import JointOfModel, compiled, is_urdf, joint_names
from tests.independent.robot_plants import Hidden, built

MODELS = {name: shipped(f"models/{name}/{name}.xml") for name in ("arm", "leg", "linkage")}
BOUND = ("lift", "elbow", "crank", "rod")
"""Joints of the linkage that its equality binds."""
JOINTS = [
    (name, joint)
    for name, path in MODELS.items()
    for joint in joint_names(compiled(path)[1])
    if name != "linkage" or joint not in BOUND
]
BARE = Hidden(armature=0.0, damping=0.0, frictionloss=0.0)

ARM = """
<mujoco>
  {head}
  <worldbody>
    <body name="base">
      {root}
      <inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/>
      <body name="upper" pos="0 0 1">
        <joint name="lift" axis="0 1 0" range="-2 2"/>
        <inertial pos="0 0 -.1" mass="1" diaginertia=".01 .01 .01"/>
        <geom type="mesh" mesh="shape"/>
        <body name="lower" pos="0 0 -.2">
          <joint name="bend" axis="0 1 0" damping=".3" frictionloss=".2" armature=".04"/>
          {weight}
          <geom type="mesh" mesh="shape"/>
        </body>
      </body>
    </body>
  </worldbody>
  {more}
</mujoco>
"""
INERTIAL = '<inertial pos="0 0 -.1" mass=".5" diaginertia=".002 .002 .002"/>'
MISSING = '<asset><mesh name="shape" file="nowhere.stl"/></asset>'
CUBE = '<asset><mesh name="shape" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1"/></asset>'
URDF = """
<robot name="swing">
  <link name="wall"><inertial><mass value="9"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0"
    izz="1"/></inertial></link>
  <link name="rod"><inertial><origin xyz="0 0 -0.25"/><mass value="2"/><inertia ixx="0.05" ixy="0"
    ixz="0" iyy="0.04" iyz="0" izz="0.01"/></inertial></link>
  <joint name="hinge" type="revolute"><parent link="wall"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1" effort="7" velocity="3"/>
    <dynamics damping="0.3" friction="0.1"/></joint>
</robot>
"""


def _written(folder, *, head=CUBE, root="", weight=INERTIAL, more=""):
    path = folder / "robot.xml"
    path.write_text(ARM.format(head=head, root=root, weight=weight, more=more), encoding="utf-8")
    return path


def _pose(rng, robot):
    return {name: float(rng.uniform(-3.0, 3.0)) for name in robot.others}


# In any pose


@pytest.mark.parametrize(("name", "joint"), JOINTS)
def test_gravity_of_a_joint_in_any_pose_is_a_moment_times_a_sine(name, joint):
    rng = np.random.default_rng(1)
    robot = JointOfModel.of(MODELS[name], joint)
    model = robot.model
    dof, place = int(model.jnt_dofadr[robot.joint]), int(model.jnt_qposadr[robot.joint])
    for _ in range(5):
        facts = robot.pose_facts(pose := _pose(rng, robot))
        data = robot.configured(pose)
        for angle in rng.uniform(-4.0, 4.0, 5):
            data.qpos[place] = angle
            mujoco.mj_forward(model, data)
            said = facts.moment * math.sin(angle - facts.zero)
            assert data.qfrc_bias[dof] == pytest.approx(said, abs=1e-12)


@pytest.mark.parametrize(("name", "joint"), JOINTS)
def test_its_inertia_is_that_of_a_robot_in_which_the_others_are_welded(name, joint):
    rng = np.random.default_rng(2)
    robot = JointOfModel.of(MODELS[name], joint)
    for _ in range(3):
        facts = robot.pose_facts(_pose(rng, robot))
        angle = float(rng.uniform(-2.0, 2.0))
        alone = built(robot.model, facts.pose | {joint: angle}, {joint}, BARE, joint).compile()
        data = mujoco.MjData(alone)
        data.qpos[0] = angle
        mujoco.mj_forward(alone, data)
        assert alone.nv == 1
        assert data.M[0] == pytest.approx(facts.inertia, rel=1e-12)
        pull = facts.moment * math.sin(angle - facts.zero)
        assert data.qfrc_bias[0] == pytest.approx(pull, abs=1e-12)


def test_inertia_and_moment_are_those_of_the_parallel_axis_theorem(tmp_path):
    facts = JointOfModel.of(_written(tmp_path), "lift").pose_facts({"bend": math.pi / 2})
    far = math.hypot(0.2, 0.1)  # from the axis to the lower link, bent square
    assert facts.inertia == pytest.approx(0.01 + 0.1**2 + 0.002 + 0.5 * far**2, rel=1e-12)
    moment = 9.81 * math.hypot(1.0 * 0.1 + 0.5 * 0.2, 0.5 * 0.1)
    assert facts.moment == pytest.approx(moment, rel=1e-12)
    assert facts.zero == pytest.approx(math.atan2(-0.05, 0.2), rel=1e-12)


def test_a_vertical_axis_has_no_gravity():
    robot = JointOfModel.of(MODELS["arm"], "pan")
    facts = robot.pose_facts({"shoulder": 0.3})
    assert (facts.moment, facts.zero, robot.gravity_across({})) == (0.0, 0.0, 0.0)


def test_gravity_across_an_axis_is_the_part_that_turns_the_joint():
    robot = JointOfModel.of(MODELS["arm"], "roll")
    sloping = robot.gravity_across({"shoulder": 0.5, "elbow": 0.0, "wrist": 0.0})
    assert sloping == pytest.approx(9.81 * math.cos(0.5), rel=1e-9)


def test_the_rest_of_a_pose_is_where_the_model_begins():
    robot = JointOfModel.of(MODELS["arm"], "elbow")
    expected = {"pan": 0.0, "shoulder": 0.4, "wrist": 0.6, "roll": 0.0}
    assert robot.pose_facts({"shoulder": 0.4}).pose == pytest.approx(expected)


# What drives it, and what the file says


def test_the_file_says_what_the_joint_has(tmp_path):
    more = '<actuator><motor name="m" joint="bend" gear="20" forcerange="-2 2"/></actuator>'
    robot = JointOfModel.of(_written(tmp_path, more=more), "bend")
    facts = robot.facts(
        [robot.pose_facts(pose) for pose in ({}, {}, {"lift": 1.0})], LinkMasses(uncertainty=0.02)
    )
    assert (facts.armature, facts.damping, facts.frictionloss) == (0.04, 0.3, 0.2)
    assert (facts.kind, facts.file, facts.urdf) == (JointKind.HINGE, "robot.xml", False)
    assert [pose.pose for pose in facts.poses] == [{"lift": 0.0}, {"lift": 1.0}]
    (motor,) = facts.actuators
    assert (motor.shortcut, motor.gear, motor.gain, motor.effort) == ("motor", 20.0, 20.0, 40.0)


@pytest.mark.parametrize(
    ("element", "shortcut", "gains"),
    [
        ('<position name="a" joint="bend" kp="9" kv=".5" gear="2"/>', "position", (36.0, 2.0)),
        ('<velocity name="a" joint="bend" kv=".5"/>', "velocity", (0.0, 0.5)),
        (
            '<general name="a" joint="bend" biastype="affine" gainprm="3" biasprm="1 -2 0"/>',
            "general",
            (2.0, 0.0),
        ),
    ],
)
def test_an_actuator_is_known_by_its_gains_at_the_joint(tmp_path, element, shortcut, gains):
    path = _written(tmp_path, more=f"<actuator>{element}</actuator>")
    robot = JointOfModel.of(path, "bend")
    facts = robot.facts([robot.pose_facts({})], LinkMasses())
    (actuator,) = facts.actuators
    assert actuator.shortcut == shortcut
    assert (actuator.kp, actuator.kv) == pytest.approx(gains)


def test_what_an_actuator_adds_to_the_inertia_is_not_that_of_the_links():
    robot = JointOfModel.of(MODELS["leg"], "knee")
    facts = robot.facts([robot.pose_facts({})], LinkMasses())
    assert facts.rotors == pytest.approx(12.0**2 * 8e-5)
    alone = built(robot.model, facts.poses[0].pose | {"knee": -1.0}, {"knee"}, BARE, "knee")
    data = mujoco.MjData(compiled_alone := alone.compile())
    mujoco.mj_forward(compiled_alone, data)
    assert facts.poses[0].inertia == pytest.approx(data.M[0], rel=1e-12)


def test_a_urdf_has_damping_friction_effort_and_range_and_no_armature(tmp_path):
    path = tmp_path / "swing.urdf"
    path.write_text(URDF, encoding="utf-8")
    robot = JointOfModel.of(path, "hinge")
    facts = robot.facts([robot.pose_facts({})], LinkMasses())
    assert is_urdf(path)
    assert not is_urdf(MODELS["arm"])
    assert (facts.urdf, facts.range, facts.effort) == (True, (-1.5, 1.0), 7.0)
    assert (facts.armature, facts.damping, facts.frictionloss) == (0.0, 0.3, 0.1)
    (pose,) = facts.poses
    assert pose.inertia == pytest.approx(0.04 + 2.0 * 0.25**2, rel=1e-12)
    assert pose.moment == pytest.approx(2.0 * 9.81 * 0.25, rel=1e-12)


# What is refused


@pytest.mark.parametrize("joint", BOUND)
def test_a_joint_that_an_equality_closes_a_loop_with_is_refused(joint):
    with pytest.raises(InputError) as refused:
        JointOfModel.of(MODELS["linkage"], joint)
    assert refused.value.field == "equality parallelogram"


@pytest.mark.parametrize(
    ("more", "field"),
    [
        (
            '<equality><joint name="mimic" joint1="bend" joint2="lift"/></equality>',
            "equality mimic",
        ),
        ('<equality><weld name="fixed" body1="lower"/></equality>', "equality fixed"),
        (
            '<tendon><fixed name="belt"><joint joint="bend" coef="1"/><joint joint="lift" '
            'coef="-1"/></fixed></tendon>',
            "tendon belt",
        ),
    ],
)
def test_a_joint_that_moves_others_with_it_is_refused(tmp_path, more, field):
    with pytest.raises(InputError) as refused:
        JointOfModel.of(_written(tmp_path, more=more), "bend")
    assert refused.value.field == field


def test_an_equality_that_is_off_binds_nothing(tmp_path):
    more = '<equality><joint joint1="bend" joint2="lift" active="false"/></equality>'
    assert JointOfModel.of(_written(tmp_path, more=more), "bend").name == "bend"


def test_an_unknown_joint_is_refused_with_the_nearest():
    with pytest.raises(InputError) as refused:
        JointOfModel.of(MODELS["arm"], "sholder")
    assert (refused.value.field, refused.value.value) == ("joint", "sholder")
    assert "shoulder" in refused.value.expected


def test_a_free_joint_is_refused_and_is_held_where_another_is_asked_about(tmp_path):
    path = _written(tmp_path, root='<freejoint name="floating"/>')
    with pytest.raises(InputError, match="a hinge or a slide"):
        JointOfModel.of(path, "floating")
    robot = JointOfModel.of(path, "bend")
    facts = robot.facts([robot.pose_facts({})], LinkMasses())
    assert facts.others == ["lift"]
    assert [each for each in facts.warnings if each.startswith("floating")]


def test_a_pose_of_an_unknown_joint_is_refused():
    robot = JointOfModel.of(MODELS["arm"], "elbow")
    with pytest.raises(InputError) as refused:
        robot.pose_facts({"wirst": 0.1})
    assert refused.value.field == "pose.wirst"
    assert "wrist" in refused.value.expected


def test_a_model_that_does_not_compile_is_refused_with_mujocos_line(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text("<mujoco><worldbody><geom/></worldbody><oops/></mujoco>", encoding="utf-8")
    with pytest.raises(InputError) as refused:
        JointOfModel.of(path, "any")
    assert refused.value.field == "model"
    assert "oops" in str(refused.value.value)


def test_meshes_that_are_not_there_are_not_needed_where_inertias_are_given(tmp_path):
    missing = JointOfModel.of(_written(tmp_path, head=MISSING), "lift").pose_facts({"bend": 0.3})
    there = JointOfModel.of(_written(tmp_path, head=CUBE), "lift").pose_facts({"bend": 0.3})
    assert missing == there


def test_a_body_that_only_its_missing_mesh_weighs_is_refused(tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        JointOfModel.of(_written(tmp_path, head=MISSING, weight=""), "lift")
