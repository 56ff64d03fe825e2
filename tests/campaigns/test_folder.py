"""A campaign's folder: whose it is, what a kill leaves of it, and that nothing in it is lost."""

import json
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from hashlib import sha256
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import butterfly as bf
from butterfly import outputs
from butterfly.api import campaigns
from butterfly.campaigns import folder as module
from butterfly.campaigns.bench import Contact
from butterfly.campaigns.campaign import CampaignResult
from butterfly.campaigns.folder import Folder, Journal, Step
from butterfly.campaigns.lock import LOCK
from butterfly.errors import InputError
from butterfly.identification.data import read_data_set
from butterfly.logs.manifest import read_manifest
from butterfly.model.parameters import NO_ADDED_MASS
from butterfly.model.prior import Known, known_of
from tests.campaigns.folders import MASS, OURS, contents, record, recording, refused, stale, step


def test_what_is_written_is_what_identify_reads(begun):
    assert set(contents(begun)) == OURS
    with Folder(begun) as folder:
        ours, one = folder.data(), folder.data(slice(1, 2))
    theirs = read_data_set(read_manifest(begun / "manifest.yaml"))
    assert [log.added_mass for log in ours.logs] == [log.added_mass for log in theirs.logs]
    assert all(
        np.array_equal(a.angle, b.angle) for a, b in zip(ours.logs, theirs.logs, strict=True)
    )
    assert [log.added_mass for log in one.logs] == [MASS]


@pytest.mark.parametrize(
    "there", ["run_000.parquet", "report.html", "manifest.yaml", ".notes", "a/b"]
)
@pytest.mark.parametrize("by_link", [False, True])
def test_a_folder_of_anything_else_is_refused_and_overwrite_does_not_change_that(
    tmp_path, there, by_link
):
    foreign = tmp_path / "foreign"
    (foreign / there).parent.mkdir(parents=True)
    (foreign / there).write_text("mine", encoding="utf-8")
    (tmp_path / "link").symlink_to(foreign)
    before = contents(foreign)
    with outputs.call(overwrite=True), pytest.raises(InputError, match=there.split("/", 1)[0]):
        record(tmp_path / "link" if by_link else foreign, 1)
    assert contents(foreign) == before


def test_the_command_refuses_a_foreign_folder_before_anything_moves(tmp_path, butterfly):
    (tmp_path / "thesis.tex").write_text("mine", encoding="utf-8")
    words = ("campaign", "quickstart", "--out", tmp_path, "--overwrite")
    code, _, err = butterfly(*map(str, words))
    assert code == 2
    assert "got a folder with thesis.tex; expected a new or empty folder" in err
    assert contents(tmp_path) == {"thesis.tex": b"mine"}


@pytest.mark.parametrize("name", ["report.html", "report.json"])
def test_a_foreign_report_in_a_campaigns_folder_is_refused_and_its_own_is_not(begun, name):
    (begun / name).write_text("mine", encoding="utf-8")
    refused(begun, name)
    mark = outputs.mark_of(Path(name), "campaign") or outputs.mark_of_document("campaign")
    (begun / name).write_text(mark, encoding="utf-8")
    record(begun, 3)


@pytest.mark.parametrize("name", ["campaign.json", "manifest.yaml", "report.html", "report.json"])
def test_a_file_that_is_a_link_is_refused_and_what_it_leads_to_stays(begun, tmp_path, name):
    there = begun / name
    elsewhere = tmp_path / "elsewhere"
    if there.exists():
        there.rename(elsewhere)
    there.symlink_to(elsewhere)
    refused(begun, "a link")


def test_a_folder_behind_a_link_is_the_folder_and_may_be_renamed(begun, tmp_path):
    (tmp_path / "link").symlink_to(begun)
    record(tmp_path / "link", 3)
    begun.rename(tmp_path / "b")
    record(tmp_path / "b", 4)
    assert len(bf.read(tmp_path / "b").recorded) == 4


def test_other_files_beside_a_campaign_stay_as_they_are(begun):
    (begun / "notes.txt").write_text("mine", encoding="utf-8")
    record(begun, 3)
    assert (begun / "notes.txt").read_text(encoding="utf-8") == "mine"


