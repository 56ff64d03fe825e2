"""The commands that look at logs, and the one that fetches the thesis's."""

import hashlib
import json
import re
import shlex
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

import butterfly as bf
from butterfly.cli.output import ExitCode
from butterfly.logs import reading, thesis_logs
from butterfly.logs.csv import write_csv
from butterfly.logs.manifest import read_manifest
from tests.cli.one_line import assert_one_line_error, done
from tests.verdicts import follow_nothing


def test_of_several_logs_one_is_told_and_drawn_as_if_it_were_alone(butterfly, quick_data, tmp_path):
    plot = tmp_path / "plot.html"
    file = quick_data / read_manifest(quick_data / "manifest.yaml").logs[2].file
    out = done(butterfly("inspect", quick_data, "--log", 2, "--report", plot))
    assert "dominant frequency" in out
    assert plot.stat().st_size > 8e5
    page = plot.read_text(encoding="utf-8")
    assert '<span class="badge">✓ Ok</span>' in page
    zero = re.search("Encoder zero: .*", out)[0]
    assert zero in page
    assert zero in (alone := butterfly("inspect", file)[1])
    assert alone[alone.index("  state") :] in out
    done(butterfly("inspect", quick_data, "--report", plot))
    assert_one_line_error(butterfly("inspect", quick_data, "--log", 9), "logs", "from 0 to 8")


def test_of_a_log_of_which_nothing_says_that_it_is_a_sine_the_zero_is_a_guess(butterfly, loose):
    out = done(butterfly("inspect", loose / "a_good.txt", *COLUMNS))
    assert "4000" in out
    assert "The encoder zero is a guess: " in out
    assert "--zero" in out


def test_inspect_says_where_the_hand_hangs_and_how_that_is_known(butterfly, quick_data):
    out = butterfly("inspect", quick_data)[1]
    assert re.search(r"Encoder zero: \S?0\.000\d rad", out)
    assert "(steady swing)" in out
    out = butterfly("inspect", quick_data, "--zero", "0.1+-0.02")[1]
    assert "Encoder zero: 0.1000 ± 0.02 rad (given)." in out
    assert_one_line_error(butterfly("inspect", quick_data, "--zero", "left"), "zero", "left")


@pytest.fixture
def loose(sine_log, tmp_path):
    """A folder of logs without a manifest: degrees and ms, one wrapped, one a turn away."""
    folder = tmp_path / "loose"
    folder.mkdir()
    time = sine_log.time[::10]
    swing = sine_log.angle[::10]
    angles = {
        "a_good": swing,
        "b_round": (8 * np.sin(0.7 * time) + np.pi) % (2 * np.pi) - np.pi,
        "c_away": swing + 2 * np.pi,
    }
    for name, angle in angles.items():
        table = np.column_stack([1e3 * time, sine_log.input[::10], np.degrees(angle)])
        np.savetxt(folder / f"{name}.txt", table, delimiter=";", header="t;volts;phi", comments="")
    return folder


COLUMNS = ("--columns", "time=t,input=volts,angle=phi", "--units", "time=ms,angle=deg")


def test_a_folder_of_any_logs_is_told_the_worst_first_with_what_to_do(butterfly, loose, tmp_path):
    path = tmp_path / "found.json"
    code, out, err = butterfly("inspect", loose, *COLUMNS, "--json", path, "--verbose")
    assert code == 2
    assert "Next: " not in out
    assert "1 unusable" in err
    rows = [line.split()[:3] for line in out.splitlines() if re.match(r"  .*\.txt", line)]
    assert rows == [
        ["b_round.txt", "do", "not"],
        ["c_away.txt", "note", "4000"],
        ["a_good.txt", "ok", "4000"],
    ]
    found = json.loads(path.read_text())["logs"]
    assert [each["condition"] for each in found] == ["do not use", "note", "ok"]
    assert found[0]["findings"][0]["hint"]
    assert found[2]["step"] == pytest.approx(0.01)
    assert json.loads(butterfly("inspect", loose, *COLUMNS, "--json", "-")[1])["logs"] == found
    assert "swings +1 turn from the others" in " ".join(out.split())
    assert "--repair unwrap" in out
    out = done(butterfly("inspect", loose, *COLUMNS, "--repair", "unwrap"))
    assert "by a turn, undone; the angle spans 2.5 turns" in " ".join(out.split())


