"""Units are read wherever a file says them, however spelt, and prose that holds a letter says none.

What is written is read end to end and identified: the estimate is that of the joint, or there is an
error that names the word.
"""

import html
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import parquet

import butterfly as bf
from butterfly.logs.formats import log_of_table, read_log
from butterfly.logs.health import examine
from tests.independent.integrator import Joint, motion
from tests.logs import said_table as table
from tests.logs.said_table import DEGREE, SPELLINGS
from tests.logs.written import mat73, put73

P1, P2, P3, P4 = 0.00325, 0.00145, 0.04905, 0.025
STEP, SAMPLES = 0.02, 150
FIELDS = ("time", "input", "angle")
REFUSED = {
    "time": ("samples", "weeks", "deg"),
    "input": ("PWM", "Mv", "Nm", "A", "%"),
    "angle": ("counts", "ticks", "grad", "mm", "V", "counts/0"),
}
OWN = {name: table.OWN[name] for name in FIELDS}
ONES = dict.fromkeys(FIELDS, 1)
COLUMNS = {name: name for name in FIELDS}
IN_NAMES, TOLD = ("bracket", "parenthesis", "tight"), ("option", "manifest")
FORMS = {"csv": (*IN_NAMES, "row"), "semicolons": ("parenthesis", "row"), "tsv": ("bracket", "row")}
FORMS |= {"parquet": (*IN_NAMES, "unit"), "mat": (), "mat 7.3": ("units",), "jsonl": IN_NAMES}
FORMS |= {"json": (*IN_NAMES, "units"), "frame": IN_NAMES}
PLACES = [(form, place) for form, own in FORMS.items() for place in own]
TABLE = PLACES + [(form, place) for form in FORMS for place in TOLD[: 2 - (form == "frame")]]
SAID = {("parquet", "unit"): "metadata unit", ("mat 7.3", "units"): "attribute units"}
SAID |= {("json", "units"): "units", "row": "row of units", "option": "given", "manifest": "given"}


def _moved(samples):
    """Time, input and angle of a joint, each sample of the input held to the next."""
    time = STEP * np.arange(samples)
    command = 0.3 * np.sin(3 * time) + 0.2 * np.sin(7 * time)
    angle, _ = motion(Joint(inertia=P1, viscous=P2, gravity=P3, gain=P4), time, command)
    return {"time": time, "input": command, "angle": angle}


@pytest.fixture(scope="module")
def joint():
    return _moved(SAMPLES)


def _read(cell, joint, units, factors, given=None, **description):
    """Write a file in units, and read it as who is told what the file does not say."""
    folder, form, place = cell
    columns = {name: values / factors[name] for name, values in joint.items()}
    source, _ = table.written(folder, (form, place), columns, {} if place in TOLD else units)
    if form.startswith("mat"):
        description["columns"] = COLUMNS
    if place == "manifest":
        kind = description.pop("input_kind", "voltage")
        said = {"name": "n", "input": kind, "units": units, "logs": [{"file": source.name}]}
        source = source.with_name("manifest.yaml")
        source.write_text(json.dumps(said | description))
        description = {}
    elif place in TOLD:
        given = units
    return bf.read(source, known={"p3": P3}, units=given, **description)


def _assert_same(data, joint):
    for name, values in joint.items():
        read = getattr(data.logs[0], name)
        np.testing.assert_allclose(read, values, rtol=1e-12, atol=1e-14, err_msg=name)


def _spelt(number, kind="voltage"):
    """One spelling of each column and its factor; numbers in a row use them all in turn."""
    pairs = {}
    for name, quantity in zip(FIELDS, ("time", kind, "angle"), strict=True):
        known = [pair for pair in (SPELLINGS[quantity] | table.ALONE[quantity]).items() if pair[1]]
        pairs[name] = known[number % len(known)]
    return {k: unit for k, (unit, _) in pairs.items()}, {k: f for k, (_, f) in pairs.items()}


@pytest.mark.parametrize("kind", ["voltage", "torque"])
@pytest.mark.parametrize(("form", "place"), TABLE)
def test_a_unit_is_read_wherever_and_however_it_is_said(tmp_path, joint, form, place, kind):
    units, factors = _spelt(TABLE.index((form, place)), kind)
    data = _read((tmp_path, form, place), joint, units, factors, input_kind=kind)
    _assert_same(data, joint)
    said = SAID.get((form, place), SAID.get(place, "name"))
    assert {each.unit_source for each in data.health[0].columns.values()} == {said}