def test_a_folder_that_a_campaign_made_and_left_empty_is_removed(tmp_path):
    with suppress(ZeroDivisionError), Folder(tmp_path / "a"):
        _ = 1 / 0
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("known", [1.0, (1.0, 0.1), "1+-0.1", Known(value=1.0, uncertainty=0.1)])
def test_known_values_that_come_later_are_in_the_manifest_and_stay_there(begun, known):
    record(begun, 2, known={"p4": known})
    record(begun, 3)
    found = read_manifest(begun / "manifest.yaml").prior
    assert found.parameters["p4"] == known_of(known)


def replaced(old, new, name="campaign.json"):
    """What puts other words into a file."""

    def change(path):
        text = (path / name).read_text(encoding="utf-8")
        assert old in text
        (path / name).write_text(text.replace(old, new), encoding="utf-8")

    return change


def written(name, content):
    return lambda path: (path / name).write_bytes(content)


DAMAGED = {
    "empty journal": (written("campaign.json", b""), "campaign.json: content: got no JSON object"),
    "cut journal": (written("campaign.json", b'{"schema": '), "campaign.json: content"),
    "no journal": (written("campaign.json", b'{"budget": 3}'), "schema: got None; expected butt"),
    "a list": (written("campaign.json", b"[1]"), "campaign.json: content"),
    "another version": (replaced('number": 2', 'number": 1'), "schema_number: got 1; expected 2"),
    "no parameter": (replaced('"known": {}', '"known": {"p9": 1}'), "campaign.json: known.p9"),
    "no masses": (
        replaced('"added_mass"', '"mass"'),
        "campaign.json: steps.0.added_mass: got nothing; expected a value",
    ),
    "another limit": (replaced('"seconds": 1.0', '"seconds": 9.0'), "campaign.json: digest: got"),
    "no digest": (replaced('"digest"', '"dagest"'), "campaign.json: digest: got"),
    "no digests": (replaced('"logs"', '"lags"'), "campaign.json: logs: got 0 for 2 runs"),
    "another mass": (replaced("0.1, arm", "0.2, arm", "manifest.yaml"), "manifest.yaml: logs"),
    "another log": (replaced("run_000", "run_007", "manifest.yaml"), "manifest.yaml: logs"),
    "another input": (replaced("torque", "voltage", "manifest.yaml"), "manifest.yaml: input"),
    "no YAML": (written("manifest.yaml", b"logs: ["), "manifest.yaml"),
    "a lost log": (lambda path: (path / "run_000.parquet").unlink(), "run_000.parquet: path"),
    "a log that is none": (written("run_001.parquet", b"PAR1"), "run_001.parquet: content"),
    "the other log": (
        lambda path: (path / "run_001.parquet").replace(path / "run_000.parquet"),
        "run_000.parquet: content: got another file; expected the log of run 0",
    ),
}


@pytest.mark.parametrize("wrong", DAMAGED)
def test_damage_is_refused_with_its_file_and_nothing_is_changed(begun, wrong):
    damage, match = DAMAGED[wrong]
    damage(begun)
    refused(begun, match)


def test_a_lost_manifest_is_written_again(begun):
    manifest = (begun / "manifest.yaml").read_bytes()
    (begun / "manifest.yaml").unlink()
    record(begun, 2)
    assert (begun / "manifest.yaml").read_bytes() == manifest


class Killed(BaseException):
    """Ends a campaign at once, as a kill does."""


