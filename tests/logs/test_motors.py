"""Motors that others measured: what a file must say, and that its values hold in another joint."""

import math
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import butterfly as bf
from butterfly.cli.app import program
from butterfly.errors import InputError
from butterfly.files import shipped
from butterfly.identification.data import DataSet
from butterfly.identification.trust import FindingKind
from butterfly.logs.log import Log
from butterfly.logs.manifest import Manifest
from butterfly.logs.motors import (
    FOLDER,
    MotorType,
    MotorValue,
    SharedValue,
    assumed_scatter,
    motor_names,
    motor_of,
    with_motor,
)
from butterfly.model.prior import Known, Prior
from butterfly.model.terms import TERMS, TORQUES
from butterfly.yaml_files import load_yaml, validate, yaml_text
from tests.independent.integrator import Joint, motion

NAMES = motor_names()
STEP = 5e-3
TIME = np.arange(0, 8.0, STEP)
TONES = ((1.3, 4.1, 9.0), (2.2, 3.1, 12.0), (0.9, 5.3, 7.1), (1.9, 6.7, 2.7))
NOISE = 3e-4
"""Step in s, frequencies of the inputs in rad/s, and noise in rad of a joint with such a motor."""


def content_of(name):
    return load_yaml(shipped(f"{FOLDER}/{name}.yaml")).content


