import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import butterfly as bf
from butterfly.errors import InputError
from butterfly.logs.log import InputKind, Intersample
from butterfly.logs.manifest import checked_options, write_manifest
from butterfly.logs.reading import (
    draft,
    draft_text,
    has_thesis_names,
    open_questions,
    with_columns,
)
from tests.logs.columns import GOAL
from tests.logs.test_formats import write_log

HOW = {"arm": 0.104, "input": InputKind.TORQUE, "intersample": Intersample.FIRST_ORDER_HOLD}


def test_file_names_tell_mass_frequency_and_amplitude(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/Data_120_5__3_5__0015.mat").touch()
    (tmp_path / "Data_52__10__004.mat").touch()
    (tmp_path / "notes.txt").touch()
    manifest = draft(tmp_path, HOW)
    first, second = manifest.logs
    assert (first.added_mass, first.omega, first.amplitude) == (0.052, 10.0, 0.04)
    assert second.file == "sub/Data_120_5__3_5__0015.mat"
    assert (second.added_mass, second.omega, second.amplitude) == (0.1205, 3.5, 0.015)


def test_the_shipped_manifest_is_what_the_file_names_say(logs_folder, real_manifest):
    generated = draft(logs_folder, HOW)
    assert len(generated.logs) == 41
    assert real_manifest.logs == generated.logs


def test_a_folder_without_logs_or_with_other_names_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        has_thesis_names(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"no .*\.mat, .*file"):
        draft(tmp_path, HOW)
    (tmp_path / "run7.mat").touch()
    (tmp_path / "Data_52__10__004.mat").touch()
    with pytest.raises(InputError, match="got run7"):
        draft(tmp_path, HOW)


@given(grams=st.decimals(0, 500, places=1), omega=st.decimals(1, 30, places=2))
def test_any_name_of_the_pattern_is_read_back(tmp_path_factory, grams, omega):
    folder = tmp_path_factory.mktemp("names")
    stem = f"Data_{grams}__{omega}".replace(".", "_")
    (folder / f"{stem}__001.mat").touch()
    (entry,) = draft(folder, HOW).logs
    assert entry.added_mass == pytest.approx(float(grams) / 1e3)
    assert entry.omega == pytest.approx(float(omega))
    assert entry.amplitude == 0.01


def test_numbers_in_names_are_written_in_the_units_that_are_told(tmp_path):
    (tmp_path / "Data_120_5__6__0015.mat").touch()
    units = {"mass": "g", "omega": "rpm"}
    manifest = draft(tmp_path, HOW | {"units": units})
    (entry,) = manifest.logs
    assert (entry.added_mass, entry.omega) == (120.5, pytest.approx(6 * 60 / (2 * math.pi)))
    assert manifest.added_mass(entry).mass == pytest.approx(0.1205)
    assert manifest.excitation(entry).omega == pytest.approx(6.0)
    alone = draft(tmp_path / "Data_120_5__6__0015.mat", HOW | {"units": units})
    assert alone.logs == manifest.logs


def test_all_logs_of_a_folder_are_found_whatever_their_names(tmp_path, sine_log):
    for name in ("b.mat", "sub/a.csv", "c.dat"):
        write_log(sine_log.take(np.arange(20)), tmp_path / name)
    (tmp_path / "notes.txt").write_text("Tuesday, bench 2\n")
    (tmp_path / "scales.txt").write_text("52 53 54\n" * 15)
    manifest = draft(tmp_path, HOW | {"columns": {"time": 0}})
    assert [entry.file for entry in manifest.logs] == ["b.mat", "c.dat", "sub/a.csv"]
    assert manifest.columns == {"time": 0}
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"no .*file with a table"):
        draft(tmp_path / "empty", HOW)


def test_a_mass_within_a_name_is_taken_with_an_arm(tmp_path, sine_log):
    names = ("run000_100g_3rads.csv", "run001_0g_signal.csv", "a_120_5g.csv")
    for name in names:
        write_log(sine_log.take(np.arange(20)), tmp_path / name)
    masses = ([e.added_mass for e in draft(tmp_path, g).logs] for g in ({}, {"arm": 0.1}))
    assert list(masses) == [[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]]


def _servo_rows():
    return [
        {"timestamp": 0.01 * k, "position": math.sin(0.03 * k), "goal_position": math.sin(0.04 * k)}
        for k in range(40)
    ]