def _read_columns(source, columns, kind="voltage"):
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
def test_one_unit_is_read_or_refused_at_every_place_that_a_format_has(form, tmp_path):
    for place, kind, field, spelling, factor, fits in _cells(form):
        true = {k: v for k, v in table.signals().items() if k != "velocity" or field == k}
        columns = true | {field: true[field] / (factor or 1)}
        source, names = table.written(tmp_path, (form, place), columns, {field: spelling})
        cell = (form, place, field, spelling)
        if not fits:
            with pytest.raises(bf.InputError):
                print(cell, _read_columns(source, names, kind).reading.columns)
            continue
        log = _read_columns(source, names, kind)
        for name, values in true.items():
            np.testing.assert_allclose(getattr(log, name), values, rtol=1e-9, err_msg=str(cell))


@pytest.mark.parametrize("form", table.INNOCENT)
def test_prose_says_no_unit(form, tmp_path):
    step = len(table.INNOCENT)
    for number in range(table.INNOCENT.index(form), 34 * step, step):
        source, columns = table.innocent(tmp_path, number)
        log = _read_columns(source, {name: name for name in columns})
        assert {each.factor for each in log.reading.columns.values()} == {1.0}, number


@pytest.mark.parametrize("content", [{"unit": "furlong"}, {"meta": {"input units": "PWM"}}])
def test_a_word_under_a_key_of_units_is_a_unit_or_told(content, tmp_path):
    path = tmp_path / "log.json"
    path.write_text(json.dumps({k: v.tolist() for k, v in table.signals().items()} | content))
    with pytest.raises(bf.InputError, match=r"input: got the unit '(furlong|PWM)' of input \("):
        bf.read(path)
    assert bf.read(path, units={"input": "V"}).logs


def test_the_estimate_is_that_of_the_joint_whatever_the_units(tmp_path):
    joint = _moved(400)
    for number, cell in enumerate([("csv", "row"), ("json", "units"), ("mat", "manifest")]):
        data = _read((tmp_path, *cell), joint, *_spelt(number + 3))
        found = bf.identify(data, "weak-form", terms=[]).estimate.parameters
        assert (found.p1, found.p4) == pytest.approx((P1, P4), rel=1e-3), cell
        assert found.p2 == pytest.approx(P2, rel=1e-2), cell


@pytest.mark.parametrize(("form", "place"), PLACES)
def test_a_word_that_is_no_unit_of_its_column_is_refused_unless_the_unit_is_given(
    tmp_path, joint, form, place
):
    for field, words in REFUSED.items():
        word = words[PLACES.index((form, place)) % len(words)]
        units = OWN | {field: word}
        with pytest.raises(bf.InputError) as refused:
            _read((tmp_path, form, place), joint, units, ONES)
        assert refused.value.field.startswith(field), (form, place, field, word)
        assert word in str(refused.value)
        assert f"--units {field}=" in str(refused.value)
        assert ("counts/4096" in str(refused.value)) is (field == "angle")
        data = _read((tmp_path, form, place), joint, units, ONES, given={field: 1.0})
        assert data.health[0].columns[field].unit_source == "given"
    with pytest.raises(bf.InputError, match=r"unit V of input .*a unit of torque or current or sh"):
        _read((tmp_path, form, place), joint, OWN, ONES, input_kind="torque")


@pytest.mark.parametrize(("form", "place"), PLACES)
def test_two_units_that_differ_are_refused_and_the_same_in_other_words_are_not(
    tmp_path, joint, form, place
):
    cell = ((tmp_path, form, place), joint, OWN | {"angle": "deg"}, ONES | {"angle": DEGREE})
    message = r"the units deg .* and rad \(given\) of angle; .* a factor, .*: --units angle=1$"
    with pytest.raises(bf.InputError, match=message):
        _read(*cell, given={"angle": "rad"})
    for same, sign in (("°", 1), (DEGREE, 1), ("-", -1)):
        data = _read(*cell, given={"angle": same})
        np.testing.assert_allclose(data.logs[0].angle, sign * joint["angle"], rtol=1e-12)


def test_units_that_differ_are_refused_with_their_places(tmp_path, joint):
    names, units = ("time [s]", "input", "angle [rad]"), (None, None, {"unit": "deg"})
    fields = [pa.field(n, pa.float64(), metadata=m) for n, m in zip(names, units, strict=True)]
    parquet.write_table(pa.table([*joint.values()], pa.schema(fields)), tmp_path / "log.parquet")
    with pytest.raises(bf.InputError, match=r"rad \(name\) and deg \(metadata unit\) of angle"):
        bf.read(tmp_path / "log.parquet")
    content = {name: values.tolist() for name, values in joint.items()}
    more = {"units": {"input": "mV"}, "input_unit": "V"}
    (tmp_path / "log.json").write_text(json.dumps(content | more))
    with pytest.raises(bf.InputError, match=r"mV \(units\) and V \(input_unit\) of input"):
        bf.read(tmp_path / "log.json")


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