@pytest.mark.parametrize("is_written", [False, True])
@pytest.mark.parametrize("at", range(12))
def test_after_a_kill_at_any_write_each_run_has_its_log_and_no_log_is_lost(
    tmp_path, monkeypatch, at, is_written
):
    path, writes = tmp_path / "a", count()

    def killed(write):
        def written(*args, **options):
            last = next(writes) == at
            if not last or is_written:
                write(*args, **options)
            if last:
                raise Killed

        return written

    for name in ("write_file", "create_file"):
        monkeypatch.setattr(module, name, killed(getattr(module, name)))
    with pytest.raises(Killed):
        record(path, 3)
    monkeypatch.undo()
    logs = {each.read_bytes() for each in path.glob("*.parquet")}
    notes = record(path, 3)
    kept = {each.name: each.read_bytes() for each in path.glob("*.parquet")}
    assert logs <= set(kept.values())
    digests = json.loads((path / "campaign.json").read_bytes())["logs"]
    assert digests == [sha256(kept[f"run_{k:03d}.parquet"]).hexdigest() for k in range(3)]
    assert len(bf.read(path).recorded) == 3
    assert len(kept) == 3 + len(notes)


KILLS = {
    "half a log": "folder.create_file = lambda path, log: (path.write_bytes(log[:99]), kill())",
    "a journal without its name": "Path.replace = lambda *_: kill()",
    "a log without its entry": "folder.write_file = lambda *_, **__: kill()",
}
KILLING = """
import os, signal, sys
from pathlib import Path
import numpy as np
from butterfly.campaigns import folder
from butterfly.campaigns.bench import Recording
from butterfly.model.parameters import NO_ADDED_MASS
time = 0.01 * np.arange(400)
run = Recording(time, time, time, "", "torque")
step = folder.Step(what="third", why="", added_mass=NO_ADDED_MASS, seconds=3.0)
kill = lambda: os.kill(os.getpid(), signal.SIGKILL)
for path, patch in zip(sys.argv[1::2], sys.argv[2::2]):
    if os.fork() == 0:
        with folder.Folder(Path(path)) as there:
            exec(patch)
            there.add(run, step)
    assert os.WTERMSIG(os.wait()[1]) == signal.SIGKILL
"""


def test_after_a_real_kill_at_a_write_the_same_command_goes_on(begun, tmp_path):
    folders = {shutil.copytree(begun, tmp_path / where): kill for where, kill in KILLS.items()}
    words = [str(word) for pair in folders.items() for word in pair]
    subprocess.run([sys.executable, "-c", KILLING, *words], check=True)  # noqa: S603 - its own script
    for folder in folders:
        left = {each.read_bytes() for each in folder.glob("run_002.parquet")}
        notes = record(folder, 3)
        assert "was killed" in notes[0]
        assert {each.read_bytes() for each in folder.glob("*unlisted.parquet")} == left
        assert len(notes) == 1 + len(left)
        for name in ("run_000.parquet", "run_001.parquet"):
            assert (folder / name).read_bytes() == (begun / name).read_bytes()
        assert len(bf.read(folder).recorded) == 3


def test_a_log_that_the_journal_does_not_list_is_kept_beside_and_said(begun):
    for content in (b"one", b"two"):
        (begun / "run_002.parquet").write_bytes(content)
        notes = record(begun, 2)
    assert notes == [
        "run_002.parquet is not in campaign.json: it is kept as run_002.unlisted_2.parquet, "
        "and not used."
    ]
    assert (begun / "run_002.unlisted.parquet").read_bytes() == b"one"
    assert (begun / "run_002.unlisted_2.parquet").read_bytes() == b"two"


def test_a_log_that_appears_while_a_run_is_recorded_is_kept_and_so_is_the_run(begun, tmp_path):
    (tmp_path / "mine").write_bytes(b"mine")
    with Folder(begun) as folder:
        (begun / "run_002.parquet").symlink_to(tmp_path / "mine")
        folder.add(recording(2), step(2))
    assert (tmp_path / "mine").read_bytes() == b"mine"
    assert (begun / "run_002.unlisted.parquet").is_symlink()
    assert len(bf.read(begun).recorded) == 3


def test_a_full_disk_is_said_before_anything_moves(tmp_path, monkeypatch):
    usage = SimpleNamespace(free=1e6)
    monkeypatch.setattr(module, "disk_usage", lambda _: usage)
    with pytest.raises(InputError, match=r"free space: got 1.0 MB; expected 10.0 MB"):
        Folder(tmp_path / "a").__enter__()
    assert not list(tmp_path.iterdir())


