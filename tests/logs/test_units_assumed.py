"""A unit that nobody says is told; one that the file may say, and nobody understood, is judged."""

import math

import numpy as np
import pytest

import butterfly as bf
from butterfly.identification.trust import FindingKind
from butterfly.verdict import Level
from tests.benchmarks.units_table import NAMES, harmless, outcome, signals

CELLS = [  # place, unit, factor, kind of input, what comes of it
    ("comment table", "mV", 1e-3, "voltage", "read"),
    ("comment ECSV", "mV", 1e-3, "voltage", "read"),
    ("comment YAML list", "mA", 1e-3, "current", "read"),
    ("comment INI units", "millivolts", 1e-3, "voltage", "read"),
    ("preamble LabVIEW", "mV", 1e-3, "voltage", "read"),
    ("comment prose of both", "mNm", 1e-3, "torque", "read"),
    ("u_name", "mV", 1e-3, "voltage", "read"),
    ("name (note, u)", "PWM %", 1e-2, "duty", "read"),
    ("column of units", "mV", 1e-3, "voltage", "read"),
    ("npz header of a matrix", "mV", 1e-3, "voltage", "read"),
    ("mat units as characters", "mV", 1e-3, "voltage", "read"),
    ("xlsx number format", "mV", 1e-3, "voltage", "read"),
    ("xlsx comment", "mV", 1e-3, "voltage", "read"),
    ("xlsx sheet Units", "mV", 1e-3, "voltage", "read"),
    ("xlsx title", "mV", 1e-3, "voltage", "named"),
    ("comment column number", "mV", 1e-3, "voltage", "named"),
    ("comment number: u", "PWM %", 1e-2, "voltage", "named"),
    ("name_u", "PWM %", 1e-2, "voltage", "refused"),
]


@pytest.mark.parametrize("cell", CELLS, ids=lambda cell: " ".join(cell[:2]))
def test_a_place_that_people_use_is_read_or_named(tmp_path, cell):
    *what, expected = cell
    found, why = outcome(*what, tmp_path)
    assert found == expected, why


@pytest.mark.parametrize("number", range(8))
def test_words_that_say_something_else_change_nothing(number):
    assert harmless(number, ("voltage", "torque", "current")[number % 3]) == ""


def _write(path, *above, factor=1e-3, head="time,input,angle", samples=400):
    """Write the joint's signals, the input in units of so much."""
    time, command, angle = signals(samples)
    rows = zip(time, command / factor, angle, strict=True)
    lines = [*above, head, *(",".join(map(repr, map(float, row))) for row in rows)]
    path.write_text("\n".join([*lines, ""]))
    return path


def _identified(path, **given):
    data = bf.read(path, known={"p3": 0.04905}, input="voltage", **given)
    return bf.identify(data, "weak-form", terms=[])


def test_a_word_that_was_not_understood_keeps_p4_from_good_until_it_is_said(tmp_path):
    path = _write(tmp_path / "log.csv", "# amplifier set to mV")
    found = _identified(path)
    assert found.estimate.level is Level.CARE
    assert "says mV (comment: 'amplifier set to mV')" in found.summary[0]
    assert "Set --units input=mV, or units: {input: mV} in the manifest" in found.summary[0]
    (row,) = [each for each in found.estimate.table() if each.name == "p4"]
    assert row.claim == "unit-unread"
    assert row.meaning.endswith("input taken in V")
    said = _identified(path, units={"input": "mV"})
    assert said.estimate.level is Level.GOOD
    assert said.estimate.parameters.p4 == pytest.approx(0.25, rel=1e-3)
    assert _identified(path, units={"input": "V"}).estimate.level is Level.GOOD