def test_what_was_read_stands_in_the_record_and_on_the_page(tmp_path, joint, butterfly):
    columns = {"t [ms]": 1e3 * joint["time"], "x": 0 * joint["time"], "u": joint["input"]}
    columns["pos [deg]"] = np.degrees(joint["angle"])
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv")
    told = {"time": "t", "input": "u", "angle": "pos"}
    found = bf.inspect(tmp_path / "log.csv", columns=told, units={"input": "-V"})
    health = found.to_dict()["logs"][0]
    column = {"name": "pos [deg]", "number": 4, "unit": "deg", "factor": DEGREE}
    assert health["columns"]["angle"] == column | {"unit_source": "name", "unread": None}
    page, mapped = tmp_path / "page.html", ",".join(f"{key}={each}" for key, each in told.items())
    more = ("--columns", mapped, "--units", "input=-V", "--report", page)
    _, out, _ = butterfly("inspect", tmp_path / "log.csv", *more)
    for name, text in {
        "time": 'column 1 "t [ms]", ms',
        "input": 'column 3 "u", V (given, negated)',
        "angle": 'column 4 "pos [deg]", deg',
    }.items():
        assert f"{name} from {text}" in " ".join(out.split())
        assert f"{name} from" in page.read_text()
        assert text in html.unescape(page.read_text())


def test_a_velocity_that_nobody_asked_for_is_left_out_if_its_unit_is_not_known(tmp_path, joint):
    frame = pd.DataFrame({**joint, "velocity [ticks/s]": joint["angle"]})
    log = bf.read(frame).logs[0]
    assert log.velocity is None
    assert "velocity ignored" in log.reading.layout[0]
    with pytest.raises(bf.InputError, match=r"velocity \[ticks/s\]: got the unit 'ticks/s'"):
        bf.read(frame, columns={**COLUMNS, "velocity": "velocity"})
    frame.to_csv(tmp_path / "log.csv", index=False)
    assert read_log(tmp_path / "log.csv").velocity is None


def _read_table(joint, names, factors=(1, 1, 1), **told):
    table = {name: f * joint[key] for name, f, key in zip(names, factors, FIELDS, strict=True)}
    return bf.read(table, columns=dict(zip(FIELDS, range(3), strict=True)), **told)


@pytest.mark.parametrize("names", ["t_ms u_mV pos_deg", "ms mV deg", "t[ms]x u(mV)x q[deg]()x"])
def test_a_unit_ends_a_name_or_stands_within(joint, names):
    told = joint, names.split(), (1e3, 1e3, 1 / DEGREE)
    _assert_same(_read_table(*told), joint)
    with pytest.raises(bf.InputError, match=r"deg \(name\) and turns \(given\)"):
        _read_table(*told, units={"angle": "turns"})


@pytest.mark.parametrize("names", ["time_s u_a q_m", "s V m", "t_x uA q_g", "t u_min q_max"])
def test_an_ending_that_may_be_no_unit_is_none(joint, names):
    _assert_same(_read_table(joint, names.split()), joint)


@pytest.mark.parametrize("name", ["(" + " " * 100_000, "[(" * 50_000, "(x " * 50_000 + ")"])
def test_a_hostile_name_takes_no_time(joint, name):
    with pytest.raises(bf.InputError):
        _read_table(joint, (name, "u", "q"), units={"angle": "counts/1" + "0" * 400})
    _read_table(joint, (name, "u", "q"), units={"time": 1})


def test_an_index_in_brackets_is_no_unit_and_tells_columns_apart(joint):
    table = {"time": joint["time"], "u (motor 2) [mV]": 1e3 * joint["input"]}
    table |= {"q[0]": 0 * joint["time"], "q[1]": joint["angle"]}
    log = bf.read(table, columns={"time": "time", "input": "u", "angle": "q[1]"}).logs[0]
    np.testing.assert_allclose(log.input, joint["input"])
    np.testing.assert_array_equal(log.angle, joint["angle"])


def test_thousands_that_are_separated_in_the_stamps_are_refused_whatever_is_allowed(
    tmp_path, joint
):
    rows = [
        f"{k}" if k < 1000 else f"{k // 1000}.{k % 1000:03d}" for k in range(900, 900 + SAMPLES)
    ]
    lines = ["time [ms];input;angle"]
    lines += [f"{t};{u!r};{q!r}" for t, u, q in zip(rows, *list(joint.values())[1:], strict=True)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([*lines, ""]).replace("np.float64(", "").replace(")", ""))
    for given in ({}, {"repair": ["backward"]}, {"restarts": True}):
        with pytest.raises(bf.InputError, match=r"0\.001 after 0\.999 at sample 100; .*separators"):
            bf.read(path, **given)
    again = {name: np.concatenate([each, each]) for name, each in joint.items()}
    assert len(bf.read(again, restarts=True).logs) == 2
    assert examine(bf.Log(*joint.values()))[1].backward_stamps == 0
