"""Clocks that files have: epochs, dates, day numbers, or only an interval; grouped thousands."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.io import savemat

import butterfly as bf
from butterfly.errors import InputError
from butterfly.logs.formats import log_of_table, read_log
from butterfly.logs.health import examine
from butterfly.logs.units import Units
from tests.cli.one_line import done

NANOS = 1_700_000_000_123_456_789 + 2_000_000 * np.arange(60)  # since 1970
TIME = 1e-9 * (NANOS - NANOS[0])
SIGNALS = {"input": np.sin(7 * TIME), "angle": np.cos(3 * TIME)}
JSON = {"log.json": {}, "log.jsonl": {"orient": "records", "lines": True}}
FORMS = [*JSON, "log.csv", "log.tsv", "log.txt", "log.parquet", "log.mat", "frame"]


def _read(folder, form, time, named="time", **about):
    """Write a log of a clock in a form, and read it."""
    frame, path = pd.DataFrame({named: time, **SIGNALS}), folder / form
    columns = {"time": named, "input": "input", "angle": "angle"}
    if form in JSON:
        path.write_text(frame.to_json(double_precision=15, **JSON[form]))
    elif form == "log.parquet":
        frame.to_parquet(path)
    elif form == "log.mat":
        savemat(path, {name: np.asarray(each) for name, each in frame.items()})
    elif form == "frame":
        return log_of_table(frame, columns, **about)
    else:
        mark = {"log.csv": ",", "log.tsv": "\t"}.get(form, ";")
        frame.to_csv(path, index=False, sep=mark, decimal="," if mark == ";" else ".")
    return read_log(path, columns, **about)


@pytest.mark.parametrize("unit", ["ns", "us", "ms", "s"])
@pytest.mark.parametrize("form", FORMS)
def test_an_epoch_is_known_by_its_size_to_the_last_digit(form, unit, tmp_path):
    per, error = {"ns": (1, 0), "us": (10**3, 1e-6), "ms": (10**6, 1e-3), "s": (1e9, 1e-6)}[unit]
    stamps = NANOS / per if unit == "s" else NANOS // per
    log = _read(tmp_path, form, stamps)
    np.testing.assert_allclose(log.time, TIME, rtol=1e-12, atol=error)
    assert f"epoch {unit} (from its size)" in examine(log)[1].findings[-1]
    said = _read(tmp_path, form, stamps, units=Units.of({"time": unit}))
    np.testing.assert_array_equal(said.time, log.time)


@pytest.mark.parametrize("form", [each for each in FORMS if each != "log.mat"])
def test_dates_and_times_of_day_are_read_as_seconds_from_the_first(form, tmp_path):
    for pattern in ("%Y-%m-%dT%X.%f", "%Y-%m-%d %X.%fZ", "%FT%X.%f+01:00", "%X.%f"):
        log = _read(tmp_path, form, [each.strftime(pattern) for each in pd.to_datetime(NANOS)])
        np.testing.assert_allclose(log.time, TIME, atol=1e-6, err_msg=pattern)
        assert log.reading.columns["time"].text.endswith('"time", ns (dates)')


@pytest.mark.filterwarnings("ignore:The default formatting")
@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Berlin"])
def test_typed_dates_keep_their_digits(zone, tmp_path):
    stamps = pd.to_datetime(NANOS).tz_localize(zone)
    for form, error in {"log.parquet": 0, "frame": 0, **dict.fromkeys(JSON, 1e-3)}.items():
        np.testing.assert_allclose(_read(tmp_path, form, stamps).time, TIME, 1e-12, error)
    for form in ("log.parquet", "frame"):
        np.testing.assert_allclose(_read(tmp_path, form, stamps - stamps[0]).time, TIME, 1e-12)


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_dates_that_index_a_table_are_of_its_type_and_a_clock_alone(unit, tmp_path):
    index = pd.DatetimeIndex(pd.to_datetime(NANOS // 10**6 * 10**6), name="time").as_unit(unit)
    frame, path = pd.DataFrame(SIGNALS, index=index), tmp_path / "log.parquet"
    frame.to_parquet(path)
    log = read_log(path)
    np.testing.assert_allclose(log.time, TIME, rtol=1e-12)
    assert log.reading.columns["time"].text == f'column 2 "time", {unit} (type)'
    frame.assign(input=frame.index).to_parquet(path)
    with pytest.raises(bf.InputError, match="input: got a column of timestamp"):
        read_log(path)


@pytest.mark.parametrize("first", [738_000.25, 45_000.25], ids=["MATLAB", "Excel"])
def test_day_numbers_are_read_by_their_name_and_never_by_their_size(first, tmp_path):
    days = first + 50 * TIME / 86_400
    for named in ("datenum", "Excel date", "serial_date", "time [days]", "time_days", "days"):
        log = _read(tmp_path, "log.csv", days, named)
        np.testing.assert_allclose(log.time, 50 * TIME, atol=2e-5)
    with pytest.raises(bf.InputError, match="days, if these are day numbers"):
        _read(tmp_path, "log.tsv", days)
    assert _read(tmp_path, "log.tsv", days, units=Units.of({"time": "s"})).time[0] == first
    with pytest.raises(bf.InputError, match=r"'01.03.2024 10:30' in line 2; .* ISO 8601"):
        _read(tmp_path, "log.csv", ["01.03.2024 10:30"] * 60)
    with pytest.raises(bf.InputError, match="by its size an epoch in ms"):
        _read(tmp_path, "frame", 7e11 + 1e6 * np.arange(60))  # an uptime in ns


GROUPED = {  # delimiter, form of the input, and what English marks become
    "German": (";", "{:,.1f}", (",.", ".,")),
    "German, whole": (";", "{:,.0f}", (",.", ".,")),
    "English, quoted": (",", '"{:,.1f}"', ("", "")),
    "blanks": (";", "{:,.1f}", (",.", " ,")),
    "Swiss": (",", "{:,.1f}", (",", "'")),
}


@pytest.mark.parametrize("how", GROUPED)
def test_grouped_thousands_are_read_where_they_are_sure(how, tmp_path):
    mark, form, turned = GROUPED[how]
    large, turn = 990.0 + 7 * np.arange(60), str.maketrans(*turned)
    cells = [(form.format(u), f"{q:.2f}") for u, q in zip(large, SIGNALS["angle"], strict=True)]
    lines = [mark.join([f"{k}", *(c.translate(turn) for c in row)]) for k, row in enumerate(cells)]
    (tmp_path / "log.csv").write_text("\n".join([mark.join(["time", *SIGNALS]), *lines, ""]))
    log = read_log(tmp_path / "log.csv")
    np.testing.assert_array_equal(log.input, large)
    np.testing.assert_allclose(log.angle, SIGNALS["angle"], atol=6e-3)
    assert any(each.startswith("thousands separators") for each in log.reading.layout)


def test_marks_that_may_be_either_are_refused_as_likely_thousands(tmp_path):
    texts = [f"1;{cells}\n" for cells in ("1.234;5,678", "1.234,5;0.5", "12,345.6;1,5")]
    for head, rows in (*(("time;input;angle\n", text) for text in texts), ("", "57,30\n57,05\n")):
        (tmp_path / "log.csv").write_text(head + rows * 20)
        with pytest.raises(bf.InputError, match=r"line 2.*(without thousands|decimal commas and)"):
            read_log(tmp_path / "log.csv")


CASES = Path(__file__).parents[3] / "shared/data/cases/strangers"
of_cases = pytest.mark.skipif(not CASES.is_dir(), reason="the shared cases are not there")


@of_cases
def test_a_known_interval_stands_for_a_clock(butterfly):
    motor, swing = (CASES / "no_sample_time" / name for name in ("motor.mat", "swing_1kHz_deg.txt"))
    for path in (swing, motor):
        with pytest.raises(bf.InputError, match=r"without time=.*--interval S"):
            bf.read(path)
    log = bf.read(motor, interval=0.02, input="torque", columns={"input": "u", "angle": "y.0"})
    np.testing.assert_allclose(log.logs[0].time, 0.02 * np.arange(800))
    told = "--interval 0.001 --input none --columns angle=0 --units angle=deg --known p1=1"
    answer = json.loads(done(butterfly("identify", swing, *told.split(), "--json", "-")))
    assert answer["parameters"]["p3"]["value"] == pytest.approx(33.9, rel=0.02)


def test_a_clock_and_an_interval_agree_or_are_refused():
    table = {"time": 1e3 * TIME} | SIGNALS
    assert bf.read(table, interval=2e-3, units={"time": "ms"}).logs[0].time[1] == 0.002
    with pytest.raises(bf.InputError, match=r"got 0.002 s, and a column of time with 2 s"):
        bf.read(table, interval=2e-3)


@of_cases
def test_a_file_of_several_tests_is_a_log_for_each(butterfly, tmp_path):
    (path,) = (CASES / "frc_sysid_json").glob("*.json")
    made = tmp_path / "m.yaml"
    done(butterfly("manifest", path, "--gravity", 0, "--known", "p4=1", "--out", made))
    places = [each["at"] for each in yaml.safe_load(made.read_text())["logs"]]
    assert places == ["slow-forward", "slow-backward", "fast-forward", "fast-backward"]
    with pytest.raises(bf.InputError, match="at: got nothing; expected one of slow-forward, slow-"):
        read_log(path)
    data = bf.read(made)
    for place, log in zip(places, data.logs, strict=True):
        table = pd.read_csv(path.with_name(f"{place}.csv"))
        np.testing.assert_allclose(log.angle, 2 * np.pi * table["position"])
        np.testing.assert_allclose(log.velocity, 2 * np.pi * table["velocity"])
        np.testing.assert_array_equal([log.time, log.input], table[["timestamp", "voltage"]].T)
        assert log.name == f"{path.name} ({place})"
    found, true = bf.identify(data).parameters, (1.7507e-3, 1.90986e-2, 0.15)
    assert (found.p1, found.p2, found.coulomb) == pytest.approx(true, rel=0.02)


def test_each_log_of_a_manifest_has_columns_units_interval_and_place_of_its_own(tmp_path):
    rollouts = [{"u": [*SIGNALS["input"]], "q": [*np.degrees(SIGNALS["angle"])]}] * 2
    (tmp_path / "servo.json").write_text(json.dumps({"robot": "b", "rollouts": rollouts}))
    own = {"interval": 0.002, "columns": {"input": "u", "angle": "q"}, "units": {"angle": "deg"}}
    logs = [{"file": "servo.json", "at": f"rollouts.{k}", **own} for k in (0, 1)]
    path = tmp_path / "m.yaml"
    path.write_text(yaml.safe_dump({"name": "a", "input": "voltage", "logs": logs}))
    for log in bf.read(path).logs:
        np.testing.assert_allclose([log.time, log.angle], [TIME, SIGNALS["angle"]], atol=1e-12)
    assert len(bf.read(tmp_path / "servo.json", **own).logs) == 2
    path.write_text(path.read_text().replace("rollouts.1", "rollouts.2"))
    with pytest.raises(bf.InputError, match=r"at: got rollouts\.2; expected one of '0', '1'"):
        bf.read(path)


@pytest.mark.parametrize("form", FORMS)
def test_whole_seconds_and_nanoseconds_in_two_columns_are_a_time_of_all_their_digits(
    tmp_path, form
):
    seconds, rest = np.divmod(NANOS, 10**9)
    parts = {"sec": seconds, "nanosec": rest}
    columns = {"time": "sec", "nanoseconds": "nanosec"}
    columns |= {name: name for name in SIGNALS}
    frame, path = pd.DataFrame({**parts, **SIGNALS}), tmp_path / form
    match form.rpartition(".")[2]:
        case "frame":
            log = log_of_table(frame, columns)
        case "json" | "jsonl":
            path.write_text(frame.to_json(double_precision=15, **JSON[form]))
        case "parquet":
            frame.to_parquet(path)
        case "mat":
            savemat(path, {name: np.asarray(column) for name, column in frame.items()})
        case _:
            mark = {"log.csv": ",", "log.tsv": "\t"}.get(form, ";")
            frame.to_csv(path, index=False, sep=mark, decimal="," if mark == ";" else ".")
    log = log if form == "frame" else read_log(path, columns)
    np.testing.assert_allclose(log.time, TIME, rtol=0, atol=1e-12)
    assert log.reading.columns["time"].text == '"sec and nanosec", ns'


@pytest.mark.parametrize(
    ("seconds", "rest", "message"),
    [
        (1.5, 0, "sec: got 1.5 at sample 3; expected whole s"),
        (1, 10**9, "nanosec: got 1000000000 at sample 3; expected whole ns from 0 to 999999999"),
        (1, -1, "nanosec: got -1 at sample 3"),
        (10**10, 0, "sec: got 10000000000 at sample 3"),
    ],
)
def test_what_is_no_part_of_a_stamp_is_refused_with_its_sample(seconds, rest, message):
    parts = {"sec": np.ones(60), "nanosec": 1e6 * np.arange(60)}
    parts["sec"][3], parts["nanosec"][3] = seconds, rest
    columns = {"time": "sec", "nanoseconds": "nanosec", "input": "input", "angle": "angle"}
    with pytest.raises(InputError, match=message):
        log_of_table(pd.DataFrame({**parts, **SIGNALS}), columns)
    with pytest.raises(InputError, match=r"columns.time: got nothing; expected the column"):
        log_of_table({**parts, **SIGNALS}, {n: columns[n] for n in columns if n != "time"})


def test_a_row_that_lacks_a_part_of_its_stamp_has_no_time():
    seconds, rest = map(np.float64, np.divmod(NANOS, 10**9))
    rest[5] = np.nan
    columns = {"time": "sec", "nanoseconds": "nanosec", "input": "input", "angle": "angle"}
    log = log_of_table({"sec": seconds, "nanosec": rest, **SIGNALS}, columns)
    assert np.flatnonzero(np.isnan(log.time)).tolist() == [5]
