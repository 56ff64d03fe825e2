"""Write what the program prints into the pages of docs/: `make outputs`.

A page marks it so, the lines between as a quotation:

    <!-- output: butterfly identify my-robot | head 2 -->
    <!-- output needs xl330 as my-servo: butterfly inspect my-servo | grep all ok -->
    <!-- end -->

`head N` keeps the first N sentences, `grep TEXT` those with TEXT, `table TEXT` the table from the
line with TEXT on. Commands run in a folder with the quick start's results (also as `my-robot`), or
with the logs needed from BUTTERFLY_STRANGERS and the page's manifests (none if `bare`); without
these logs the page stays as it was. `needs examples.NAME as FOLDER` runs that program for them, or
leaves the page as it was where the program's own libraries are not installed. `make outputs
PAGES=others-logs` writes one page.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from importlib.util import find_spec
from itertools import takewhile
from pathlib import Path

DOCS = Path(__file__).parents[1]
PROGRAM = Path(sys.executable).with_name("butterfly")
MARK = re.compile(
    r"(?P<begin><!-- output(?: needs (?P<logs>\S+) as (?P<folder>\S+?)(?P<bare> bare)?)?: "
    r"(?P<command>butterfly [^|\n]*) \| (?P<keep>head|grep|table) (?P<what>[^\n]*) -->\n)"
    r"(?P<shown>.*?)(?P<end><!-- end -->)",
    re.DOTALL,
)
MANIFESTS = ("manifest.yaml", "others.yaml")
"""Files that a page's blocks of YAML are written to, in this order."""
REHEARSED = "examples.record_sines"
"""The program whose drive is rehearsed: it writes one folder, and needs python-can."""
WRONG = "results/quickstart/wrong.yaml"


@cache
def quickstart() -> Path:
    """Run the quick start once, copy it as `my-robot`, and describe it with a wrong mass too."""
    folder = Path(tempfile.mkdtemp())
    printed("run quickstart --figures", folder)
    results = folder / "results/quickstart"
    text = (results / "manifest.yaml").read_text(encoding="utf-8")
    (folder / WRONG).write_text(text.replace("added_mass: 0.12", "added_mass: 0.13"), "utf-8")
    shutil.copytree(results, folder / "my-robot")
    return folder


@cache
def made(module: str) -> Path | None:
    """Let a program of examples/ write its folders of logs, if what it needs is installed."""
    if module == REHEARSED and find_spec("can") is None:
        return None
    folder = Path(tempfile.mkdtemp())
    where = ("--rehearse", "--out", folder / "logs") if module == REHEARSED else ("--out", folder)
    command = [sys.executable, "-m", module, *map(str, where)]
    subprocess.run(command, cwd=DOCS.parent, check=True, capture_output=True)  # noqa: S603 - our own
    return folder


@cache
def strangers(logs: str, name: str, manifests: tuple[str, ...]) -> Path | None:
    """Make the folder of logs that a page describes, if these logs are here."""
    source = Path(os.environ.get("BUTTERFLY_STRANGERS", "nowhere")) / logs
    if not source.is_dir():
        return None
    folder = Path(tempfile.mkdtemp())
    shutil.copytree(source, folder / name)
    for file, manifest in zip(MANIFESTS, manifests, strict=False):
        (folder / name / file).write_text(manifest, encoding="utf-8")
    return folder


def described(logs: str, name: str, page: str) -> Path | None:
    """Make the folder of logs that the manifests on a page describe, if these logs are here."""
    return strangers(logs, name, tuple(re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)))


@cache
def printed(command: str, folder: Path) -> str:
    """Return what a command prints in a folder, and why where it fails."""
    ended = subprocess.run(  # noqa: S603 - our own program
        [PROGRAM, *shlex.split(command)],
        cwd=folder,
        env=os.environ | {"COLUMNS": "100"},
        capture_output=True,
        text=True,
        check=False,
    )
    text = ended.stdout + (ended.stderr if ended.returncode else "")
    return text.replace(f"{folder.resolve()}/", "")


def quoted(mark: re.Match[str], page: str) -> str:
    """Return what stands between the marks, as the program prints it now."""
    if mark["logs"] and mark["logs"].startswith("examples."):
        folder = made(mark["logs"])
    elif mark["logs"]:
        folder = described(mark["logs"], mark["folder"], "" if mark["bare"] else page)
    else:
        folder = quickstart()
    if folder is None:
        return mark["shown"]
    command = mark["command"].strip().removeprefix("butterfly ")
    if command == "run quickstart":
        command = f"{command} --figures"  # which has run
    return as_shown(printed(command, folder), mark)


def as_shown(text: str, mark: re.Match[str]) -> str:
    """Return what a mark quotes of what was printed, as it stands on the page."""
    lines = _asked(text, mark["keep"], mark["what"])
    if not lines:
        sys.exit(f"{mark['command']} prints nothing with {mark['what']!r}")
    if mark["keep"] == "table":
        return "\n".join(["", *(f"    {line}".rstrip() for line in lines), "", ""])
    return "\n>\n".join(f"> {line}" for line in lines) + "\n"


def _asked(text: str, keep: str, what: str) -> list[str]:
    """Return the lines of what was printed that a mark asks for."""
    lines = text.splitlines()
    if keep == "table":
        first = next((k for k, line in enumerate(lines) if what in line), len(lines))
        return list(takewhile(str.strip, lines[first:]))
    lines = [line.strip() for line in lines if line.strip()]
    return lines[: int(what)] if keep == "head" else [line for line in lines if what in line]


def written(page: str) -> str:
    """Return a page with what the program prints now."""
    return MARK.sub(lambda mark: f"{mark['begin']}{quoted(mark, page)}{mark['end']}", page)


if __name__ == "__main__":
    for path in sorted(DOCS.glob("*.md")):
        before = path.read_text(encoding="utf-8")
        if MARK.search(before) and path.stem in (sys.argv[1:] or [path.stem]):
            path.write_text(written(before), encoding="utf-8")
