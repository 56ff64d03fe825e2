"""A sweep that is stopped says what is done, keeps it, and leaves no process behind."""

import os
import re
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pytest
import yaml

from butterfly.cli.output import ExitCode

PROC = Path("/proc")
WAIT = 60.0  # s, for what must happen at some time
MARK = "BUTTERFLY_TEST_OF_STOPPING"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (PROC / "self/environ").exists(), reason="processes are seen in /proc"),
]


def _left(mark):
    """Numbers of the processes that were started with a mark."""
    found = []
    for entry in PROC.iterdir():
        try:
            own = entry.name.isdecimal() and mark.encode() in (entry / "environ").read_bytes()
        except OSError:  # it has ended, or is not ours
            continue
        if own:
            found.append(int(entry.name))
    return found


def _until(what):
    end = time.monotonic() + WAIT
    while not what():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.fixture
def sweep(quick, tmp_path):
    content = yaml.safe_load(quick.read_text())
    quick.write_text(yaml.safe_dump(content | {"sweep": {"repetitions": 40}}))
    return [sys.executable, "-m", "butterfly", "run", str(quick), "--out", str(tmp_path / "out")]


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_stopped_sweep_leaves_results_and_no_process(sweep, tmp_path, how):
    mark = uuid.uuid4().hex
    running = subprocess.Popen(  # noqa: S603
        [*sweep, "--jobs", "2"],
        env=os.environ | {MARK: mark},
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    _until(lambda: len(list((tmp_path / "out").glob("runs/*/*.json"))) > 2)
    running.send_signal(how)
    _, said = running.communicate(timeout=WAIT)
    _until(lambda: not _left(mark))
    if how is signal.SIGKILL:
        return
    assert running.returncode == ExitCode.STOPPED
    found = re.fullmatch(
        r"stopped: (\d+) of 40 runs are done; the same command goes on with the others\n", said
    )
    assert found
    assert len(list((tmp_path / "out").glob("runs/*/*.json"))) == int(found[1])
