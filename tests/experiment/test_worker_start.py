"""What a worker says if it cannot start: nothing where what it needs is gone, else its error."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("error", "told"),
    [
        *(("FileNotFoundError", False), ("EOFError", False), ("BrokenPipeError", False)),
        *(("ValueError", True), ("PermissionError", True)),
    ],
)
def test_a_worker_whose_parent_is_gone_ends_in_silence_and_any_other_says_why(error, told):
    program = f"import butterfly.experiment.worker_start; raise {error}('of the start')"
    words = [sys.executable, "-c", program]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603 - our own
    assert ended.returncode == 1
    assert ("of the start" in ended.stderr) == told
    assert told or ended.stderr == ""