def test_numbers_beside_the_records_of_a_servo_are_facts_of_its_log(tmp_path):
    numbers = {"mass": 0.5, "arm-mass": 0.02, "length": 0.14, "kp": 8, "vin": 12.0, "motor": "mx64"}
    (tmp_path / "a.json").write_text(json.dumps(numbers | {"entries": _servo_rows()}))
    given = checked_options({"input": "setpoint", "loop": {"law": "dynamixel-x"}})
    drafted = with_columns(draft(tmp_path, given), given)
    assert drafted.columns == GOAL
    (entry,) = drafted.logs
    assert (entry.at, entry.added_mass, entry.arm) == ("entries", 0.5, 0.14)
    assert entry.loop == {"kp": 8.0, "supply": 12.0}
    write_manifest(drafted, tmp_path / "manifest.yaml")
    (log,) = bf.read(tmp_path).recorded
    assert (log.servo.kp.value, log.servo.supply) == (8.0, 12.0)
    assert (log.added_mass.mass, log.added_mass.arm) == (0.5, 0.14)
    own = given | {"loop": {"law": "dynamixel-x", "kp": 400}, "arm": 0.2}
    (tmp_path / "manifest.yaml").unlink()
    (entry,) = with_columns(draft(tmp_path, own), own).logs
    assert (entry.arm, entry.loop) == (None, {"supply": 12.0})


def test_of_what_no_name_says_the_draft_has_the_choices(tmp_path):
    records = [{"t": 0.01 * k, "a": [k % 7, k % 5], "q": k % 3} for k in range(40)]
    (tmp_path / "a.json").write_text(json.dumps(records))
    drafted = with_columns(draft(tmp_path, {}))
    assert drafted.columns == {"time": "t", "angle": "q"}
    asked = open_questions(drafted, (), named=False)
    assert "which column holds the input" in asked["columns"]
    assert "columns of a.json: 't', 'a.0', 'a.1', 'q'." in asked["columns"]
    assert "omega" not in str(asked)
    (tmp_path / "a.json").write_text(
        json.dumps([{**each, "pwm": 1, "volts": 2} for each in records])
    )
    asked = open_questions(with_columns(draft(tmp_path, {})), (), named=False)
    assert "duty by the name of 'pwm' or voltage by the name of 'volts'" in asked["input"]


def test_a_servos_draft_has_its_drives_columns_and_asks_for_the_gain_that_no_name_gives(tmp_path):
    time = np.arange(60) / 100
    table = np.column_stack([time, time, time, 7.3 + 0 * time, 1 + 0 * time])
    header = "time_s,goal_rad,angle_rad,supply_V,torque_enabled"
    for name in ("sine_kp400.csv", "step_kp800.csv"):
        np.savetxt(tmp_path / name, table, delimiter=",", header=header, comments="")
    loop = {"input": InputKind.SETPOINT, "loop": {"law": "dynamixel-xl330"}}
    drafted = with_columns(draft(tmp_path, loop), loop)
    assert [drafted.columns[name] for name in ("supply", "enabled")] == header.split(",")[3:]
    assert [entry.loop for entry in drafted.logs] == [{"kp": 400.0}, {"kp": 800.0}]
    assert "loop" not in open_questions(drafted, loop, named=False)
    (tmp_path / "step_kp800.csv").rename(tmp_path / "step.csv")
    asked = open_questions(with_columns(draft(tmp_path, loop), loop), loop, named=False)
    assert "which kp had the loop" in asked["loop"]


def test_a_draft_of_a_torque_drive_asks_for_p4_before_it_asks_for_masses(tmp_path, sine_log):
    write_log(sine_log, tmp_path / "a.csv")
    torque = {"input": InputKind.TORQUE}
    drafted = with_columns(draft(tmp_path, torque), torque)
    asked = open_questions(drafted, torque, named=False)
    assert [*asked].index("known") < [*asked].index("logs")
    assert "Then p4 is 1, and no added mass is needed: {p4: 1.0}" in asked["known"]
    text = draft_text(drafted, asked)
    assert f"# To settle: {asked['known']}\nknown: {{}}\n" in text
    known = checked_options(torque | {"known": {"p4": "1"}})
    asked = open_questions(with_columns(draft(tmp_path, known), known), known, named=False)
    assert not {"known", "logs"} & asked.keys()
    voltage = {"input": InputKind.VOLTAGE}
    assert "known" not in open_questions(draft(tmp_path, voltage), voltage, named=False)