def test_what_was_taken_is_told_where_the_file_is_silent_and_changes_no_verdict(tmp_path):
    path = _write(tmp_path / "log.csv", factor=1.0)
    silent, said = _identified(path), _identified(path, units={"input": "V"})
    assert silent.estimate.level is said.estimate.level is Level.GOOD
    assert silent.summary[0] == said.summary[0]
    (row,) = [each for each in silent.estimate.table() if each.name == "p4"]
    assert row.meaning.endswith("input taken in V: the file does not say")
    kinds = {each.kind for each in silent.estimate.findings}
    assert kinds - {each.kind for each in said.estimate.findings} == {FindingKind.UNIT_ASSUMED}
    inspection = bf.inspect(path, input="voltage")
    assert inspection.summary[0] == "1 log: ok."
    assert "Input taken in V: the file does not say." in inspection.summary


def test_the_printed_advice_works_if_typed(tmp_path, butterfly):
    path = _write(tmp_path / "log.csv", "# amplifier set to mV")
    told = ("identify", path, "--known", "p3=0.04905", "--method", "weak-form", "--terms", "")
    _, out, _ = butterfly(*told)
    assert "Use with care: Input taken in V, but the file says mV" in " ".join(out.split())
    assert "--units input=mV" in out.splitlines()[-1]
    _, out, _ = butterfly(*told, "--units", "input=mV")
    assert out.startswith("Good: ")
    _, out, _ = butterfly("manifest", path)
    assert "units: Input taken in V, but the file says mV" in " ".join(out.split())


def test_a_duty_is_a_share_and_above_1_its_unit_is_asked_for():
    time, command, angle = signals()
    table = dict(zip(NAMES, (time, command, angle), strict=True))
    log = bf.read(table, input="duty").logs[0]
    np.testing.assert_array_equal(log.input, command)
    percents = table | {"input": 5e3 * command}
    with pytest.raises(bf.InputError, match=r"got a duty of .*--units input=%"):
        bf.read(percents, input="duty")
    log = bf.read(percents, input="duty", units={"input": "%"}).logs[0]
    np.testing.assert_allclose(log.input, 50 * command)
    table |= {"duty": command}
    columns = {"time": "time", "input": "duty", "angle": "angle"}
    with pytest.raises(bf.InputError, match=r"the unit duty of input .*; or --input duty"):
        bf.read(table, columns=columns)


def test_advice_on_a_clock_has_been_tried():
    time, command, angle = signals(200)
    steps = {"[us]": (1, "1"), "[s]": (1e3, "0.001"), "": (1e3, "ms")}
    for label, (factor, advised) in steps.items():
        table = {f"time {label}".strip(): factor * time, "input": command, "angle": angle}
        columns = {"time": next(iter(table)), "input": "input", "angle": "angle"}
        remarks = bf.read(table, columns=columns).health[0].remarks
        (remark,) = [each for each in remarks if "one sample every" in each.text]
        assert f"--units time={advised}," in remark.hint
        unit = advised if advised == "ms" else float(advised)
        log = bf.read(table, columns=columns, units={"time": unit}).logs[0]
        np.testing.assert_allclose(log.time, time)
    stamps = (np.datetime64("2026-03-01T10:30:00", "us") + (1e6 * time).astype("m8[us]")).astype(
        str
    )
    dated = {"time [ms]": stamps, "input": command, "angle": angle}
    columns = {"time": "time [ms]", "input": "input", "angle": "angle"}
    with pytest.raises(bf.InputError, match=r"ms \(name\) and ns \(dates\) .*time=1e-09$"):
        bf.read(dated, columns=columns)
    log = bf.read(dated, columns=columns, units={"time": 1e-9}).logs[0]
    np.testing.assert_allclose(log.time, time, atol=1e-9)


def test_a_point_that_may_group_thousands_is_named(tmp_path):
    path = tmp_path / "log.csv"
    for numbers, care in ((("999", "1.000", "1.234"), True), (("0.999", "1.000", "1.234"), False)):
        rows = [f"{0.02 * k:.2f};{numbers[k % 3]};{math.cos(k / 9):.4f}" for k in range(40)]
        path.write_text("\n".join(["time;input;angle", *rows, ""]))
        (seen,) = bf.inspect(path, input="voltage").rows()
        texts = [finding["text"] for finding in seen["findings"]]
        told = "1.000 read with a decimal point, not as 1000" in texts
        assert told is (seen["condition"] == Level.CARE.value) is care
