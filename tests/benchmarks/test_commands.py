"""What commands cost on the 41 real logs, as processes of their own; docs/performance.md has it."""

import os

import pytest

from tests.benchmarks.bars import SHORT
from tests.benchmarks.cpu_time import of_process
from tests.benchmarks.page import COSTS

COMMANDS = (
    "inspect real-logs",
    "identify real-logs --save saved.json",
    "identify real-logs -m weak-form",
    "identify real-logs -m output-error",
    "identify real-logs --report page.html",
    "select real-logs -m output-error",
    "validate real-logs",
    "validate real-logs --bootstrap 200",
    "residual real-logs",
    "predict real-logs --with saved.json --bands",
    "compare real-logs",
    "design real-logs",
    "reproduce thesis",
    "run quickstart --out run",
)
SEARCHES = ("identify", "select", "validate", "predict")


@pytest.mark.skipif(SHORT or not hasattr(os, "wait4"), reason="takes minutes; of single children")
def test_every_command_ends(logs_folder, tmp_path, monkeypatch):
    monkeypatch.setenv("BUTTERFLY_LOGS", str(logs_folder))
    monkeypatch.chdir(tmp_path)
    for command in COMMANDS:
        words = command.split()
        to_the_end = ("--budget", "0") if words[0] in SEARCHES else ()
        cost = of_process("-m", "butterfly", *words, *to_the_end)
        COSTS.append((f"`butterfly {command}`", *cost))
        print(*COSTS[-1], flush=True)