def test_there_are_motors_and_each_has_a_plain_name():
    assert {"ak80-6", "xl330"} <= {*NAMES}
    assert all(re.fullmatch(r"[a-z0-9][a-z0-9-]*", name) for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_motor_s_manifest_and_command_are_such_as_the_program_reads(name):
    for made in (motor.made for motor in motor_of(name).motors):
        manifest = Manifest.model_validate(made.manifest)
        assert manifest.root == "."
        assert not [path for path in map(str, made.manifest.values()) if str(Path.home()) in path]
        tokens = shlex.split(made.command)[1:]
        command, bound, _ = program(tokens).parse_args(tokens)
        assert command.__name__ == "identify"
        assert str(bound.arguments["data"]) == "manifest.yaml"


@pytest.mark.parametrize("name", NAMES)
def test_whatever_scales_with_torque_says_no_more_of_the_scale_than_the_gain(name):
    motor = motor_of(name)
    shares = {k: v.known().uncertainty / abs(v.value) for k, v in motor.known.items()}
    scale = [share for name, share in shares.items() if name in TORQUES]
    together = 1 / math.sqrt(sum(share**-2 for share in scale)) if scale else math.inf
    assert together > 0.75 * min(scale, default=0.0)


def of_type(motor, rng):
    """The true values of another motor of the type, as far from the file's as motors differ."""
    return {
        name: shared.value + shared.known().uncertainty * float(rng.uniform(-1, 1))
        for name, shared in motor.known.items()
    }


def recorded(motor, true, seed=0):
    """Logs of a joint with a motor of true values, and a load of its own."""
    rng, logs = np.random.default_rng(seed), []
    gain, squeeze = true.get("p4", 1.0), true.get("compression", 0.0)
    friction = true.get("coulomb", 0.0)
    most = 6.0 if motor.drive == "voltage" else 12 * friction
    reach = gain * most / (1 + squeeze * most)
    true |= {"p1": 0.4 * reach / 25, "p3": 0.4 * reach}
    emf = true.get("back_emf", 0.0)
    true["p2"] = max(true.get("p2", 0.0), emf)  # of which it is a part
    joint = Joint(
        inertia=true["p1"],
        viscous=true["p2"] - emf,
        gravity=true["p3"],
        gain=gain,
        coulomb=friction,
        back_emf=emf,
        motor_friction=true.get("motor_friction", 0.0),
        load_friction=true.get("load_friction", 0.0),
    )
    for tones in TONES:
        phases = rng.uniform(0, 2 * np.pi, len(tones))
        pairs = zip(tones, phases, strict=True)
        inputs = most / 2 * sum(np.sin(tone * TIME + phase) for tone, phase in pairs)
        angle, _ = motion(joint, TIME, inputs / (1 + squeeze * abs(inputs)))
        angle = angle + NOISE * rng.standard_normal(TIME.size)
        about = {"input_kind": motor.drive, "intersample": "zero_order_hold", "zero": 0.0}
        logs.append(Log(TIME, inputs, angle, **about))
    return logs


def knowing(name, motor):
    """What an owner of such a motor says of the joint."""
    return {"from": name} | ({} if "p4" in motor.known else {"p4": 1})


@pytest.mark.parametrize("name", NAMES)
def test_another_motor_of_the_type_with_another_load_is_identified_truly(name):
    motor = motor_of(name)
    true = of_type(motor, np.random.default_rng([*map(ord, name)]))
    found = bf.identify(bf.read(recorded(motor, true), known=knowing(name, motor)))
    estimate = found.estimate
    for k, row in enumerate(estimate.names):
        if row in true:
            assert estimate.lower[k] <= true[row] <= estimate.upper[k], row
    (line,) = (text for text in found.summary if text.startswith("Known from "))
    assert line.startswith(f"Known from {name} ({motor.verdict}, {motor.count} measured): ")
    assert FindingKind.MOTOR_CONFLICT not in {each.kind for each in estimate.findings}


def test_logs_that_contradict_a_motor_s_value_say_whose_it_is():
    motor = motor_of("ak80-6")
    logs = recorded(motor, {"coulomb": 4 * motor.known["coulomb"].value})
    found = bf.identify(bf.read(logs, known=knowing("ak80-6", motor)), terms=())
    finding = next(
        each for each in found.estimate.findings if each.kind is FindingKind.MOTOR_CONFLICT
    )
    assert finding.parameters == ("coulomb", "ak80-6")
    assert "contradict the coulomb of ak80-6 by" in " ".join(found.summary)
    assert found.standing != "good"


def shared(*values, half=0.0, assumed=0.12):
    ends = ((x, x - half, x + half) for x in values)
    motors = (MotorValue(value=x, lower=low, upper=up, unit="N m") for x, low, up in ends)
    return SharedValue(tuple(motors), assumed)


def test_one_motor_s_uncertainty_is_that_of_the_measurement_and_of_two_motors_that_differ():
    value = shared(2.0, half=1.96 * 0.3)
    assert value.known("x").origin == "x"
    assert value.known().uncertainty == pytest.approx(math.hypot(0.3, 2**0.5 * 0.24), rel=0.03)


def test_the_value_of_several_motors_is_their_mean_and_their_scatter_is_pooled():
    value = shared(1.0, 1.2, 1.1, 1.5, half=0.2)
    spread = np.std([1.0, 1.2, 1.1, 1.5], ddof=1) / 1.2
    assert value.value == pytest.approx(1.2)
    assert value.scatter == pytest.approx(math.sqrt((4 * 0.12**2 + 3 * spread**2) / 7))
    assert shared(1.0, 1.0).scatter < shared(1.0).scatter == pytest.approx(0.12)


def test_the_uncertainty_holds_for_another_motor_of_a_type_whose_scatter_is_the_assumed_one():
    rng, inside = np.random.default_rng(2), []
    for _ in range(2000):
        *true, other = 5 * (1 + 0.12 * rng.standard_normal(4))
        measured = true + 0.4 * rng.standard_normal(3)
        known = shared(*measured, half=1.96 * 0.4).known()
        inside.append(abs(other - known.value) < 1.96 * known.uncertainty)
    assert 0.94 < np.mean(inside) < 0.98


def test_friction_differs_more_between_motors_than_the_gain():
    scatter = {name: assumed_scatter(name) for name, row in TERMS.items() if row.of_motor}
    assert scatter["p4"] < scatter["coulomb"] < scatter["p2"]
    assert all(share >= scatter["p4"] for share in scatter.values())


def test_a_type_knows_what_is_known_of_each_of_its_motors(tmp_path):
    content = content_of("xl330")
    other = content_of("xl330")["motors"][0]
    other["known"] = {"p4": other["known"]["p4"] | {"value": 0.13}}
    path = tmp_path / "mine.yaml"
    path.write_text(yaml_text(content | {"motors": [*content["motors"], other]}))
    motor = motor_of(str(path))
    assert [*motor.known] == ["p4"]
    assert motor.known["p4"].value == pytest.approx((0.1216 + 0.13) / 2)
    assert (motor.count, motor.verdict) == ("2 motors", "use with care")


def test_own_values_take_precedence_over_a_motor_s():
    known = with_motor({"from": "xl330", "p4": 0.1})
    assert known["p4"] == 0.1
    assert known["p2"].origin == "xl330"
    manifest = {"name": "a", "input": "voltage", "logs": [{"file": "a.csv"}], "known": known}
    again = Manifest.model_validate(Manifest.model_validate(manifest).model_dump(mode="json"))
    assert again.known["p4"] == 0.1
    assert again.known["p2"] == known["p2"]
    assert with_motor({"p4": 1}) == {"p4": 1}


@pytest.mark.parametrize("way", ["name", "file"])
def test_a_motor_is_named_in_a_manifest_or_its_file_is(tmp_path, way):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml_text(content_of("ak80-6")))
    whose = str(path) if way == "file" else "ak80-6"
    head = {"name": "a", "input": "torque", "logs": [{"file": "a.csv"}]}
    manifest = Manifest.model_validate(head | {"known": {"from": whose, "p4": 1}})
    assert Prior.of(manifest.known).values["coulomb"] == Known(
        value=0.2049, uncertainty=0.083, origin=whose
    )


