"""Logs that several benchmarks share, and the table at their end."""

import os

import pytest

from butterfly.identification.data import read_data_set
from butterfly.identification.identify import identify
from tests.benchmarks import page
from tests.benchmarks.bars import ROWS, SHORT


def pytest_terminal_summary(terminalreporter):
    if ROWS:
        terminalreporter.section("measured, as ratios")
        terminalreporter.write_line(f"{page.table(ROWS.values())}\n\n{page.machine()}")
    if os.environ.get("BUTTERFLY_BENCH_WRITE") and (missing := page.write()):
        terminalreporter.write_line(f"the page is not written: no {', '.join(missing)}")
    if page.outdated():
        terminalreporter.write_line("the page is older than the code: docs/performance.md")


@pytest.fixture(scope="session")
def manifest(real_manifest):
    """The real logs; a third of them in the short bench."""
    logs = real_manifest.logs[2::3] if SHORT else real_manifest.logs
    return real_manifest.model_copy(update={"logs": logs})


@pytest.fixture(scope="session")
def real(manifest):
    """The default identification of those logs."""
    return identify(read_data_set(manifest))
