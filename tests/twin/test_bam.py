"""A servo as BAM's JSON: its friction is ours, and BAM's own code moves it as we do."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.identification.segments import driven
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import Known, Prior
from butterfly.model.servo import ServoLoop
from butterfly.model.terms import DRY, FrictionTerms, torque_of
from butterfly.twin.bam import as_bam
from butterfly.twin.forms import Options
from butterfly.twin.twin import Twin

JOINT = LumpedParameters(p1=0.004, p2=0.1, p3=0, p4=0.15, coulomb=0.02, back_emf=0.09)
STRIBECK = {"stribeck": 0.03, "stribeck_velocity": 0.4}
EQUAL = {"motor_friction": 0.2, "load_friction": 0.2}
OTHER = {"motor_friction": 0.25, "load_friction": 0.1, "load_stribeck": 0.07}
MODELS = {
    "m1": {},
    "m2": STRIBECK,
    "m3": EQUAL,
    "m4": STRIBECK | EQUAL | {"motor_stribeck": 0.1, "load_stribeck": 0.1},
    "m5": OTHER,
    "m6": STRIBECK | OTHER | {"lifting_stribeck": 0.3, "lowering_stribeck": 0.2},
}
SERVO = ServoLoop.of({"law": "dynamixel-xl330", "kp": 400, "supply": 7.4})
CARRIED = AddedMass(mass=0.4, arm=0.1, gravity=9.80665)


def _friction(given, motor, load, velocity):
    """(N m at this velocity) of what a file says, by the formulas of BAM's paper."""
    get = {"load_friction_base": 0.0, "friction_stribeck": 0.0, "alpha": 1.0} | given

    def carried(kind):
        alone = get.get(f"load_friction_{kind or 'base'}", 0.0)
        ends = [get.get(f"load_friction_{side}{kind and '_' + kind}") for side in _SIDES]
        if ends[0] is None:
            return alone * abs(load - motor)
        return abs(ends[0] * load - ends[1] * motor)

    excess = get["friction_stribeck"] + carried("stribeck")
    if given["model"] == "m6" and motor * load < 0:
        larger = "external" if abs(load) < abs(motor) else "motor"
        excess += get[f"load_friction_{larger}_quad"] * min(motor**2, load**2)
    at_rest = math.exp(-(abs(velocity / get.get("dtheta_stribeck", 1.0)) ** get["alpha"]))
    return get["friction_base"] + carried("") + at_rest * excess


_SIDES = ("external", "motor")


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("by", ["formulas", "BAM"])
def test_the_least_model_that_holds_it_has_the_same_friction(model, by, bam):
    joint = replace(JOINT, **MODELS[model])
    told = _told(joint)
    assert (told["model"], told["actuator"]) == (model, "xl330")
    theirs = (lambda *at: _friction(told, *at)) if by == "formulas" else bam(told).compute_frictions
    for motor, load, velocity in np.random.default_rng(0).uniform(-1, 1, (50, 3)):
        way = np.sign(motor + load)  # else motion may be against the larger torque
        motion = FrictionTerms.motion(joint, 0.0, velocity, motor=motor, load=load)
        ours = way * torque_of(joint, motion._replace(direction=way), DRY)
        assert np.ravel(theirs(motor, load, velocity))[0] == pytest.approx(ours, rel=1e-12)


@pytest.fixture
def bam(request):
    """What loads a file's content as BAM's own code does."""
    if request.node.callspec.params.get("by", "BAM") == "formulas":
        return None
    reason = "BAM is not installed (pip install better-actuator-models)"
    return pytest.importorskip("bam.model", reason=reason).load_model_from_dict


