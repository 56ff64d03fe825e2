"""Files of a joint with known parameters: every format, place of the unit and spelling of it.

What is written is read end to end and identified: the estimate is that of the joint, or there is an
error that names the word. Factors are written anew here, from the SI brochure's tables 4, 7 and 8.
"""

import html
import json
import math
from functools import partial

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy.io import savemat

import butterfly as bf
from butterfly.logs.formats import read_log
from butterfly.logs.health import examine
from tests.independent.integrator import Joint, motion
from tests.logs.written import mat73, put73

P1, P2, P3, P4 = 0.00325, 0.00145, 0.04905, 0.025
STEP, SAMPLES = 0.02, 150
FIELDS = ("time", "input", "angle")
DEGREE = math.pi / 180
SPELLINGS = {
    "time": {"s": 1, "sec": 1, "seconds": 1, "S": 1, "ms": 1e-3, "milliseconds": 1e-3, "MS": 1e-3}
    | {"msec": 1e-3, "us": 1e-6, "µs": 1e-6, "microseconds": 1e-6, "ns": 1e-9, "min": 60}
    | {"minutes": 60, "h": 3600, "hours": 3600},
    "input": {"V": 1, "v": 1, "volts": 1, "Volt": 1, "mV": 1e-3, "mv": 1e-3, "millivolts": 1e-3}
    | {"kV": 1e3, "KV": 1e3, "kilovolts": 1e3, "uV": 1e-6, "µV": 1e-6, "MV": 1e6},
    "angle": {"rad": 1, "Radians": 1, "mrad": 1e-3, "deg": DEGREE, "DEG": DEGREE, "°": DEGREE}
    | {"Degrees": DEGREE, "degree": DEGREE, "mdeg": DEGREE / 1e3, "gon": math.pi / 200}
    | {"arcmin": DEGREE / 60, "arcsec": DEGREE / 3600, "rev": 2 * math.pi, "Turns": 2 * math.pi}
    | {"counts/4096": 2 * math.pi / 4096, "ticks/1000": 2 * math.pi / 1000}
    | {"2048 counts/rev": 2 * math.pi / 2048},
}
TORQUES = {"Nm": 1, "N m": 1, "N·m": 1, "N*m": 1, "N-m": 1, "NM": 1, "mNm": 1e-3, "mN m": 1e-3}
TORQUES |= {"Ncm": 1e-2, "N cm": 1e-2, "kgf cm": 0.0980665, "kg·cm": 0.0980665, "A": 1, "mA": 1e-3}
TORQUES |= {"amps": 1, "%": 0.01, "percent": 0.01}
REFUSED = {
    "time": ("samples", "weeks", "deg"),
    "input": ("PWM", "Mv", "Nm", "A", "%"),
    "angle": ("counts", "ticks", "grad", "mm", "V", "counts/0"),
}
OWN = dict(zip(FIELDS, ("s", "V", "rad"), strict=True))
ONES = dict.fromkeys(FIELDS, 1)
COLUMNS = {name: name for name in FIELDS}


def _moved(samples):
    """Time, input and angle of a joint, each sample of the input held to the next."""
    time = STEP * np.arange(samples)
    command = 0.3 * np.sin(3 * time) + 0.2 * np.sin(7 * time)
    angle, _ = motion(Joint(inertia=P1, viscous=P2, gravity=P3, gain=P4), time, command)
    return {"time": time, "input": command, "angle": angle}


@pytest.fixture(scope="module")
def joint():
    return _moved(SAMPLES)


def _named(columns, units, place):
    """Names as the place has them, the units if the file itself has to say them elsewhere."""
    brackets = {"bracket": "{} [{}]", "parenthesis": "{} ({})", "tight": "{}[{}]"}
    return [brackets.get(place, "{}").format(name, units[name]) for name in columns]


def _rows(columns):
    return np.column_stack(list(columns.values())).tolist()


def _text(dialect, folder, columns, units, place):
    ending, separator = dialect
    path = folder / f"log{ending}"
    heads = [_named(columns, units, place)]
    heads += [[units[name] for name in columns]] if place == "row" else []
    lines = [*heads, *([repr(each) for each in row] for row in _rows(columns))]
    path.write_text("".join(f"{separator.join(line)}\n" for line in lines))
    return path


def _parquet(folder, columns, units, place):
    names, path = _named(columns, units, place), folder / "log.parquet"
    said = {name: {"unit": units[name]} if place == "metadata" else None for name in columns}
    fields = zip(names, columns, strict=True)
    schema = pa.schema([pa.field(name, pa.float64(), metadata=said[key]) for name, key in fields])
    parquet.write_table(pa.table(list(columns.values()), schema=schema), path)
    return path


def _hdf5(folder, columns, units, place):
    path = folder / "log.mat"
    with mat73(path) as file:
        put73(file, columns)
        for name in columns if place == "attribute" else ():
            file[name].attrs["units"] = units[name]
    return path


