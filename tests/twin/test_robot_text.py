"""Attributes are written into somebody's robot; the rest of its text and of its model stays."""

import mujoco
import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.files import shipped
from butterfly.twin.robot_text import ACTUATOR, DYNAMICS, Edit, TextChange, with_attributes

DERIVED = {"dof_M0", "dof_invweight0", "body_invweight0", "tendon_invweight0", "actuator_acc0"}
"""Arrays of MuJoCo's that follow from the inertias and armatures in the first pose."""
DERIVED |= {"actuator_length0", "stat.meaninertia"}

ARM = """<mujoco model="arm">
  <!-- <joint name="elbow" armature="7"/> is what it was once -->
  <compiler angle="radian" autolimits="true"/>
  <default>
    <joint armature="0.02" damping=".125"/>
    <default class="weak"><motor gear="10"/></default>
  </default>
  <worldbody>
    <body name="upper"><joint name="shoulder" axis="0 1 0"/><geom size=".02" fromto="0 0 0 .2 0 0"
      type="capsule"/>
      <frame pos=".2 0 0">
        <body name="fore">
          <joint  name = "elbow"
                  axis = "0 1 0"  range="-1 1" /><geom size=".1"/>
        </body>
      </frame>
    </body>
  </worldbody>
  <equality><joint name="elbow" joint1="elbow" joint2="shoulder" active="false"/></equality>
  <actuator>
    <motor class="weak" name="elbow" joint="elbow"/>
    <position name="shoulder" joint="shoulder" kp="3"/>
  </actuator>
</mujoco>
"""

URDF = """<?xml version="1.0"?>
<robot name="two">
  <link name="base"/>
  <link name="a"><inertial><origin xyz=".1 0 0"/><mass value="1"/>
    <inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="b"><inertial><origin xyz=".1 0 0"/><mass value="1"/>
    <inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="first" type="continuous">
    <parent link="base"/>
    <child link="a"/>
    <axis xyz="0 1 0"/> <!-- its axis -->
  </joint>
  <joint name="second" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
    <dynamics damping="1" friction='.1'/></joint>
  <transmission name="t"><joint name="second"/></transmission>
</robot>
"""

PARTS = {
    "robot.xml": """<mujoco>
  <include file="parts/classes.xml"/>
  <worldbody>
    <body name="upper"><include file="parts/upper.xml"/></body>
  </worldbody>
  <include file="parts/drives.xml"/>
</mujoco>
""",
    "parts/classes.xml": "<x><default><joint damping='1'/></default></x>",
    "parts/upper.xml": '<x>\n <joint name="shoulder"/>\n <geom size=".1"/></x>',
    "parts/drives.xml": "<mujoco><include file='deep/motors.xml'/></mujoco>",
    "parts/deep/motors.xml": '<x><actuator><motor name="drive" joint="shoulder"/></actuator></x>',
}
"""A robot in five files; the last is found beside the one that includes it."""