def test_what_an_earlier_campaign_left_is_said_with_the_answer_and_the_page_is_its_own(
    begun, monkeypatch
):
    def conduct(*given):
        folder = next(each for each in given if isinstance(each, Folder))
        folder.begin(folder.journal)
        return CampaignResult(
            journal=folder.journal, identified=None, reached=False, ending="no time"
        )

    monkeypatch.setattr(campaigns, "conduct", conduct)
    (begun / "run_002.parquet").write_bytes(b"")
    stale(begun)
    first, second = (bf.campaign("quickstart", out=begun) for _ in range(2))
    assert "was killed" in first.summary[-2]
    assert "kept as run_002.unlisted.parquet" in first.summary[-1]
    assert not any("unlisted" in line for line in second.summary)
    assert second.reports == (begun / "report.html",)


@pytest.mark.parametrize("fails", ["mkdir", "write_bytes"])
def test_a_folder_that_cannot_be_written_is_refused(tmp_path, monkeypatch, fails):
    def failing(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, fails, failing)
    with pytest.raises(InputError, match="Permission denied; expected a folder that can be"):
        Folder(tmp_path / "a").__enter__()


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="a file system that takes no files")
def test_a_file_system_that_takes_no_files_is_refused():
    with pytest.raises(InputError, match=r"out: got .*; expected a folder that can be written"):
        Folder(Path("/proc/campaign")).__enter__()


def test_a_file_or_a_circle_of_links_is_no_folder(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    for name in ("file", "circle"):
        with pytest.raises(InputError, match="out: got"):
            Folder(tmp_path / name).__enter__()


PAGE = (Path(__file__).parents[2] / "docs/campaign.md").read_text(encoding="utf-8")


def test_the_page_on_campaigns_quotes_what_is_refused(begun, tmp_path, monkeypatch):
    (tmp_path / "b").mkdir()
    (tmp_path / "b/notes.txt").touch()
    changes = {
        "report.html": written("report.html", b"mine"),
        "out: got a campaign": lambda path: stale(path, host="lab", process=4211),
        "campaign.lock": written(LOCK, b""),
        "campaign.json: content": DAMAGED["empty journal"][0],
        "campaign.json: schema": DAMAGED["another version"][0],
        "campaign.json: digest": DAMAGED["another limit"][0],
        "run_000": DAMAGED["the other log"][0],
        "manifest": DAMAGED["another mass"][0],
        "free space": lambda _: monkeypatch.setattr(
            module, "disk_usage", lambda _: SimpleNamespace(free=1e6)
        ),
    }
    folders = {tmp_path / "b": lambda _: None}
    folders |= {shutil.copytree(begun, tmp_path / name): change for name, change in changes.items()}
    messages = []
    for folder, change in folders.items():
        change(folder)
        with pytest.raises(InputError) as error:
            record(folder, 3)
        messages.append(str(error.value))
    section = PAGE.partition("## The folder")[2].partition("## Use")[0]
    quoted = re.findall(r"^\| `([^`]+)` \|", section, re.MULTILINE)
    assert [text in message for text, message in zip(quoted, messages, strict=True)] == [True] * 10


def test_runs_that_bring_less_than_half_of_what_was_expected_are_in_vain():
    def step(share, expected=None, name="p2", **more):
        about = {"what": "", "why": "", "added_mass": NO_ADDED_MASS, "seconds": 1.0}
        return Step(**about, shares={name: share} if share else {}, expected=expected, **more)

    def in_vain(*steps):
        return len(Journal(input_kind="torque", contact=Contact(1, 0.1), steps=steps).in_vain)

    assert in_vain(step(None), step(None)) == 2
    assert in_vain(step(8.0), step(3.9, 2.0)) == 0  # half of the way is to 4
    assert in_vain(step(8.0), step(4.1, 2.0), step(6.0, 1.0)) == 2
    assert in_vain(step(8.0), step(9.0, 2.0), step(1.0, 2.0)) == 0
    assert in_vain(step(8.0), step(9.0, 2.0), step(30.0, 2.0, "p1")) == 0  # the scale is known
    assert in_vain(step(8.0), step(9.0, 2.0), step(None, held_out=True)) == 1
