"""What a manifest says, and that whatever it may say is read back as it was written."""

import re
from pathlib import PurePath

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.identification.segments import driven
from butterfly.logs.health import DEFAULT_REPAIRS, Repair
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.logs.manifest import (
    LogEntry,
    Manifest,
    Recordings,
    checked_options,
    manifest_text,
    read_manifest,
    write_manifest,
)
from butterfly.logs.mat import write_mat
from butterfly.logs.reading import draft, read_entry
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Known
from butterfly.model.servo import ServoLoop
from butterfly.outputs import call

HOW = {"arm": 0.104, "input": InputKind.TORQUE, "intersample": Intersample.FIRST_ORDER_HOLD}


def test_the_commanded_sine_is_in_every_real_log(real_data):
    for log in real_data.logs:
        assert abs(log.input).max() == pytest.approx(log.excitation.amplitude, rel=2e-3)


@pytest.fixture
def drafted(tmp_path, sine_log):
    """A manifest of a log whose name says what was added, and how it was driven."""
    write_mat(sine_log, tmp_path / "Data_52__10__004.mat")
    return draft(tmp_path, HOW)


def test_a_sign_negates_the_input_and_is_written_where_it_is_not_usual(tmp_path, drafted):
    backwards = drafted.model_copy(update={"sign": -1})
    write_manifest(backwards, tmp_path / "manifest.yaml")
    assert read_manifest(tmp_path / "manifest.yaml").sign == -1
    logs = [read_entry(each, each.logs[0]) for each in (drafted, backwards)]
    assert np.array_equal(logs[0].input, -logs[1].input)
    assert np.array_equal(logs[0].angle, logs[1].angle)


def test_an_encoder_on_the_motor_is_read_by_the_joint_and_needs_the_ratio(tmp_path, drafted):
    (tmp_path / "manifest.yaml").write_text(
        manifest_text(drafted) + "encoder: motor\nknown: {gear_ratio: 5}\nzero: 0.5\n"
    )
    geared = read_manifest(tmp_path / "manifest.yaml")
    log = read_entry(geared, geared.logs[0])
    np.testing.assert_allclose(log.angle, read_entry(drafted, drafted.logs[0]).angle / 5)
    assert log.zero.value == pytest.approx(0.1)
    with pytest.raises(InputError, match="gear_ratio"):
        read_entry(drafted.model_copy(update={"encoder": "motor"}), drafted.logs[0])


def _read(path, text):
    """What a manifest says, which is the same when it is written and read again."""
    path.write_text(text)
    manifest = read_manifest(path)
    with call(overwrite=True):
        write_manifest(manifest, path)
    assert read_manifest(path) == manifest
    return manifest


@pytest.mark.parametrize("law", ["pid-torque", "cascade-torque", "speed-torque"])
def test_a_loop_on_the_motors_side_drives_as_it_does_seen_from_the_joint(law):
    time = np.arange(0.0, 1.0, 0.01)
    servo = ServoLoop.of({"law": law, "kp": 2, "ki": 3, "kd": 0.5, "speed_limit": 9})
    told = {"input_kind": InputKind.SETPOINT, "servo": servo, "velocity": 30 * np.cos(3 * time)}
    motor = Log(time, 12 * np.sin(3 * time), 10 * np.sin(3 * time), **told)
    np.testing.assert_allclose(driven(motor.at_joint(10)).input, driven(motor).input, atol=1e-9)


def test_units_make_the_projects_own_of_files_and_numbers(tmp_path, sine_log):
    write_mat(sine_log, tmp_path / "a.mat")
    entry = "{file: a.mat, added_mass: {value: 52, uncertainty: 1}, omega: 2, amplitude: 300}"
    units = "{time: ms, input: -mV, angle: counts/4096, mass: g, arm: mm, omega: Hz}"
    text = f"name: a\ninput: voltage\narm: 104\nunits: {units}\nlogs: [{entry}]\n"
    manifest = _read(tmp_path / "m.yaml", text)
    log = read_entry(manifest, manifest.logs[0])
    np.testing.assert_allclose(log.time, sine_log.time / 1000)
    np.testing.assert_allclose(log.input, -sine_log.input / 1000)
    np.testing.assert_allclose(log.angle, sine_log.angle * 2 * np.pi / 4096)
    mass = log.added_mass
    assert (mass.mass, mass.arm, mass.mass_uncertainty) == pytest.approx((0.052, 0.104, 0.001))
    assert log.excitation.omega == pytest.approx(4 * np.pi)
    assert log.excitation.amplitude == pytest.approx(0.3)