def saved(folder, content, name="robot.xml"):
    """Write a robot to a file in a folder, and return its path."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.fixture
def parted(tmp_path):
    """The robot in five files."""
    for name, content in PARTS.items():
        saved(tmp_path / "there", content, name)
    return tmp_path / "there/robot.xml"


def compiled(path):
    """What MuJoCo makes of a file: each array and number, by its name."""
    model = mujoco.MjModel.from_xml_path(str(path))
    values = {name: getattr(model, name) for name in dir(model) if name[0] != "_"}
    for part in ("opt", "stat"):
        whole = getattr(model, part)
        values |= {f"{part}.{name}": getattr(whole, name) for name in dir(whole) if name[0] != "_"}
    return {
        name: np.array(value)
        for name, value in values.items()
        if isinstance(value, np.ndarray | int | float | bytes | np.generic)
    }


def differing(path, other):
    """Names of the fields in which two compiled files differ."""
    before, after = compiled(path), compiled(other)
    assert before.keys() == after.keys()
    assert len(before) > 400
    return {name for name in before if not np.array_equal(before[name], after[name])}


# What is edited, the text that it replaces and by which, and the compiled fields that are edited.
JOINT = Edit("joint", "elbow", {"armature": "0.05", "range": "-2 1.5"})
ELBOW = ('range="-1 1" />', 'range="-2 1.5" armature="0.05" />', {"dof_armature", "jnt_range"})
IN_ARM = {
    "a joint whose name an equality and a comment have": (JOINT, *ELBOW),
    "a joint with defaults": (
        Edit("joint", "shoulder", {"damping": "0.5", "frictionloss": "0.1", "ref": None}),
        '"shoulder" axis="0 1 0"',
        '"shoulder" axis="0 1 0" damping="0.5" frictionloss="0.1"',
        {"dof_damping", "dof_frictionloss"},
    ),
    "an attribute that goes": (
        Edit("joint", "elbow", {"range": None}),
        '  range="-1 1" />',
        " />",
        {"jnt_range", "jnt_limited"},
    ),
    "a motor": (
        Edit("motor", "elbow", {"gear": "-3"}),
        'joint="elbow"/>',
        'joint="elbow" gear="-3"/>',
        {"actuator_gear"},
    ),
    "an actuator of any tag": (
        Edit(ACTUATOR, "shoulder", {"kv": "0.25", "kp": "4"}),
        'kp="3"',
        'kp="4" kv="0.25"',
        {"actuator_gainprm", "actuator_biasprm"},
    ),
}
ENCODED = {
    "as it is": lambda text: text.encode(),
    "with CRLF": lambda text: text.replace("\n", "\r\n").encode(),
    "with a mark of UTF-8": lambda text: b"\xef\xbb\xbf" + text.encode(),
    "in single quotes": lambda text: text.replace('"', "'").encode(),
    "in Latin-1": lambda text: (
        '<?xml version="1.0" encoding="ISO-8859-1"?>\n' + text.replace("was once", "\xe9tait")
    ).encode("latin-1"),
    "in one line": lambda text: " ".join(text.split("\n")).encode(),
    "with tabs": lambda text: text.replace("  ", "\t").encode(),
    "with other letters": lambda text: text.replace("was once", "θ é 手 😀").encode(),
}


@pytest.mark.parametrize("encoded", ENCODED.values(), ids=ENCODED)
@pytest.mark.parametrize("case", IN_ARM.values(), ids=IN_ARM)
def test_the_bytes_of_the_attributes_change_and_no_other(tmp_path, encoded, case):
    edit, *texts, fields = case
    content = encoded(ARM)
    old, new = (encoded(text).removeprefix(encoded("")) for text in texts)
    assert content.count(old) == 1
    path, out = saved(tmp_path, content), tmp_path / "out.xml"
    assert with_attributes(path, [edit]).write(out) == ()
    assert out.read_bytes() == content.replace(old, new)
    assert path.read_bytes() == content
    changed = differing(path, out)
    assert fields <= changed <= fields | DERIVED


SHIPPED = {
    "butterfly_hand/hand.xml": ("joint", "hinge", {"damping": "0.25"}, {"dof_damping"}),
    "butterfly_hand/scene.xml": ("joint", "hinge", {"armature": "0.25"}, {"dof_armature"}),
    "plain_joint/bar.xml": ("dcmotor", "motor", {"resistance": "3"}, {"actuator_gainprm"}),
    "plain_joint/slide.xml": ("joint", "hinge", {"armature": "0.5"}, {"dof_armature"}),
    "arm/arm.xml": ("joint", "pan", {"frictionloss": "0.5"}, {"dof_frictionloss"}),
    "leg/leg.xml": ("joint", "hip", {"armature": "0.006"}, {"dof_armature"}),
    "linkage/linkage.xml": (ACTUATOR, "tip", {"kv": None, "kp": "15"}, {"actuator_gainprm"}),
}
FOLLOWING = {"actuator_biasprm"}
"""What MuJoCo makes of a constant of a motor, beside its gain."""


@pytest.mark.parametrize("name", SHIPPED)
def test_of_a_shipped_model_nothing_differs_but_what_is_edited_and_what_follows(tmp_path, name):
    tag, joint, attributes, fields = SHIPPED[name]
    path, out = shipped(f"models/{name}"), tmp_path / "out/robot.xml"
    edited = with_attributes(path, [Edit(tag, joint, attributes)])
    assert edited.write(out) == ()
    assert fields <= differing(path, out) <= fields | DERIVED | FOLLOWING
    lines = [change.line for change in edited.changes]
    file = edited.changes[0].file
    copied = out if file == path else out.with_name(file.name)
    before, after = (where.read_bytes().split(b"\n") for where in (file, copied))
    assert len(before) == len(after)
    others = [k for k, (old, new) in enumerate(zip(before, after, strict=True), 1) if old != new]
    assert others == sorted(set(lines))


def test_dampratio_gives_way_to_the_kv_that_mujoco_makes_of_it(tmp_path):
    path, out = shipped("models/arm/arm.xml"), tmp_path / "out.xml"
    damping = -mujoco.MjModel.from_xml_path(str(path)).actuator("roll").biasprm[2]
    edit = Edit("position", "roll", {"dampratio": None, "kv": repr(float(damping))})
    with_attributes(path, [edit]).write(out)
    assert differing(path, out) == set()
    with_attributes(path, [Edit("joint", "roll", {"armature": "0.1"}), edit]).write(
        out, overwrite=True
    )
    assert differing(path, out) <= {"dof_armature"} | DERIVED


UNNAMED = """<mujoco><worldbody><body><joint name="a"/><geom size=".1"/></body></worldbody>
<actuator><motor joint="a"/></actuator></mujoco>"""


def test_an_actuator_without_a_name_is_found_by_its_joint(tmp_path):
    path = saved(tmp_path, UNNAMED)
    for tag in (ACTUATOR, "motor"):
        edited = with_attributes(path, [Edit(tag, "a", {"gear": "2"}, by="joint")])
        text = UNNAMED.replace('<motor joint="a"', '<motor joint="a" gear="2"')
        assert edited.contents[path].decode() == text
        assert edited.changes == (TextChange(path, 2, "motor of joint 'a'", "gear", None, "2"),)
    with pytest.raises(InputError, match=r"expected actuators with a name; there are none$"):
        with_attributes(path, [Edit(ACTUATOR, "a", {"gear": "2"})])
    saved(tmp_path, ARM)
    edited = with_attributes(path, [Edit("motor", "elbow", {"gear": "2"}, by="joint")])
    assert [change.element for change in edited.changes] == ["motor 'elbow'"]


def test_changes_have_file_line_element_attribute_and_both_values(tmp_path):
    path = saved(tmp_path, ARM)
    edits = [JOINT, Edit("joint", "elbow", {"range": None, "axis": "0 1 0"})]
    assert with_attributes(path, edits).changes == (
        TextChange(path, 14, "joint 'elbow'", "armature", None, "0.05"),
        TextChange(path, 14, "joint 'elbow'", "range", "-1 1", None),
    )
    assert with_attributes(path, []).contents == {path: ARM.encode()}


@pytest.mark.parametrize("encoded", ENCODED.values(), ids=ENCODED)
def test_dynamics_of_urdf_are_set_or_inserted(tmp_path, encoded):
    content = encoded(URDF if encoded is not ENCODED["in Latin-1"] else URDF.split("\n", 1)[1])
    path, out = saved(tmp_path, content, "robot.urdf"), tmp_path / "out.urdf"
    edits = [
        Edit(DYNAMICS, "first", {"damping": "0.5", "friction": "0.25"}),
        Edit(DYNAMICS, "second", {"damping": "2", "friction": None}),
        Edit("joint", "second", {"type": "revolute"}),
    ]
    edited = with_attributes(path, edits[:2])
    edited.write(out)
    assert differing(path, out) == {"dof_damping", "dof_frictionloss"}
    damping = mujoco.MjModel.from_xml_path(str(out)).dof_damping
    assert damping.tolist() == [0.5, 2.0]
    assert [change[2:] for change in edited.changes] == [
        ("dynamics of joint 'first'", "damping", None, "0.5"),
        ("dynamics of joint 'first'", "friction", None, "0.25"),
        ("dynamics of joint 'second'", "damping", "1", "2"),
        ("dynamics of joint 'second'", "friction", ".1", None),
    ]
    assert len(with_attributes(path, edits).changes) == 5


def test_inserted_dynamics_stand_last_on_a_line_of_their_own(tmp_path):
    path = saved(tmp_path, URDF, "robot.urdf")
    edit = Edit(DYNAMICS, "first", {"damping": "0.5", "friction": None})
    assert with_attributes(path, [edit]).contents[path].decode() == URDF.replace(
        "<!-- its axis -->\n", '<!-- its axis -->\n    <dynamics damping="0.5"/>\n'
    )
    nothing = with_attributes(path, [Edit(DYNAMICS, "first", {"damping": None})])
    assert nothing.contents[path].decode() == URDF
    assert nothing.changes == ()


def test_urdf_in_utf_16_stays_so(tmp_path):
    text = URDF.replace('"1.0"', '"1.0" encoding="UTF-16"').replace("its axis", "手")
    path = saved(tmp_path, text.encode("utf-16"), "robot.urdf")
    edits = [Edit(DYNAMICS, "second", {"damping": "2"}), Edit(DYNAMICS, "first", {"friction": "3"})]
    after = with_attributes(path, edits).contents[path].decode("utf-16")
    assert after == text.replace('damping="1"', 'damping="2"').replace(
        "<!-- 手 -->\n", '<!-- 手 -->\n    <dynamics friction="3"/>\n'
    )


def test_included_files_are_edited_and_go_with_the_main_one(parted, tmp_path):
    out = tmp_path / "here/new.xml"
    edits = [Edit("joint", "shoulder", {"armature": "1"}), Edit("motor", "drive", {"gear": "2"})]
    edited = with_attributes(parted, edits)
    assert edited.write(out) == ()
    written = {
        path.relative_to(out.parent).as_posix(): path.read_text()
        for path in out.parent.rglob("*.xml")
    }
    expected = {**PARTS, "new.xml": PARTS["robot.xml"]}
    del expected["robot.xml"]
    expected["parts/upper.xml"] = expected["parts/upper.xml"].replace(
        "/>\n", ' armature="1"/>\n', 1
    )
    expected["parts/deep/motors.xml"] = expected["parts/deep/motors.xml"].replace(
        '"/>', '" gear="2"/>'
    )
    assert written == expected
    assert [change[:2] for change in edited.changes] == [
        (parted.parent / "parts/upper.xml", 2),
        (parted.parent / "parts/deep/motors.xml", 1),
    ]
    changed = differing(parted, out)
    assert changed - DERIVED == {"dof_armature", "actuator_gear"}
    assert {name: (parted.parent / name).read_text() for name in PARTS} == PARTS


def test_the_main_files_folder_goes_before_that_of_the_including_file(parted, tmp_path):
    other = '<x><actuator><motor name="other" joint="shoulder"/></actuator></x>'
    saved(parted.parent, other, "deep/motors.xml")
    out = tmp_path / "here/robot.xml"
    with_attributes(parted, [Edit("motor", "other", {"gear": "2"})]).write(out)
    assert differing(parted, out) - DERIVED == {"actuator_gear"}
    assert 'gear="2"' in (out.parent / "deep/motors.xml").read_text()


def test_beside_the_original_only_the_main_file_is_written(parted):
    out = parted.with_name("new.xml")
    files = sorted(parted.parent.rglob("*"))
    with_attributes(parted, []).write(out)
    assert sorted(parted.parent.rglob("*")) == sorted([*files, out])
    edited = with_attributes(parted, [Edit("joint", "shoulder", {"damping": "1"})])
    with pytest.raises(InputError, match=r"another folder: the included parts/upper\.xml changes"):
        edited.write(parted.with_name("newer.xml"))


def test_what_lies_outside_of_the_folder_is_found_from_the_new_one_or_refused(tmp_path):
    text = PARTS["robot.xml"].replace("parts/", "../parts/")
    path = saved(tmp_path / "robots/one", text)
    for name, content in PARTS.items():
        saved(tmp_path / "robots", content.replace("'deep", "'../parts/deep"), name)
    edited = with_attributes(path, [])
    edited.write(tmp_path / "robots/two/robot.xml")
    assert differing(path, tmp_path / "robots/two/robot.xml") == set()
    with pytest.raises(InputError, match=r"\.\./parts/classes\.xml is found"):
        edited.write(tmp_path / "elsewhere/two/robot.xml")
    edited = with_attributes(path, [Edit("joint", "shoulder", {"damping": "1"})])
    with pytest.raises(InputError, match=r"which changes, from its folder"):
        edited.write(tmp_path / "robots/three/robot.xml")
    assert not (tmp_path / "robots/three").exists()


def test_a_file_that_is_included_by_an_absolute_path_stays(tmp_path):
    joint = saved(tmp_path / "far", '<x><joint name="a"/><geom size=".1"/></x>', "joint.xml")
    text = f'<mujoco><worldbody><body><include file="{joint}"/></body></worldbody></mujoco>'
    path, out = saved(tmp_path / "near", text), tmp_path / "out/robot.xml"
    with_attributes(path, []).write(out)
    assert [file.name for file in out.parent.iterdir()] == ["robot.xml"]
    assert differing(path, out) == set()
    with pytest.raises(InputError, match="which changes, from its folder"):
        with_attributes(path, [Edit("joint", "a", {"damping": "1"})]).write(out, overwrite=True)


def test_nothing_of_the_original_and_no_other_file_is_written_over(parted, tmp_path):
    edited = with_attributes(parted, [])
    before = {path: path.read_bytes() for path in parted.parent.rglob("*.xml")}
    link = tmp_path / "hard.xml"
    link.hardlink_to(parted)
    for out in (*before, link):
        with pytest.raises(InputError, match="a file that is read here"):
            edited.write(out, overwrite=True)
    taken = saved(tmp_path, "taken", "taken.xml")
    with pytest.raises(InputError, match=r"taken\.xml: path: got an existing file;.*overwrite"):
        edited.write(taken)
    assert not (tmp_path / "parts").exists()
    edited.write(taken, overwrite=True)
    assert differing(parted, taken) == set()
    saved(tmp_path / "other", "taken", "parts/upper.xml")
    with pytest.raises(InputError, match=r"upper\.xml: path: got an existing file"):
        edited.write(tmp_path / "other/robot.xml")
    assert not (tmp_path / "other/robot.xml").exists()
    saved(tmp_path / "other", PARTS["parts/upper.xml"], "parts/upper.xml")
    edited.write(tmp_path / "other/robot.xml")
    assert differing(parted, tmp_path / "other/robot.xml") == set()
    with pytest.raises(InputError, match=r"expected \.xml$"):
        edited.write(tmp_path / "robot.urdf")
    assert before == {path: path.read_bytes() for path in before}


def test_the_main_file_does_not_take_the_name_of_one_that_it_includes(tmp_path):
    path = saved(tmp_path, '<mujoco><include file="b.xml"/></mujoco>')
    saved(tmp_path, "<x/>", "b.xml")
    with pytest.raises(InputError, match="the name of an included file"):
        with_attributes(path, []).write(tmp_path / "other/b.xml")


def test_meshes_that_are_not_found_from_the_new_folder_are_named(tmp_path):
    text = """<mujoco><compiler meshdir="meshes"/><asset><mesh name="a" file="a.obj"/>
      <mesh name="b" file="gone.obj"/></asset></mujoco>"""
    path = saved(tmp_path, text)
    saved(tmp_path, "v 0 0 0", "meshes/a.obj")
    edited = with_attributes(path, [])
    assert edited.write(tmp_path / "new.xml") == ()
    assert edited.write(tmp_path / "other/new.xml") == ("meshes/a.obj",)
    saved(tmp_path / "third", "v 0 0 0", "meshes/a.obj")
    assert edited.write(tmp_path / "third/new.xml") == ()


REPLICATED = """<mujoco><worldbody>
  <replicate count="2"><body name="b"><joint name="j"/><geom size=".1"/></body></replicate>
  <body><joint name="k"/><joint name="k"/></body>
