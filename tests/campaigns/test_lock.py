"""The lock of a campaign's folder: who holds it, who takes it, and what a kill leaves of it."""

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path

import pytest

from butterfly.campaigns import lock
from butterfly.campaigns.folder import Folder
from butterfly.campaigns.lock import LOCK, Holder, locked
from butterfly.errors import InputError
from butterfly.files import DRAFT
from tests.campaigns.folders import OURS, contents, record, refused, stale


def other_process(path, code="print('held', flush=True); input()"):
    """Start a process that holds the lock of a folder, and then runs this code."""
    script = (
        "import sys; from pathlib import Path\n"
        "from butterfly.campaigns.lock import locked\n"
        f"with locked(Path(sys.argv[1])):\n    {code}\n"
    )
    return subprocess.Popen(  # noqa: S603 - its own script
        [sys.executable, "-c", script, str(path / LOCK)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


@pytest.fixture
def holder(begun):
    """A process that holds the lock of the folder."""
    with other_process(begun) as process:
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_a_second_campaign_is_refused_by_the_name_of_the_first_until_that_ends(begun, holder):
    refused(begun, f"out: got a campaign of process {holder.pid} on {socket.gethostname()} in it")
    holder.communicate("\n")
    assert holder.returncode == 0
    assert record(begun, 3) == []


def test_the_lock_of_a_killed_campaign_is_said_and_taken(begun, holder):
    holder.kill()  # nobody has waited for it yet: a zombie
    os.waitid(os.P_PID, holder.pid, os.WEXITED | os.WNOWAIT)
    (note,) = record(begun, 3)
    assert note == (
        f"An earlier campaign in a was killed (process {holder.pid} on {socket.gethostname()}): "
        "its lock is taken over."
    )
    assert record(begun, 3) == []


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_leaves_no_lock(begun, how):
    handler = "import signal; signal.signal(signal.SIGTERM, signal.default_int_handler); "
    with other_process(begun, handler + "print('held', flush=True); input()") as process:
        process.stdout.readline()
        process.send_signal(how)
    assert set(contents(begun)) == OURS


def test_one_process_begins_one_campaign_at_a_time_and_an_error_leaves_no_lock(begun):
    with suppress(ZeroDivisionError), Folder(begun):
        refused(begun, f"process {os.getpid()}")
        _ = 1 / 0
    assert set(contents(begun)) == OURS


def test_a_process_that_got_the_number_of_a_killed_one_does_not_hold_its_lock(begun):
    stale(begun)
    assert "its lock is taken over" in record(begun, 3)[0]


def test_where_starts_are_unknown_the_number_alone_decides(begun, monkeypatch):
    monkeypatch.setattr(lock, "_state", lambda _: None)
    stale(begun, started=None)
    refused(begun, "a campaign of process")
    with other_process(begun / "nowhere") as ended:
        pass
    stale(begun, process=ended.pid, started=None)
    assert "its lock is taken over" in record(begun, 3)[0]


def test_the_lock_of_another_host_is_refused_with_how_to_remove_it(begun):
    stale(begun, host="elsewhere")
    refused(begun, f"on elsewhere in it; .*if no campaign runs there, remove {LOCK}")


@pytest.mark.parametrize("content", [b"", b"4711", b'{"host": "here", "process": -1}'])
def test_a_lock_that_says_nothing_is_refused_with_how_to_remove_it(begun, content):
    (begun / LOCK).write_bytes(content)
    refused(begun, f"{LOCK}: content: got no host and process; .* remove this file")


def test_a_lock_that_is_a_link_is_refused(begun, tmp_path):
    (begun / LOCK).symlink_to(tmp_path / "nowhere")
    refused(begun, f"{LOCK}: path: got a link")


def test_a_kill_while_a_stale_lock_is_taken_leaves_what_the_next_one_takes(begun):
    for name in (LOCK, f"{LOCK}.taken", f"{LOCK}.taken.taken"):
        stale(begun)
        (begun / LOCK).rename(begun / name)
    stale(begun)
    assert len(record(begun, 3)) == 1
    assert not list(begun.glob(f"{LOCK}*"))


def test_whoever_sees_a_stale_lock_too_late_does_not_take_the_new_one(begun, monkeypatch):
    stale(begun)
    seen, real = [], lock.holder_of

    def late(path):
        holder = real(path)
        if not seen and path.name == LOCK:  # between its first look and what it does then
            (begun / LOCK).write_bytes(json.dumps(asdict(Holder.here())).encode())
        seen.append(path)
        return holder

    monkeypatch.setattr(lock, "holder_of", late)
    with pytest.raises(InputError, match=f"process {os.getpid()}"), locked(begun / LOCK):
        pass
    assert real(begun / LOCK) == Holder.here()


TAKING = f"""
import sys
from pathlib import Path
from butterfly.campaigns import lock
from butterfly.errors import InputError
own, read = sys.argv[1], lock.holder_of

def outcomes(folder, *kinds):
    return sum(len(list(folder.glob(kind + "*"))) for kind in kinds)

def read_with_all(path):  # nobody does anything before all have seen the stale lock
    holder, seen = read(path), path.with_name("seen" + own)
    if not seen.exists():
        seen.touch()
        while outcomes(path.parent, "seen") < 3:
            pass
    return holder

lock.holder_of = read_with_all
for folder in map(Path, sys.argv[2:]):
    try:
        with lock.locked(folder / {LOCK!r}):
            (folder / f"took{{own}}").touch()
            while outcomes(folder, "took", "refused") < 3:
                pass
    except InputError:
        (folder / f"refused{{own}}").touch()
"""


def test_of_three_processes_that_take_a_stale_lock_at_once_one_does(tmp_path):
    folders = [tmp_path / str(number) for number in range(8)]
    for folder in folders:
        folder.mkdir()
        stale(folder)
    with ExitStack() as running:
        for own in "abc":
            words = [sys.executable, "-c", TAKING, own, *map(str, folders)]
            process = running.enter_context(subprocess.Popen(words))  # noqa: S603 - its own script
            running.callback(process.kill)
            running.callback(process.wait, 30)
    assert [len(list(folder.glob("took*"))) for folder in folders] == [1] * len(folders)
    assert not [*tmp_path.rglob(f"{LOCK}*"), *tmp_path.rglob(f"{DRAFT}*")]


def test_without_hard_links_the_lock_is_made_all_the_same(begun, monkeypatch):
    def none(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "hardlink_to", none)
    with Folder(begun):
        assert Holder.here() == lock.holder_of(begun / LOCK)
        refused(begun, f"process {os.getpid()}")
    assert set(contents(begun)) == OURS
