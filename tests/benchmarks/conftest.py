"""The table at the benchmarks' end, and the page."""

import os

from tests.benchmarks import page
from tests.benchmarks.bars import ROWS


def pytest_terminal_summary(terminalreporter):
    if ROWS:
        terminalreporter.section("measured, as ratios")
        terminalreporter.write_line(f"{page.table(ROWS.values())}\n\n{page.machine()}")
    if os.environ.get("BUTTERFLY_BENCH_WRITE") and (missing := page.write()):
        terminalreporter.write_line(f"the page is not written: no {', '.join(missing)}")
    if page.outdated():
        terminalreporter.write_line("the page is older than the code: docs/performance.md")
