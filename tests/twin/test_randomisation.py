"""Ranges are written as YAML that anybody reads, and as events that mjlab and Isaac Lab take."""

import json
import sys
from dataclasses import replace
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import yaml

from butterfly.logs.log import InputKind
from butterfly.model.servo import ServoLoop
from butterfly.twin.forms import Options, write_as
from butterfly.twin.randomisation import Range, about_ranges, ranges_of
from butterfly.twin.stand_alone import inertial
from tests.twin.in_mjlab import needs_mjlab, said_by_mjlab
from tests.twin.moving import STEP, twin
from tests.twin.units import estimated, unit_of_product

PYTHON = Options(timestep=STEP, ending=".py")


def _driven():
    """A joint in the loop of a servo, with dry friction."""
    loop = ServoLoop.of({"law": "pid-torque", "kp": 3.0, "kd": 0.2, "limit": 5.0})
    joint = twin("sticking", kind=InputKind.TORQUE, servo=loop)
    delayed = replace(joint, parameters=replace(joint.parameters, delay=0.004))
    halves = {"p1": 3e-4, "p2": 2e-4, "coulomb": 5e-4, "p4": 4e-3, "delay": 0.002}
    return estimated(delayed, **halves)


def _made(text, monkeypatch):
    """What a module has, whose frameworks are stood in for by their own names."""

    def selected(entity, **some):
        return entity, some

    class Functions(ModuleType):
        def __getattr__(self, name):
            return name

    stand_ins = {
        "mjlab.envs.mdp": {"dr": Functions("dr")},
        "mjlab.managers.event_manager": {"EventTermCfg": SimpleNamespace},
        "mjlab.managers.scene_entity_config": {"SceneEntityCfg": selected},
        "isaaclab.envs": {"mdp": Functions("mdp")},
        "isaaclab.managers": {"EventTermCfg": SimpleNamespace, "SceneEntityCfg": selected},
    }
    for path, names in stand_ins.items():
        module = ModuleType(path)
        vars(module).update(names)
        for parent in ("mjlab", "mjlab.envs", "mjlab.managers", "isaaclab"):
            monkeypatch.setitem(sys.modules, parent, sys.modules.get(parent, ModuleType(parent)))
        monkeypatch.setitem(sys.modules, path, module)
    found = {}
    exec(compile(text, "ranges.py", "exec"), found)  # noqa: S102 - our own
    return found


def test_yaml_has_each_range_and_what_it_is():
    told = yaml.safe_load(write_as("randomisation", unit_of_product()).text)
    damping = next(row for row in told["ranges"] if row["attribute"] == "damping")
    assert (damping["value"], damping["lower"], damping["upper"]) == (0.002, 0.0019, 0.0021)
    assert (told["units"], "deviation" in damping) == (1, False)
    assert "95 % intervals of one unit" in " ".join(told["notes"])
    assert "mjlab/bin/pip install mjlab" in told["notes"][-1]


def test_of_several_units_it_has_their_scatter_and_says_how_many():
    units = [unit_of_product(p2=2e-3 + 1e-4 * number) for number in range(3)]
    written = write_as("randomisation", units[0], Options(units=tuple(units[1:])))
    told = yaml.safe_load(written.text)
    damping = next(row for row in told["ranges"] if row["attribute"] == "damping")
    assert told["units"] == 3
    assert damping["deviation"] == pytest.approx(1e-4)
    assert damping["upper"] == pytest.approx(2.1e-3 + 9.99e-4, rel=1e-3)
    assert "mean of 3 units ± 9.99 standard deviations (of 10 units 3.38)" in written.left_out[0]
    assert written.about.endswith(" and 2 more")


def test_events_draw_from_the_ranges(monkeypatch):
    made = _made(write_as("randomisation", _driven(), PYTHON).text, monkeypatch)
    assert made["RANGES"]["damping"] == (0.0018, 0.0022)
    events = made["mjlab_events"]("arm", group=2)
    assert {name: event.func for name, event in events.items()} == {
        "hinge_inertia_about_axis": "joint_armature",
        "hinge_damping": "joint_damping",
        "hinge_frictionloss": "joint_friction",
        "hinge_gains": "pd_gains",
    }
    armature = events["hinge_inertia_about_axis"].params
    assert armature["asset_cfg"] == ("arm", {"joint_names": ("hinge",)})
    assert (armature["ranges"], armature["operation"]) == ((-0.0003, 0.0003), "add")
    friction = events["hinge_frictionloss"].params
    assert (friction["ranges"], friction["operation"]) == ((0.0015, 0.0025), "abs")
    gains = events["hinge_gains"].params
    assert gains["asset_cfg"] == ("arm", {"actuator_ids": [2]})
    assert (gains["kp_range"], gains["kd_range"], gains["operation"]) == (
        (0.9, 1.1),
        (0.9, 1.1),
        "scale",
    )
    assert {event.mode for event in events.values()} == {"startup"}