def _records(folder, columns, units, place):
    path, names = folder / "log.jsonl", _named(columns, units, place)
    records = (json.dumps(dict(zip(names, row, strict=True))) for row in _rows(columns))
    path.write_text("".join(f"{each}\n" for each in records))
    return path


def _json(folder, columns, units, place):
    path, names = folder / "log.json", _named(columns, units, place)
    content = dict(zip(names, (each.tolist() for each in columns.values()), strict=True))
    path.write_text(json.dumps(content | ({"units": units} if place == "units" else {})))
    return path


def _mat(folder, columns, *_):
    savemat(folder / "log.mat", columns)
    return folder / "log.mat"


def _frame(_, columns, units, place):
    return pd.DataFrame(dict(zip(_named(columns, units, place), columns.values(), strict=True)))


IN_NAMES, TOLD = ("bracket", "parenthesis", "tight"), ("option", "manifest")
WRITERS = {
    "csv": (partial(_text, (".csv", ",")), (*IN_NAMES, "row")),
    "semicolons": (partial(_text, (".txt", ";")), ("parenthesis", "row")),
    "tsv": (partial(_text, (".tsv", "\t")), ("bracket", "row")),
    "parquet": (_parquet, (*IN_NAMES, "metadata")),
    "mat": (_mat, ()),
    "mat 7.3": (_hdf5, ("attribute",)),
    "records": (_records, IN_NAMES),
    "json": (_json, (*IN_NAMES, "units")),
    "frame": (_frame, IN_NAMES),
}
PLACES = [(form, place) for form, (_, own) in WRITERS.items() for place in own]
TABLE = PLACES + [(form, place) for form in WRITERS for place in TOLD[: 2 - (form == "frame")]]


def _read(cell, joint, units, factors, given=None, **description):
    """Write a file in units, and read it as who is told what the file does not say."""
    folder, form, place = cell
    columns = {name: values / factors[name] for name, values in joint.items()}
    source = WRITERS[form][0](folder, columns, units, place)
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


def _spelt(number, spellings):
    """One spelling of each column and its factor; numbers in a row use them all in turn."""
    pairs = {name: [*each.items()][number % len(each)] for name, each in spellings.items()}
    units, factors = zip(*pairs.values(), strict=True)
    return dict(zip(FIELDS, units, strict=True)), dict(zip(FIELDS, factors, strict=True))


def _said(place):
    others = {"row": "row of units", "metadata": "metadata unit", "attribute": "attribute units"}
    others |= dict.fromkeys(TOLD, "given") | {"units": "units"}
    return others.get(place, "name")


@pytest.mark.parametrize("kind", ["voltage", "torque"])
@pytest.mark.parametrize(("form", "place"), TABLE)
def test_a_unit_is_read_wherever_and_however_it_is_said(tmp_path, joint, form, place, kind):
    spellings = SPELLINGS | ({"input": TORQUES} if kind == "torque" else {})
    units, factors = _spelt(TABLE.index((form, place)), spellings)
    data = _read((tmp_path, form, place), joint, units, factors, input_kind=kind)
    _assert_same(data, joint)
    assert {each.said for each in data.health[0].columns.values()} == {_said(place)}


def test_the_estimate_is_that_of_the_joint_whatever_the_units(tmp_path):
    joint = _moved(400)
    for number, cell in enumerate([("csv", "row"), ("json", "units"), ("mat", "manifest")]):
        data = _read((tmp_path, *cell), joint, *_spelt(number + 3, SPELLINGS))
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
        assert data.health[0].columns[field].said == "given"
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


def test_the_bracket_and_the_metadata_must_agree(tmp_path, joint):
    schema = pa.schema(
        [pa.field(name, pa.float64(), metadata={"unit": "deg"}) for name in ("time [s]", "input")]
        + [pa.field("angle [rad]", pa.float64(), metadata={"unit": "deg"})]
    )
    parquet.write_table(pa.table(list(joint.values()), schema=schema), tmp_path / "log.parquet")
    units = {"time": 1.0, "input": 1.0}
    with pytest.raises(bf.InputError, match=r"rad \(name\) and deg \(metadata unit\) of angle"):
        bf.read(tmp_path / "log.parquet", units=units)


def test_what_was_read_stands_in_the_record_and_on_the_page(tmp_path, joint, butterfly):
    columns = {"t [ms]": 1e3 * joint["time"], "x": 0 * joint["time"], "u": joint["input"]}
    columns["pos [deg]"] = np.degrees(joint["angle"])
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv")
    told = {"time": "t", "input": "u", "angle": "pos"}
    found = bf.inspect(tmp_path / "log.csv", columns=told, units={"input": "-V"})
    health = found.to_dict()["logs"][0]
    assert health["columns"]["angle"] == {
        "name": "pos [deg]",
        "number": 4,
        "unit": "deg",
        "said": "name",
        "factor": DEGREE,
    }
    page, mapped = tmp_path / "page.html", ",".join(f"{key}={each}" for key, each in told.items())
    more = ("--columns", mapped, "--units", "input=-V", "--plot", page)
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