@pytest.mark.parametrize("model", ["m2", "m6"])
def test_bam_s_own_code_moves_it_in_its_loop_as_we_do(model, bam):
    joint = replace(JOINT, **MODELS[model])
    time = np.arange(0.0, 3.0, 1e-3)
    goal = 0.9 * np.sin(2 * time + time**2)
    enabled = np.where((time > 1.5) & (time < 1.8), 0.0, 1.0)
    how = {"input_kind": "setpoint", "servo": SERVO, "enabled": enabled, "added_mass": CARRIED}
    log = Log(time, input=goal, angle=0 * time, **how)
    ours = Simulation(driven(log), joint).run(joint, 0.0).at(time)
    entries = [
        {"goal_position": g, "position": 0.0, "torque_enable": bool(e)}
        for g, e in zip(goal, enabled, strict=True)
    ]
    their_log = {"mass": 0.4, "arm_mass": 0.0, "length": 0.1, "kp": 400, "vin": 7.4, "dt": 1e-3}
    simulator = pytest.importorskip("bam.simulate").Simulator(bam(_told(joint)))
    theirs, *_ = simulator.rollout_log(their_log | {"entries": entries}, simulate_control=True)
    assert np.ptp(ours) > 0.5
    np.testing.assert_allclose(theirs, ours, atol=0.01)


def _told(joint=JOINT, actuator=None, **more):
    twin = Twin(parameters=joint, **{"servo": SERVO} | more)
    return json.loads(as_bam(twin, Options(actuator=actuator)).text)


@pytest.mark.parametrize(
    ("known", "constant"),
    [
        ({"resistance": 4.0}, 0.15 * 4.0),
        ({"torque_constant": 0.005, "gear_ratio": 100.0}, 0.5),
        ({"back_emf_constant": 0.004, "gear_ratio": 100.0}, 0.4),
        ({}, 0.1 / 0.15),
        ({"resistance": 40.0}, 0.1 / 0.15),  # which would give even more back EMF than p2
    ],
)
def test_constant_and_resistance_are_those_known_and_move_it_alike(known, constant):
    content = _told(replace(JOINT, back_emf=0.0), known=Prior.of(known))
    assert content["kt"] == pytest.approx(constant)
    assert content["kt"] / content["R"] == pytest.approx(JOINT.p4)
    damping = content["kt"] ** 2 / content["R"] + content["friction_viscous"]
    assert damping == pytest.approx(JOINT.p2)
    assert content["friction_viscous"] >= 0
    assert ("all of p2 taken" in content["notes"][0]) == (constant == 0.1 / 0.15)
    assert ("would give even more" in content["notes"][0]) == (known == {"resistance": 40.0})


def test_what_bam_has_no_place_for_is_said_in_the_file():
    joint = replace(JOINT, **MODELS["m6"], compression=0.1, delay=0.004, p3=0.2, loop_kp=0.5)
    servo = replace(SERVO, ki=Known(value=300.0), dead_band=0.01)
    notes = " ".join(_told(joint, servo=servo, added=replace(CARRIED, gravity=1.6))["notes"])
    missing = ("compression 0.1 1/V", "delay 0.004 s", "p3 = 0.2 N m", "ki 300", "dead_band 0.01")
    for each in (*missing, "1.6", "multiply kp"):
        assert each in notes
    other = _told(joint, servo=ServoLoop.of({"law": "dynamixel-x", "kp": 1}), actuator="mx64")
    assert "here the law is dynamixel-x" in " ".join(other["notes"])


def test_a_feetech_has_its_gain_and_its_slower_goal():
    servo = ServoLoop.of({"law": "feetech-sts", "kp": 16, "speed_limit": 5.0})
    content = _told(replace(JOINT, loop_kp=0.5), servo=servo)
    assert content["actuator"] == "sts3215"
    assert (content["error_gain_ratio"], content["max_velocity"]) == (0.5, 5.0)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"kind": InputKind.DUTY}, "input: got duty"),
        ({"servo": None}, "--actuator: got missing; expected BAM's name of the servo: xl330"),
        ({"actuator": "xl33"}, "--actuator: got xl33"),
        ({"ratios": True}, "parameters: got ratios"),
        ({"known": Prior.of({"p4": 1})}, "parameters: got relative to p4 = 1"),
        ({"joint": replace(JOINT, p2=0.0, back_emf=0.0)}, "p2: got 0.0"),
    ],
)
def test_what_bam_cannot_hold_at_all_is_refused(more, said):
    with pytest.raises(InputError) as refused:
        _told(**more)
    assert said in str(refused.value)
