"""docs/benches.md: what the benches of many robots printed, when, on what, and with which code.

A bench writes its part of the page where BUTTERFLY_BENCH_WRITE is set (`make coverage WRITE=1`).
"""

import os
import re
import sys
from datetime import UTC, datetime

from tests.benchmarks.page import ROOT, code, machine

PAGE = ROOT / "docs" / "benches.md"
_END = "<!-- end -->"


def keep(name, text, command):
    """Write what a bench printed to its part of the page, if there is one and it is wanted."""
    page = PAGE.read_text(encoding="utf-8")
    before, begin, rest = page.partition(f"<!-- bench: {name} -->\n")
    if begin and os.environ.get("BUTTERFLY_BENCH_WRITE"):
        today = datetime.now(tz=UTC).date().isoformat()
        made = f"`{command}`, {today}. {machine()} Code: `{code()}`."
        after = rest.partition(_END)[2]
        PAGE.write_text(f"{before}{begin}{made}\n\n{text.strip()}\n\n{_END}{after}", "utf-8")


def command():
    """Return the command that a bench was called by, as the Makefile has it."""
    target = sys.argv[0].rpartition("/")[2].removesuffix(".py")
    named = dict(zip(sys.argv[1::2], sys.argv[2::2], strict=False))
    words = [f"{key[2:].upper()}={value}" for key, value in named.items()]
    return " ".join(["make", {"before_fit": "forecasts"}.get(target, target), *words])


def parts():
    """Return what each bench printed, by name, below the line on how it was made."""
    found = re.findall(
        r"<!-- bench: ([\w-]+) -->\n(.*?)<!-- end -->", PAGE.read_text("utf-8"), re.S
    )
    return {name: tuple(part.partition("\n")[::2]) for name, part in found}