def test_the_command_that_is_advised_of_a_poor_model_reads_the_same_logs(
    butterfly, quick_data, tmp_path, monkeypatch
):
    (folder := tmp_path / "named").mkdir()
    manifest = read_manifest(quick_data / "manifest.yaml")
    for number, log in enumerate(bf.read(quick_data).recorded):
        table = np.column_stack([1e3 * log.time, log.input, np.degrees(log.angle)])
        path = folder / f"{1e3 * log.added_mass.mass:g}g_{number}.txt"
        np.savetxt(path, table, delimiter=";", header="t;volts;phi", comments="")
    follow_nothing(monkeypatch)
    facts = (*COLUMNS, "--arm", manifest.arm, "--repair", "backward", "--repair", "duplicate")
    code, out, err = butterfly("identify", folder, *facts, "--terms", "", "--method", "weak-form")
    assert (code, err) == (ExitCode.NOT_TO_BE_USED, "")
    step = out.splitlines()[-1]
    assert step.startswith(f"Next: butterfly inspect {folder} --columns time=t,")
    done(butterfly(*shlex.split(step)[2:]))


def test_logs_without_findings_are_listed_on_request_below_the_verdict_and_the_next_command(
    butterfly, quick_data
):
    out = butterfly("inspect", quick_data)[1]
    assert out.splitlines()[0] == "9 logs: all ok."
    step = out.index(f"Next: butterfly identify {quick_data}")
    assert step < out.index("Expected precision")
    assert len(out.splitlines()) < 20
    assert "Without findings" not in out
    assert ".mat" in butterfly("inspect", quick_data, "--verbose")[1]


def test_a_manifest_is_drafted_of_any_logs_with_what_is_said_of_them(butterfly, loose):
    out = done(butterfly("manifest", loose, *COLUMNS, "--repair", "unwrap"))
    assert "added_mass" in out
    text = (loose / "manifest.yaml").read_text(encoding="utf-8")
    for key, what in (("input", "voltage, torque, current, duty"), ("logs", "added_mass")):
        assert re.search(rf"^# To settle: .*{what}.*\n{key}:", text, re.MULTILINE)
        assert f"- {key}: wh" in out
    assert "Assumed: voltage." in out
    manifest = read_manifest(loose / "manifest.yaml")
    assert manifest.units == {"time": "ms", "angle": "deg"}
    assert "unwrap" in manifest.repair
    assert butterfly("inspect", loose)[0] == 0


def test_columns_of_usual_words_are_taken_and_not_asked_for(butterfly, loose, monkeypatch):
    read = Mock(side_effect=reading.read_entry)
    monkeypatch.setattr(reading, "read_entry", read)
    _, out, _ = butterfly("manifest", loose, "--units", "time=ms,angle=deg,mass=g")
    assert "- columns" not in out
    assert read.call_count == 2  # for the columns, and for the unit of the input
    text = (loose / "manifest.yaml").read_text(encoding="utf-8")
    assert "# - {file: ..., added_mass: (g), arm: (m)}\n" in text
    assert "omega" not in text + out
    found = read_manifest(loose / "manifest.yaml").columns
    assert found == {"time": "t", "input": "volts", "angle": "phi"}
    assert butterfly("inspect", loose, "--repair", "unwrap")[0] == 0


