"""A bundle holds what went wrong, without a name, and also where nothing could be read."""

import getpass
import json
import platform
import re
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

import butterfly as bf
from butterfly.errors import InputError

PRIVATE = ("zorblax", "quibnar", "vexilmo", "drumple", "fnordik", "wobzin", "yarglo", "plimsko")


@pytest.fixture
def theirs(tmp_path):
    """A folder of logs in which all that may be named bears a private name."""
    folder = tmp_path / PRIVATE[0]
    folder.mkdir()
    time = np.arange(400) / 100
    rows = np.c_[1.7e9 + time, np.sin(5 * time), 0.1 * np.sin(5 * time + 1)]
    heading = f"{PRIVATE[1]},{PRIVATE[2]} [V],{PRIVATE[3]} [deg]"
    for number in (1, 2):
        name = folder / f"{PRIVATE[4]}{number}.csv"
        np.savetxt(name, rows, header=heading, delimiter=",", comments="")
    (folder / f"{PRIVATE[4]}3.csv").write_text(f"{PRIVATE[5]}\nnothing\n")
    logs = "".join(f"  - {{file: {PRIVATE[4]}{number}.csv}}\n" for number in (1, 2, 3))
    (folder / "manifest.yaml").write_text(
        f"name: {PRIVATE[6]}\ndescription: {PRIVATE[7]}\ninput: voltage\n"
        f"columns: {{time: {PRIVATE[1]}, input: '{PRIVATE[2]} [V]', angle: '{PRIVATE[3]} [deg]'}}\n"
        f"known: {{p3: 0.05}}\nlogs:\n{logs}"
    )
    return folder


def _names(path):
    """What would name the owner of this machine."""
    names = {getpass.getuser(), platform.node(), str(Path.home()), *path.parts[1:-1]}
    return {name for name in names if len(name) > 4} | {"/tmp", "1700000000"}  # noqa: S108 - not used


@pytest.mark.parametrize("samples", [False, True])
def test_nothing_in_a_bundle_names_its_owner(theirs, samples):
    path = theirs.parent / "report.zip"
    files = bf.bundle(theirs, path, logs=samples)
    with ZipFile(path) as parts:
        assert parts.namelist() == [*files]
        contents = {name: parts.read(name).decode() for name in parts.namelist()}
    assert contents == files
    for name, content in files.items():
        for private in (*PRIVATE, *_names(theirs)):
            assert private not in name + content, (name, private)
    assert ("log-1.csv" in files) == samples
    assert ("log-3.csv" in files) is False
    numbers = json.loads(files["report.json"])
    assert [log["log"] for log in numbers["logs"]] == ["log-1", "log-2", "log-3"]
    assert numbers["logs"][0]["factors"]["angle"] == pytest.approx(np.pi / 180)
    assert numbers["logs"][0]["duplicate_stamps"] == 0
    assert numbers["logs"][2]["refused"]
    assert numbers["logs"][2]["at"][-1].startswith("logs/")


def test_the_logs_of_a_bundle_are_read_as_the_others_were(theirs, tmp_path):
    (theirs / "manifest.yaml").write_text(
        re.sub(r".*3\.csv.*\n", "", (theirs / "manifest.yaml").read_text())
    )
    bf.bundle(theirs, tmp_path / "report.zip", logs=True)
    with ZipFile(tmp_path / "report.zip") as parts:
        parts.extractall(tmp_path / "sent")
    ours, sent = bf.read(theirs).logs, bf.read(tmp_path / "sent").logs
    for one, other in zip(ours, sent, strict=True):
        np.testing.assert_allclose(one.angle, other.angle, rtol=1e-12)
        np.testing.assert_allclose(one.time - one.time[0], other.time, atol=1e-6)


def test_a_result_is_judged_by_numbers(quick_data, tmp_path):
    saved = tmp_path / "saved.json"
    answer = bf.identify(quick_data, terms=())
    answer.save(saved)
    numbers = json.loads(bf.bundle(result=saved)["report.json"])["result"]
    assert numbers["verdict"] == answer.standing
    assert numbers["parameters"]["p1"]["value"] == answer.to_dict()["parameters"]["p1"]["value"]
    kinds = {finding["kind"] for finding in numbers["findings"]}
    assert kinds == {finding["kind"] for finding in answer.to_dict()["findings"]}
    whole = json.loads(bf.bundle(saved)["report.json"])
    assert whole["result"] == numbers
    assert len(whole["logs"]) == len(answer.data.logs)


@pytest.mark.parametrize("name", ["nowhere", "notes.txt", "damaged.json", "damaged.yaml"])
def test_data_that_cannot_be_read_are_no_error(tmp_path, name):
    if name != "nowhere":
        (tmp_path / name).write_text("{of somebody: [")
    numbers = json.loads(bf.bundle(tmp_path / name)["report.json"])
    refused = numbers["data"].get("refused") or numbers["logs"][0]["refused"]
    assert refused.endswith("Error")


def test_a_bundle_is_a_zip_file(tmp_path):
    with pytest.raises(InputError, match=r"\.zip"):
        bf.bundle(path=tmp_path / "report.tar")