def test_the_own_inertia_of_an_added_mass_is_used_as_given_and_written_again(tmp_path):
    path = tmp_path / "m.yaml"
    logs = "[{file: a.csv, added_mass: 0.2, inertia: 1e-4}, {file: b.csv}]"
    manifest = _read(path, f"name: a\ninput: torque\narm: 0.1\nlogs: {logs}\n")
    disc, none = (manifest.added_mass(entry) for entry in manifest.logs)
    assert disc == AddedMass(mass=0.2, arm=0.1, own_inertia=1e-4)
    assert (disc.inertia, disc.gravity_moment) == pytest.approx((2.1e-3, 0.1962))
    assert none.inertia == 0
    assert path.read_text().count("inertia:") == 1
    path.write_text(path.read_text().replace("0.0001", "-0.0001"))
    with pytest.raises(InputError, match="inertia"):
        read_manifest(path)


def test_a_root_that_begins_with_a_variable_is_relative_to_where_the_command_runs(
    tmp_path, monkeypatch
):
    for folder in ("here/logs", "there/logs"):
        (tmp_path / folder).mkdir(parents=True)
    path = tmp_path / "there/m.yaml"
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("MY_LOGS", "logs")
    for root, expected in (("${MY_LOGS}", "here"), ("./${MY_LOGS}", "there"), ("logs", "there")):
        path.write_text(VALID.replace("name: a", f"name: a\nroot: {root}"))
        assert read_manifest(path).root == str(tmp_path / expected / "logs")


ZEROS = """\
name: a
input: torque
arm: 0.1
zero: {value: 0.1, uncertainty: 0.01}
zeros: [{added_mass: 0.05, zero: 0.2}]
logs:
  - {file: a.mat}
  - {file: b.mat, added_mass: 0.05}
  - {file: c.mat, added_mass: {value: 0.05, uncertainty: 0.001}, zero: 0.3}
"""


def test_zeros_are_told_for_the_set_a_mass_or_a_log(tmp_path):
    path = tmp_path / "m.yaml"
    manifest = _read(path, ZEROS)
    told = [manifest.zero_of(entry) for entry in manifest.logs]
    assert told == [Known(value=0.1, uncertainty=0.01), Known(value=0.2), Known(value=0.3)]
    other = manifest.with_zero(Known(value=0.7))
    assert {other.zero_of(entry) for entry in other.logs} == {Known(value=0.7)}
    path.write_text(ZEROS.replace("[{added_mass: 0.05,", "[{added_mass: 0.06,"))
    with pytest.raises(InputError, match=r"zeros of the logs' added masses: 0, 0\.05 kg"):
        read_manifest(path)


