"""What is exported: its numbers, and what its formats leave out."""

import re
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from butterfly.api.identification import IdentifiedModel
from butterfly.identification.free_run import Setting, Simulations
from butterfly.model.parameters import LumpedParameters
from butterfly.model.servo import ServoLoop
from butterfly.plant.mjcf import text_of
from butterfly.twin.forms import write_as
from butterfly.twin.stand_alone import stand_alone
from butterfly.twin.twin import Yardstick
from tests.twin.alone import BRIEF, PLAIN, twin_of


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"delay": -2e-4}, r"The delay of -0\.2 ms is not included: a delay cannot be"),
        ({"delay": 2e-5}, r"The delay of 0\.02 ms is not included: it is shorter than a step"),
        ({"compression": 0.05}, r"set ctrl to u/\(1 \+ 0\.05 \|u\|\) yourself"),
        ({"dead_zone": 0.02}, r"move ctrl by up to 0\.02 towards 0 yourself"),
        ({"slow_delay": 9e-4, "slow_interval": 1e-3}, r"fast sampling; in slow .* is 0\.9 ms"),
        ({"motor_friction": 0.1, "load_stribeck": 0.2}, "Not .*: motor_friction, load_stribeck"),
    ],
)
def test_what_mujoco_cannot_do_is_said_to_the_user_and_in_the_file(more, said, tmp_path):
    parameters = replace(PLAIN, **more)
    written = write_as("mjcf", twin_of(parameters, BRIEF))
    (sentence,) = written.left_out
    assert re.search(said, sentence)
    assert f"<!-- {sentence} -->" in written.text
    with pytest.warns(UserWarning, match=said):
        IdentifiedModel(parameters).export(tmp_path / "twin.xml")


def test_rounding_and_a_servo_s_loop_are_left_out_and_named_and_a_limit_is_a_range():
    servo = ServoLoop.of({"law": "dynamixel-x", "kp": 400})
    made = stand_alone(twin_of(PLAIN, resolution=0.01, servo=servo, limit=3.5))
    rounding, loop = made.left_out
    assert "set ctrl to multiples of 0.01" in rounding
    assert "The servo's loop (dynamixel-x) is not included" in loop
    model = mujoco.MjModel.from_xml_string(text_of(made.root))
    assert [*model.actuator("motor").ctrlrange] == [-3.5, 3.5]


def test_logs_near_the_upright_do_not_judge_an_export():
    over = replace(BRIEF, name="over", angle=np.linspace(0.0, 4.0, BRIEF.time.size))
    recorded = [(log, Setting(parameters=PLAIN, zero=0.0)) for log in (BRIEF, over)]
    simulations = Simulations([BRIEF, over], {BRIEF.added_mass: 0.0}, counted=[0])
    data = SimpleNamespace(logs=[BRIEF, over], simulations=simulations)
    source = SimpleNamespace(data=data, estimate=SimpleNamespace(horizon=None))
    twin = replace(twin_of(PLAIN), recorded=lambda: recorded, source=source)
    yardstick = Yardstick.of(twin, 1e-3)
    assert [case.name for case in yardstick.cases] == ["log"]
    said = yardstick.accuracy(lambda case: case.simulated).sentence
    assert said.endswith("; 1 more log not compared.")


def test_a_twin_takes_numbers_of_any_kind():
    plain = replace(PLAIN, coulomb=0.003, delay=0.004)
    drawn = LumpedParameters(**{name: np.float64(each) for name, each in vars(plain).items()})
    texts = [write_as("mjcf", twin_of(each, BRIEF)).text for each in (plain, drawn)]
    assert texts[0] == texts[1]
    assert mujoco.MjModel.from_xml_string(texts[0]).nhistory