def test_what_was_said_is_not_asked_again(butterfly, loose):
    said = ("--input", "torque", "--intersample", "first_order_hold")
    _, out, _ = butterfly("manifest", loose, *COLUMNS, *said)
    assert "voltage" not in out
    text = (loose / "manifest.yaml").read_text(encoding="utf-8")
    asked = re.findall(r"^# To settle: .*\n(\w+):", text, re.MULTILINE)
    assert asked == ["known", "logs"]  # p4, which makes masses needless, comes first
    assert "input: torque\n" in text


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ("omega: 3.0, amplitude: 0.4", "omega 3 rad/s declared, the log's input has 5 rad/s"),
        ("omega: 5.0, amplitude: 0.2", "amplitude 0.2 V declared, the log's input has 0.4 V"),
        ("omega: 5.02, amplitude: 0.39", None),
    ],
)
def test_a_sine_that_is_declared_and_unlike_the_input_is_named(tmp_path, declared, said):
    time = np.arange(3000) / 100
    swing = 0.1 * np.sin(5 * time - 1) + 0.1 * np.sin(1) * np.exp(-time)
    write_csv(bf.Log(time, 0.4 * np.sin(5 * time), swing), tmp_path / "a.csv")
    text = f"name: a\ninput: voltage\nlogs: [{{file: a.csv, {declared}}}]\n"
    (tmp_path / "manifest.yaml").write_text(text)
    (found,) = bf.inspect(tmp_path).rows()
    texts = [each["text"] for each in found["findings"] if "declared" in each["text"]]
    assert texts == ([said] if said else [])


def test_a_draft_is_no_data_set_before_its_columns_are_said(butterfly, tmp_path):
    time = np.arange(60) / 100
    rows = np.column_stack([time, np.sin(3 * time), np.sin(4 * time), np.sin(5 * time)])
    head = "timestamp,position,speed,drive"
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=head, comments="")
    out = done(butterfly("manifest", tmp_path))
    assert "- columns: which column holds the input" in out
    draft = tmp_path / "manifest.yaml"
    said = "columns.input: got nothing", "'drive'", "columns of a.csv"
    for command in ("inspect", "identify"):
        assert_one_line_error(butterfly(command, tmp_path), str(draft), *said)
    draft.write_text(draft.read_text().replace("  angle:", "  input: drive\n  angle:"))
    assert butterfly("inspect", tmp_path)[0] == 0


def test_one_log_says_how_its_file_was_read(butterfly, loose):
    path = loose / "a_good.txt"
    path.write_text(path.read_text() + "4000")
    out = done(butterfly("inspect", path, *COLUMNS))
    assert "semicolons between columns" in out
    assert "1 incomplete last line dropped" in out
    assert "rad (√2 rms), mean" in out


def test_a_log_in_degrees_or_milliseconds_is_told_the_option_to_use(butterfly, loose):
    said = "--columns", COLUMNS[1]
    out = butterfly("inspect", loose / "a_good.txt", *said)[1]
    assert "--units time=ms" in " ".join(out.split())
    assert "--units angle=deg" in " ".join(
        butterfly("inspect", loose / "c_away.txt", *said)[1].split()
    )


def test_recordings_put_together_and_pieces_of_a_log_are_told_apart(butterfly, tmp_path):
    time = np.arange(200) / 100
    rows = [(t, np.sin(3 * t), 0.3 * np.sin(3 * t + k)) for k in range(2) for t in time]
    path = tmp_path / "two.csv"
    np.savetxt(path, rows, delimiter=",", header="time,input,angle", comments="")
    out = done(butterfly("inspect", path, "--restarts", "--verbose"))
    assert all(f"two.csv (part {k})" in out for k in (1, 2))
    np.savetxt(path, rows[:200], delimiter=",", header="time,input,angle", comments="")
    out = done(butterfly("inspect", path, "--from", "0.5", "--to", "1.5"))
    assert "101" in out


@pytest.fixture
def published(tmp_path, monkeypatch):
    """A folder with the one log that there is."""
    folder = tmp_path / "published"
    folder.mkdir()
    (folder / "log.mat").write_bytes(b"log")
    pin = thesis_logs.Pin(hashlib.sha256(b"log").hexdigest(), 3)
    monkeypatch.setattr(thesis_logs, "pins", lambda: {"log.mat": pin})
    monkeypatch.setattr(thesis_logs, "own_folder", lambda: tmp_path / "own")
    monkeypatch.delenv("BUTTERFLY_LOGS", raising=False)
    return folder


