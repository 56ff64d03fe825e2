"""A log without names is the same log."""

import numpy as np
import pytest

from butterfly.logs.anonymous import (
    anonymous_log,
    anonymous_manifest,
    format_of,
    loop_facts,
    manifest_facts,
)
from butterfly.logs.csv import write_csv
from butterfly.logs.log import AS_WRITTEN, FileReading, Log
from butterfly.logs.manifest import LogEntry, Manifest, write_manifest
from butterfly.logs.reading import read_logs
from butterfly.model.parameters import AddedMass

TIME = 1.7e9 + np.arange(40) / 100
SWING = np.sin(7 * (TIME - TIME[0]))
LOG = Log(
    TIME,
    SWING,
    0.1 * SWING,
    added_mass=AddedMass(mass=0.1, arm=0.2, label="pose wrist 0.5"),
    source="/folder/of/somebody/run.csv",
    name="run.csv",
    reading=FileReading(layout=("comments by somebody",)),
)


def test_only_names_and_the_date_are_taken_off_a_log():
    bare = anonymous_log(LOG, "log-1")
    assert bare.time[0] == 0.0
    np.testing.assert_allclose(np.diff(bare.time), np.diff(LOG.time), atol=1e-6)
    np.testing.assert_array_equal(bare.input, LOG.input)
    np.testing.assert_array_equal(bare.angle, LOG.angle)
    assert (bare.source, bare.name, bare.added_mass.label) == ("log-1", "log-1", "")
    assert bare.reading is AS_WRITTEN
    assert (bare.added_mass.mass, bare.added_mass.arm) == (0.1, 0.2)


def test_a_clock_that_begins_with_no_number_begins_at_its_first():
    late = Log(np.r_[np.nan, TIME[1:]], SWING, SWING)
    assert anonymous_log(late, "log-1").time[1] == 0.0


def test_the_manifest_of_logs_without_names_reads_them_again(tmp_path):
    entry = LogEntry(file="run.csv", added_mass=0.1, at="Tuesday")
    manifest = Manifest(
        name="of somebody",
        description="in a basement",
        root="/folder/of/somebody",
        input="torque",
        arm=0.2,
        known={"p4": 1.0},
        columns={"time": "mine", "input": "mine too", "angle": "q"},
        logs=[entry],
    )
    bare = anonymous_manifest(manifest, [(entry, anonymous_log(LOG, "log-1"))])
    write_manifest(bare, tmp_path / "manifest.yaml")
    text = (tmp_path / "manifest.yaml").read_text()
    assert not [word for word in ("body", "basement", "Tuesday", "mine") if word in text]
    write_csv(anonymous_log(LOG, "log-1"), tmp_path / "log-1.csv")
    (log,) = read_logs(bare.model_copy(update={"root": str(tmp_path)}))[1]
    np.testing.assert_array_equal(log.angle, LOG.angle)
    assert log.added_mass.mass == 0.1
    assert manifest_facts(manifest)["columns"] == ["time", "input", "angle"]


@pytest.mark.parametrize(
    ("law", "kept_law"), [("dynamixel-x", {"law": "dynamixel-x"}), ("of somebody", {})]
)
def test_of_a_loop_numbers_and_a_known_law_remain(law, kept_law):
    loop = {"law": law, "kp": 400, "kd": {"value": 1, "uncertainty": 2}, "note": "mine"}
    assert loop_facts(loop) == kept_law | {"kp": 400, "kd": {"value": 1, "uncertainty": 2}}


def test_the_ending_of_a_file_is_named_if_the_program_reads_it():
    assert format_of(LogEntry(file="a/run.CSV")) == ".csv"
    assert format_of(LogEntry(file="a/run.somebody")) == "other"
    assert format_of(LogEntry(file="somebody")) == "other"
