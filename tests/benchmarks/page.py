"""docs/performance.md, which `make bench` writes whole: what commands cost, ratios, machine, code.

The page is older than the code where the sources of identification, model, signals and plant are
others than those that were measured; comments and docstrings do not count.
"""

import ast
import hashlib
import os
import platform
import re
from datetime import date
from importlib.metadata import version
from pathlib import Path

from tests.benchmarks.bars import BARS, ROWS

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "performance.md"
TIMED = tuple(ROOT / "butterfly" / each for each in ("identification", "model", "signals", "plant"))
HEADS = ("what is measured", "found", "asked", "as a multiple of", "remark")
COSTS = []
"""CPU time in s, and peak memory in MB or None, of what was run once: (what, s, MB)."""

_TEXT = """# Performance

`make bench` writes this page. All is CPU time on one core, on the thesis's 41 logs (31 minutes at
1 kHz) where nothing else is said.

## Commands

With compiled kernels: the first command after an installation takes some 10 s more, to compile them
([first run](benches.md)).

{costs}

## Ratios

{ratios}

Measured {day}. {machine}

Code of identification, model, signals and plant: `{code}`.
"""


def machine():
    """Return the system and the versions that were measured with."""
    names = ("mujoco", "numba", "numpy", "scipy")
    packages = ", ".join(f"{name} {version(name)}" for name in names)
    system = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    return f"{system}; Python {platform.python_version()}, {packages}."


def code(folders=TIMED):
    """Return a hash of all modules' code, without comments and docstrings."""
    found = hashlib.sha256()
    for path in sorted(each for folder in folders for each in folder.rglob("*.py")):
        tree = _bare(ast.parse(path.read_bytes()))
        found.update(repr((path.name, tree)).encode())
    return found.hexdigest()[:16]


def _bare(node):
    """Return a syntax tree as tuples, without statements that are a text."""
    if isinstance(node, list):
        return [_bare(each) for each in node if not _is_text(each)]
    if not isinstance(node, ast.AST):
        return node
    fields = [(name, _bare(value)) for name, value in ast.iter_fields(node) if value != []]
    return type(node).__name__, fields


def _is_text(node):
    plain = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return plain and isinstance(node.value.value, str)


def outdated():
    """Return whether the page was measured with other code."""
    return f"`{code()}`" not in PAGE.read_text(encoding="utf-8")


def table(rows, heads=HEADS):
    """Return the rows as Markdown."""
    lines = [heads, ("---",) * len(heads), *([cell or "–" for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in lines)


def rows():
    """Return the rows of the page's table of ratios by what they are of."""
    text = PAGE.read_text(encoding="utf-8").partition(f"| {' | '.join(HEADS)} |")[2]
    cells = (re.split(r" *\| *", line)[1:-1] for line in text.splitlines() if line[:1] == "|")
    return {row[0]: (*row[:-1], row[-1].strip("–")) for row in list(cells)[1:]}


def write():
    """Write the page, if all was measured; return the names of what was not."""
    missing = [what for what in BARS if what not in ROWS]
    if not missing:
        costs = [(w, f"{s:.2g} s", f"{mb:.0f} MB" if mb else "") for w, s, mb in COSTS]
        parts = {
            "costs": table(costs, ("command", "CPU time", "peak memory")),
            "ratios": table(ROWS[what] for what in BARS),
            "day": date.today().isoformat(),
            "machine": machine(),
            "code": code(),
        }
        PAGE.write_text(_TEXT.format(**parts), encoding="utf-8")
    return missing