def test_logs_are_fetched_to_where_real_logs_finds_them_or_to_a_folder_that_is_told(
    butterfly, published, tmp_path
):
    out = done(butterfly("fetch", "--from", published))
    assert out.splitlines() == [
        f"1 logs, 1 downloaded: {tmp_path / 'own'}",
        "Next: butterfly identify real-logs",
    ]
    assert (tmp_path / "own/log.mat").read_bytes() == b"log"
    assert "1 logs, 0 downloaded" in butterfly("fetch", "--from", published)[1]
    out = done(butterfly("fetch", "--from", published, "--out", tmp_path / "my logs"))
    assert out.endswith(f'identify real-logs --root "{tmp_path / "my logs"}"\n')
    assert (tmp_path / "my logs/log.mat").exists()
    (published / "log.mat").write_bytes(b"lug")
    result = butterfly("fetch", "--from", published, "--out", tmp_path / "another")
    assert_one_line_error(result, published / "log.mat", "SHA-256")
    assert_one_line_error(butterfly("fetch", "--from", "nowhere"), "--from", "nowhere")


def test_a_servo_is_told_by_options(butterfly, tmp_path):
    time = np.arange(0.0, 2.0, 0.01)
    columns = [time, np.sin(3 * time), np.sin(3 * time - 0.1), 7 + 0 * time, time < 1.5]
    names = "t,goal,angle,volts,on"
    log = tmp_path / "servo.csv"
    np.savetxt(log, np.column_stack(columns), delimiter=",", header=names, comments="")
    held = "--columns", "time=t,input=goal,angle=angle,supply=volts,enabled=on"
    told = "inspect", log, "--input", "setpoint", *held
    out = " ".join(done(butterfly(*told, "--loop", "law=dynamixel-x,kp=400+-40")).split())
    assert "servo dynamixel-x, kp 400 ± 40" in out
    assert "supply 7 … 7 V drive off 25 % of the samples" in out
    for slip in ((), ("--loop", "kp=400"), ("--loop", "law=dynamixel-x")):
        assert_one_line_error(butterfly(*told, *slip), "loop", "expected")
    assert_one_line_error(butterfly(*told, "--loop", "400"), "--loop", "NAME=VALUE")
    data = bf.read(log, input_kind="setpoint", loop={"law": "dynamixel-x", "kp": 400},
                   columns={"time": "t", "input": "goal", "angle": "angle"})  # fmt: skip
    assert data.logs[0].servo.kp.value == 400


def test_a_hint_names_the_logs_that_it_is_for(butterfly, quick_data, tmp_path):
    for name in ("a", "b"):
        log = bf.read(quick_data).logs[0]
        cut = np.where(log.time > 3, np.nan, log.angle)
        write_csv(replace(log, angle=cut), tmp_path / f"{name}.csv")
    _, out, _ = butterfly("inspect", tmp_path, "--known", "p4=1", "--input", "torque")
    assert "\nAll 2 logs: angle: got nan at sample " in out
    assert out.count("angle: got nan") == 1
    assert "; expected finite numbers" in out
    write_csv(bf.read(quick_data).logs[0], tmp_path / "c.csv")
    _, out, _ = butterfly("inspect", tmp_path, "--known", "p4=1", "--input", "torque")
    assert "\na.csv, b.csv: angle: got nan at sample " in out


def test_what_cannot_be_identified_has_no_twin(butterfly, quick_data, tmp_path):
    write_csv(bf.read(quick_data).logs[0], tmp_path / "a.csv")
    said = butterfly("export", tmp_path / "a.csv", "--out", tmp_path / "twin.xml")
    assert_one_line_error(said, "no identifiable values; expected a saved result")
