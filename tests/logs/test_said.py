"""Units are read wherever a file says them, and prose that holds a letter says none."""

import json
from pathlib import Path

import numpy as np
import pytest

import butterfly as bf
from butterfly.logs.formats import log_of_table, read_log
from tests.logs import said_table as table
from tests.logs.written import mat73, put73


def _read(source, columns, kind="voltage"):
    read = read_log if isinstance(source, Path) else log_of_table
    return read(source, columns, input_kind=kind)


def _cells(form):
    """Yield each place of a format with a case and a spelling, in turn."""
    for number, (_, place) in enumerate(cell for cell in table.CELLS if cell[0] == form):
        for fits in (True, False):
            cases = [case for case in table.CASES if (case[2] == case[3]) is fits]
            kind, field, _, said = cases[number % len(cases)]
            spellings = [(s, f) for s, f in table.SPELLINGS[said].items() if f or not fits]
            spelling, factor = spellings[(7 * number + fits) % len(spellings)]
            if kind == "torque" and said == "current":
                continue  # which makes a torque
            if not table.ambiguous(form, place, spelling):
                yield place, kind, field, spelling, factor, fits


@pytest.mark.parametrize("form", table.WRITERS)
def test_a_unit_is_read_or_refused_wherever_it_is_said(form, tmp_path):
    for place, kind, field, spelling, factor, fits in _cells(form):
        source, columns, true = table.written(tmp_path, (form, place), field, spelling, factor)
        cell = (form, place, field, spelling)
        if not fits:
            with pytest.raises(bf.InputError):
                print(cell, _read(source, columns, kind).reading.columns)
            continue
        log = _read(source, columns, kind)
        for name, values in true.items():
            np.testing.assert_allclose(getattr(log, name), values, rtol=1e-9, err_msg=str(cell))


@pytest.mark.parametrize("form", table.INNOCENT)
def test_prose_says_no_unit(form, tmp_path):
    step = len(table.INNOCENT)
    for number in range(table.INNOCENT.index(form), 34 * step, step):
        source, columns = table.innocent(tmp_path, number)
        log = _read(source, {name: name for name in columns})
        assert {each.factor for each in log.reading.columns.values()} == {1.0}, number


@pytest.mark.parametrize("content", [{"unit": "furlong"}, {"meta": {"input units": "PWM"}}])
def test_a_word_under_a_key_of_units_is_a_unit_or_told(content, tmp_path):
    path = tmp_path / "log.json"
    path.write_text(json.dumps({k: v.tolist() for k, v in table.signals().items()} | content))
    with pytest.raises(bf.InputError, match=r"input: got the unit '(furlong|PWM)' of input \("):
        bf.read(path)
    assert bf.read(path, units={"input": "V"}).logs


def test_units_that_differ_are_refused_with_their_places(tmp_path):
    path, columns = tmp_path / "log.json", table.signals()
    content = {name: values.tolist() for name, values in columns.items()}
    path.write_text(json.dumps(content | {"units": {"input": "mV"}, "input_unit": "V"}))
    with pytest.raises(bf.InputError, match=r"mV \(units\) and V \(input_unit\) of input"):
        bf.read(path)


def test_scale_and_offset_of_netcdf_are_applied_before_the_unit(tmp_path):
    columns = {k: v for k, v in table.signals().items() if k != "velocity"}
    packed = columns | {"input": (columns["input"] / 1e-3 - 2) / 0.5}
    with mat73(tmp_path / "log.mat") as file:
        put73(file, packed)
        file["input"].attrs.update({"UNITS": "mV", "scale_factor": 0.5, "add_offset": [2.0]})
    data = bf.read(tmp_path / "log.mat", columns={name: name for name in columns})
    np.testing.assert_allclose(data.logs[0].input, columns["input"], atol=1e-12)
    said = data.health[0].columns["input"].text
    assert said == '"input", mV (attribute UNITS, scale_factor 0.5 and add_offset 2)'
    with mat73(tmp_path / "log.mat") as file:
        put73(file, packed)
        file["input"].attrs["scale_factor"] = 0.0
    with pytest.raises(bf.InputError, match="scale_factor: got 0"):
        bf.read(tmp_path / "log.mat", columns={name: name for name in columns})