@pytest.mark.parametrize(
    ("whose", "message"),
    [
        ("xl30", r"known: from: got xl30; expected 'xl330' \(did you mean that\?\)"),
        ("nothing.yaml", "known: from: got nothing.yaml: path: no such file"),
        (7, "known: from: got 7; expected the name of a motor: ak80-6, "),
    ],
)
def test_a_motor_that_nobody_measured_is_one_line(whose, message):
    with pytest.raises(InputError, match=message):
        with_motor({"from": whose})


def test_a_damaged_file_of_a_motor_is_named_with_its_field(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml_text(changed(content_of("xl330"), "drive", "steam")))
    head = {"name": "a", "input": "torque", "logs": [{"file": "a.csv"}]}
    with pytest.raises(InputError, match=r"known.from: got .*mine.yaml: drive: 'steam'; expected"):
        validate([], head | {"known": {"from": str(path)}}, Manifest)


def test_a_motor_s_values_are_refused_for_another_drive_and_for_a_slide():
    logs = recorded(motor_of("ak80-6"), {"coulomb": 0.2})[:1]
    with pytest.raises(
        InputError, match=r"from: got xl330 with input: torque; expected .* voltage"
    ):
        bf.read(logs, known={"from": "xl330"})
    slide = {"time": TIME, "input": 0 * TIME, "angle": np.sin(TIME)}
    with pytest.raises(InputError, match="from: got ak80-6 of a slide; expected a hinge"):
        bf.read(slide, joint="slide", input="torque", known={"from": "ak80-6", "p4": 1})
    told = {"coulomb": {"value": 0.2, "uncertainty": 0.1, "from": "a motor that is not here"}}
    assert DataSet.of(logs, known=Prior.of(told)).known.values["coulomb"].uncertainty == 0.1


P4 = {"value": 0.1, "lower": 0.08, "upper": 0.12, "unit": "N m/V"}
P2 = P4 | {"unit": "N m s/rad"}
OHM = P4 | {"unit": "Ohm"}
NEGATIVE = {"value": -0.1, "lower": -0.12, "upper": -0.08, "unit": "N m/V"}


@pytest.mark.parametrize(
    ("known", "message"),
    [({"p2": P2}, "motors: got no such value; expected"), ({"p4": NEGATIVE}, "p4: got two signs")],
)
def test_motors_that_share_nothing_are_no_type(known, message):
    content = content_of("xl330")
    other = content["motors"][0] | {"known": known}
    content["motors"] = [content["motors"][0] | {"known": {"p4": P4}}, other]
    with pytest.raises(InputError, match=message):
        validate([], content, MotorType)


def changed(content, place, value):
    *above, last = (int(key) if key.isdecimal() else key for key in place.split("."))
    node = content
    for key in above:
        node = node[key]
    node[last] = value
    return content


ONE = "motors.0"


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (f"{ONE}.known.p4.unit", "N m/A", "0.known.p4.unit: got N m/A; expected N m/V"),
        (f"{ONE}.known.p4.lower", 0.2, "known.p4: got .*expected lower, value and upper in this"),
        (f"{ONE}.known.p4.lower", -0.1, "p4: got 0.1216; expected an interval without 0"),
        (f"{ONE}.known.p4.scatter", 0.1, "known.p4.scatter: got an unknown key"),
        (f"{ONE}.known.p1", P4, "known: got p1; expected one of 'p2', 'p4', 'coulomb'"),
        (f"{ONE}.known.p44", P4, "known: got p44; expected 'p4'"),
        (f"{ONE}.rig.resistance", OHM, "rig: got resistance; expected one of 'p1'"),
        ("law", "dynamixel-xl3300", "law: got dynamixel-xl3300; expected 'dynamixel-xl330'"),
        (f"{ONE}.source.commit", "af22604", "commit: got 'af22604'; expected the 40 hexadecimal"),
        (f"{ONE}.source.licence", "GPL-3.0", "licence: got 'GPL-3.0'; expected 'Apache-2.0'"),
        (f"{ONE}.source.repository", "", "source.repository: got ''; expected an address"),
        (f"{ONE}.made.command", "make it", "command: got 'make it'; expected butterfly identify"),
        (f"{ONE}.verdict", "do not use", "verdict: got 'do not use'; expected 'good' or 'use with"),
        ("name", " ", "name: got ' '; expected a text that is not empty"),
        (f"{ONE}.conditions", {}, "conditions: got {}"),
        (f"{ONE}.conditions.supply", "", "conditions.supply: got ''; expected a text"),
        ("motors", [], "motors: got \\[\\]"),
        ("colour", "red", "colour: got an unknown key"),
    ],
)
def test_a_file_that_says_too_little_or_too_much_is_one_line(tmp_path, place, value, message):
    path = tmp_path / "motor.yaml"
    path.write_text(yaml_text(changed(content_of("xl330"), place, value)))
    document = load_yaml(path)
    with pytest.raises(InputError, match=message) as error:
        validate([document], document.content, MotorType)
    assert str(path) in str(error.value)