VALID = """\
name: a
input: torque
arm: 0.1
logs:
  - {file: a.mat, added_mass: 0.05, omega: 5, amplitude: 0.1}
"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("arm", "arn", "arn: got an unknown key; expected 'arm' (did you mean that?)"),
        ("omega", "omgea", "logs.0.omgea: got an unknown key; expected 'omega'"),
        ("0.05", "-0.05", "logs.0.added_mass: got -0.05; expected greater than or equal to 0"),
        ("omega: 5", "omega: fast", "logs.0.omega: got 'fast'"),
        (
            "torque",
            "force",
            "input: got 'force'; expected 'voltage', 'torque', 'current', 'duty', 'setpoint'",
        ),
        ("input: torque\n", "", "input: got nothing"),
        ("name: a\ninput: torque\n", "", "name, input: got nothing; expected a value (these keys"),
        ("name: a", "name: [a", "line 2: got expected"),
        ("arm: 0.1", "arm: 0.1\nunits: {angle: dge}", "units.angle: got dge; expected one of rad"),
        ("arm: 0.1", "arm: .nan", "arm: got nan; expected a finite number"),
        ("arm: 0.1", "arm: 0.1\nroot: ${NO_SUCH_VARIABLE}", "root: got ${NO_SUCH_VARIABLE}"),
        ("arm: 0.1", "arm: 0.1\nroot: nowhere", "root: got"),
        ("torque", "setpoint", "loop.law: got nothing; expected the servo's law for a setpoint"),
        ("arm", "loop: {law: pid}\narm", "loop.law: got pid; expected"),
        ("arm", "loop: {law: pid-duty, gain: 2}\narm", "loop.gain: got an unknown name"),
        ("omega", "loop: 3, omega", "logs.0.loop: got 3; expected"),
        ("omega", "frm: 1, omega", "logs.0.frm: got an unknown key; expected 'from'"),
        ("omega", "from: x, omega", "logs.0.from: got 'x'; expected a valid number"),
        ("omega", "units: {angle: dge}, omega", "logs.0.units.angle: got dge; expected one of rad"),
        ("arm", "interval: 0\narm", "interval: got 0; expected greater than 0"),
        (VALID, "just text", "content: got str; expected a mapping"),
    ],
)
def test_a_slip_in_a_manifest_is_named_with_file_field_and_value(tmp_path, old, new, message):
    path = tmp_path / "m.yaml"
    path.write_text(VALID.replace(old, new, 1))
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        read_manifest(path)
    assert str(path) in str(caught.value)


TEXTS = st.text("ab0 :#-.,?!|>&*%@`~'\"\\[]{}<=é€😀\n\t\r\0\x7f\x85\u2028\ufeff\ufffe", max_size=12)
PLAIN = TEXTS.filter(
    lambda text: not PurePath(text).is_absolute() and ".." not in text and "\0" not in text
)
SIZES = st.floats(0, 1e3)
TOLD = st.floats(-1e3, 1e3) | st.fixed_dictionaries(
    {"value": st.floats(-1e3, 1e3), "uncertainty": st.floats(1e-9, 10)}
)
ENTRIES = st.builds(
    LogEntry,
    file=PLAIN,
    added_mass=SIZES,
    arm=st.none() | SIZES,
    zero=st.none() | TOLD,
    begin=st.none() | st.floats(0, 5),
    end=st.none() | st.floats(6, 9),
    part=st.none() | st.integers(1, 9),
    loop=st.none() | st.just({"kp": 4.0}),
    at=st.none() | TEXTS,
    columns=st.none() | st.just({"time": 0, "angle": "q"}),
    units=st.none() | st.just({"time": "ms"}),
    interval=st.none() | st.floats(1e-6, 9),
)
MANIFESTS = st.builds(
    Manifest,
    name=TEXTS,
    description=TEXTS,
    root=PLAIN.filter(lambda text: "$" not in text),
    input=st.sampled_from(InputKind),
    loop=st.just({"law": "pid-duty", "kp": 2.0}),
    intersample=st.sampled_from(Intersample),
    sign=st.sampled_from([1, -1]),
    arm=SIZES,
    known=st.dictionaries(st.sampled_from(["p1", "p4", "resistance"]), st.floats(0.1, 1e3)),
    zero=st.none() | TOLD,
    units=st.fixed_dictionaries({}, optional={"time": st.just("ms"), "angle": st.floats(0.1, 9)}),
    columns=st.none()
    | st.fixed_dictionaries({"time": TEXTS, "input": st.integers(0, 9), "angle": TEXTS}),
    repair=st.sets(st.sampled_from(Repair)).map(DEFAULT_REPAIRS.union),
    split=st.none() | st.sampled_from(Recordings),
    holdout=st.lists(TEXTS, max_size=2),
    logs=st.lists(ENTRIES, min_size=1, max_size=3),
)


@settings(max_examples=30)
@given(manifest=MANIFESTS)
def test_any_manifest_is_read_back_as_it_was(tmp_path_factory, manifest):
    path = tmp_path_factory.getbasetemp() / "manifest.yaml"
    with call(overwrite=True):
        write_manifest(manifest, path)
    read = read_manifest(path, path.parent).model_copy(update={"root": manifest.root})
    assert read == manifest
    assert manifest_text(read) == manifest_text(manifest)


@pytest.mark.parametrize("field", ["root", "file"])
@pytest.mark.parametrize("name", [r"a\0b", "x" * 5000])
def test_a_path_that_no_file_can_have_is_refused_with_its_field(tmp_path, field, name):
    root, file = (name, "a.csv") if field == "root" else (".", name)
    path = tmp_path / "bench.yaml"
    path.write_text(f'name: a\ninput: voltage\nroot: "{root}"\nlogs: [{{file: "{file}"}}]\n')
    with pytest.raises(InputError, match=rf"bench\.yaml.*{field}: got .*; expected a path"):
        read_manifest(path)


def test_a_loop_is_that_of_the_option_the_data_set_and_the_log(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(VALID.replace("torque", "setpoint") + "  - {file: b.mat, loop: {kp: 5}}\n")
    options = checked_options({"loop": {"law": "dynamixel-x", "kp": "400", "limit": "0.9"}})
    manifest = read_manifest(path, given=options)
    first, second = (manifest.properties(entry)["servo"] for entry in manifest.logs)
    assert (first.law, first.kp.value, first.limit) == ("dynamixel-x", 400.0, 0.9)
    assert (second.kp.value, second.limit) == (5.0, 0.9)
    path.write_text(VALID.replace("torque", "setpoint\nloop: {law: odrive}"))
    told = read_manifest(path, given=checked_options({"loop": {"kp": "3"}}))
    with pytest.raises(InputError, match=r"a\.mat: loop\.kd: got nothing; expected a gain"):
        told.properties(told.logs[0])


def test_numbers_of_a_loop_that_an_option_gives_are_written_as_numbers():
    loop = {"law": "dynamixel-x", "kp": "400+-40", "supply": "7.4"}
    given = checked_options({"loop": loop})["loop"]
    assert given == {
        "law": "dynamixel-x",
        "kp": {"value": 400.0, "uncertainty": 40.0},
        "supply": 7.4,
    }
    with pytest.raises(InputError, match=r"supply: got full; expected a number"):
        checked_options({"loop": {"supply": "full"}})