def test_isaac_lab_scales_friction_and_gains(monkeypatch):
    """An absolute range of its friction would be that of viscous friction too."""
    events = _made(write_as("randomisation", _driven(), PYTHON).text, monkeypatch)
    friction, gains, armature = (
        events["isaac_lab_events"]()[f"hinge_{name}"]
        for name in ("frictionloss", "gains", "inertia_about_axis")
    )
    assert friction.func == armature.func == "randomize_joint_parameters"
    assert friction.params["friction_distribution_params"] == (0.75, 1.25)
    assert friction.params["operation"] == "scale"
    assert armature.params["armature_distribution_params"] == (-0.0003, 0.0003)
    assert gains.func == "randomize_actuator_gains"
    assert gains.params["stiffness_distribution_params"] == (0.9, 1.1)


def test_the_delay_is_in_steps_of_the_simulator(monkeypatch):
    made = _made(write_as("randomisation", _driven(), PYTHON).text, monkeypatch)
    assert made["OF_MJLAB_ACTUATOR"] == {"delay_min_lag": 1, "delay_max_lag": 3}
    assert made["OF_ISAAC_LAB_ACTUATOR"] == {"min_delay": 1, "max_delay": 3}


def test_what_has_no_range_or_event_is_said():
    said = " ".join(write_as("randomisation", _driven()).left_out)
    assert "Neither mjlab nor Isaac Lab has an event for gain, effort." in said
    assert "Isaac Lab has no event for damping alone" in said
    assert "Not included in the ranges: stribeck 0.002 N m" in said
    unknown = write_as("randomisation", estimated(twin(), p3=np.inf))
    assert "No interval is known for gravity_moment." in unknown.left_out
    exact = write_as("randomisation", twin())
    assert "These values are exact" in exact.left_out[0]


def test_what_only_some_units_have_is_said():
    units = unit_of_product(), unit_of_product(p2=3e-3, delay=0.004)
    written = write_as("randomisation", units[0], Options(units=units[1:]))
    assert "Not all units have delay." in written.left_out


def test_a_loop_of_velocity_has_an_event_of_isaac_lab_alone(monkeypatch):
    loop = ServoLoop.of({"law": "speed-torque", "kp": 3.0})
    joint = estimated(twin(kind=InputKind.TORQUE, servo=loop), p4=4e-3)
    written = write_as("randomisation", joint, PYTHON)
    made = _made(written.text, monkeypatch)
    gains = made["isaac_lab_events"]()["hinge_gains"].params
    assert gains["stiffness_distribution_params"] == (1.0, 1.0)
    assert gains["damping_distribution_params"] == (0.9, 1.1)
    assert made["mjlab_events"]() == {}
    assert "mjlab has no event for kv alone." in written.left_out


def test_an_armature_below_0_is_said():
    row = replace(ranges_of((twin(),))[2].row, attribute="armature", value=-0.01, now=0.0)
    spans = [Range(row=row, half_width=1e-3)]
    assert any("Below 0" in said and "armature" in said for said in about_ranges((twin(),), spans))


def test_a_name_ends_no_comment(monkeypatch):
    joint = replace(_driven(), name='a\n"""; raise SystemExit #')
    assert _made(write_as("randomisation", joint, PYTHON).text, monkeypatch)["RANGES"]


@needs_mjlab
def test_mjlab_draws_within_the_ranges():
    joint = _driven()
    told = json.loads(write_as("actuator", joint).text)["mjlab"]
    at = 'name="hinge" axis="0 -1 0" armature="0.002" damping="0.002"'
    body = f"<mujoco><worldbody><body><joint {at}/>{inertial(joint)}</body></worldbody></mujoco>"
    text = write_as("randomisation", joint, PYTHON).text
    drawn = said_by_mjlab("events_in_mjlab.py", {**told, "text": text, "body": body, "count": 200})
    ranges = {
        "dof_armature": (0.0017, 0.0023),
        "dof_damping": (0.0018, 0.0022),
        "dof_frictionloss": (0.0015, 0.0025),
    }
    kp = np.array(drawn.pop("actuator_gainprm"))[:, 0, 0]
    assert kp.min() >= 0.108 - 1e-6
    assert kp.max() <= 0.132 + 1e-6
    for name, (lower, upper) in ranges.items():
        values = np.ravel(drawn[name])
        assert lower - 1e-6 <= values.min() < lower + 0.1 * (upper - lower), name
        assert upper - 0.1 * (upper - lower) < values.max() <= upper + 1e-6, name
