"""A pytest plugin that prints where the tests' CPU time goes: `make profile`.

A test counts with the fixtures that it is the first to need and with the processes that it starts
and waits for. What numba compiles in the worker itself is listed apart.
"""

import json
import os
import time
from collections import Counter, defaultdict
from pathlib import Path

import pytest
from numba.core import event

LONG = 1.0
"""CPU seconds above which a test is listed."""


def cpu_time() -> float:
    """Return the CPU seconds of this process and of its children that ended."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


class _Compiling(event.Listener):
    """Adds up the CPU seconds of compilation."""

    def __init__(self):
        self.seconds, self._depth, self._begun = 0.0, 0, 0.0
        self.names = []

    def on_start(self, event):
        self.names.append(event.data["dispatcher"].py_func.__name__)
        if not self._depth:
            self._begun = time.process_time()
        self._depth += 1

    def on_end(self, event):  # noqa: ARG002
        self._depth -= 1
        if not self._depth:
            self.seconds += time.process_time() - self._begun


_COMPILING = _Compiling()
_SPENT = {}


def pytest_addoption(parser):
    parser.addoption("--profile-to", type=Path, help="JSON of each test's CPU and compile seconds")


def pytest_configure():
    event.register("numba:compile", _COMPILING)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item):
    begun, _COMPILING.names = (cpu_time(), _COMPILING.seconds), []
    item.spent = lambda: [cpu_time() - begun[0], _COMPILING.seconds - begun[1], _COMPILING.names]
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    report = yield
    report.spent = item.spent()  # until the end of this phase; the last is the teardown's
    return report


def pytest_runtest_logreport(report):
    if report.when == "teardown":
        _SPENT[report.nodeid] = report.spent


def pytest_terminal_summary(terminalreporter, config):
    if not _SPENT:
        return
    where = config.getoption("profile_to")
    if where:
        where.parent.mkdir(parents=True, exist_ok=True)
        where.write_text(json.dumps(_SPENT, indent=1))
    total, compiling, names = zip(*_SPENT.values(), strict=True)
    write = terminalreporter.write_line
    counts = Counter(name for each in names for name in each)
    write(f"CPU of {len(_SPENT)} tests: {sum(total):.0f} s, compiling {sum(compiling):.0f} s of it")
    write(f"Compiled by the workers: {counts.total()}: {dict(counts.most_common())}")
    folders = defaultdict(list)
    for test, (seconds, *_) in _SPENT.items():
        folders[test.partition("::")[0].rpartition("/")[0]].append(seconds)
    for folder, each in sorted(folders.items(), key=lambda row: -sum(row[1])):
        write(f"{sum(each):8.1f} s {len(each):5} tests  {folder}")
    for test, (seconds, compile_, _) in sorted(_SPENT.items(), key=lambda row: -row[1][0]):
        if seconds >= LONG:
            write(f"{seconds:8.2f} s {compile_:7.2f} s compiling  {test}")