</worldbody></mujoco>"""

ATTACHED = """<mujoco><asset><model name="m" file="arm.xml"/></asset>
<worldbody><attach model="m" prefix="left_"/></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("text", "tag", "name", "message"),
    [
        (ARM, "joint", "elbwo", r"joint: got elbwo; expected 'elbow' .*'shoulder', 'elbow'$"),
        (ARM, "motor", "shoulder", r"motor: got shoulder; expected one of 'elbow'$"),
        (ARM, "dcmotor", "a", r"expected dcmotors with a name; there are none$"),
        (ARM, DYNAMICS, "elbow", r"tag: got dynamics; expected joint or an actuator in MJCF$"),
        (REPLICATED, "joint", "k", r"got k 2 times \(robot\.xml line 3 and robot\.xml line 3\)"),
        (REPLICATED, "joint", "j", r"got j, which <replicate> of robot\.xml line 2 makes"),
        (REPLICATED, "joint", "j1", r"\(what <replicate> makes has no text of its own\)$"),
        (ATTACHED.replace('"arm.xml"', '""'), "joint", "j", r"none \(what <attach> makes has no"),
        (ATTACHED, "joint", "j", r"none \(<attach> takes more from arm\.xml: change it there\)$"),
        (URDF, "joint", "third", r"joint: got third; expected one of 'first', 'second'$"),
        (URDF, DYNAMICS, "t", r"joint: got t; expected one of 'first', 'second'$"),
        (URDF, "motor", "t", r"tag: got motor; expected joint or dynamics in URDF$"),
        ("<sdf/>", "joint", "a", r"content: got <sdf>; expected MJCF"),
        ('<robot><joint name="a"/></robot>', DYNAMICS, "a", "line 1: got <joint/>; expected a"),
    ],
)
def test_an_element_that_cannot_be_edited_is_refused(tmp_path, text, tag, name, message):
    path = saved(tmp_path, text)
    with pytest.raises(InputError, match=message):
        with_attributes(path, [Edit(tag, name, {"damping": "1"})])


def test_two_dynamics_of_a_joint_are_refused(tmp_path):
    path = saved(tmp_path, URDF.replace("</joint>\n  <tr", "<dynamics/></joint>\n  <tr"))
    with pytest.raises(InputError, match="dynamics: got second 2 times"):
        with_attributes(path, [Edit(DYNAMICS, "second", {"damping": "1"})])
