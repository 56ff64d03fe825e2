"""Write what the program prints into the pages of docs/: `make outputs`.

A page marks it so, the lines between as a quotation:

    <!-- output: butterfly identify my-robot | head 2 -->
    <!-- output needs xl330 as my-servo: butterfly inspect my-servo | grep all ok -->
    <!-- end -->

`head N` keeps the first N sentences, `grep TEXT` those with TEXT, `table TEXT` the table from the
line with TEXT on. Commands run in a folder with the quick start's results (also as `my-robot`), or
with the logs needed from BUTTERFLY_STRANGERS and the page's manifests (none if `bare`); without
these logs the page stays as it was. `needs examples.NAME as FOLDER` runs that program for them.
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
WRONG = "results/quickstart/wrong.yaml"


@cache
def _quickstart() -> tuple[Path, str]:
    """Run the quick start once: where, and what it printed."""
    folder = Path(tempfile.mkdtemp())
    said = _butterfly("run quickstart", folder)
    results = folder / "results/quickstart"
    text = (results / "manifest.yaml").read_text(encoding="utf-8")
    (folder / WRONG).write_text(text.replace("added_mass: 0.12", "added_mass: 0.13"), "utf-8")
    shutil.copytree(results, folder / "my-robot")
    return folder, said


@cache
def made(module: str) -> Path:
    """Let a program of examples/ write its folders of logs."""
    folder = Path(tempfile.mkdtemp())
    command = [sys.executable, "-m", module, "--out", str(folder)]
    subprocess.run(command, cwd=DOCS.parent, check=True, capture_output=True)  # noqa: S603 - our own
    return folder


@cache
def _strangers(logs: str, name: str, manifests: tuple[str, ...]) -> Path | None:
    """Make the folder of logs that a page describes, if these logs are here."""
    found = Path(os.environ.get("BUTTERFLY_STRANGERS", "nowhere")) / logs
    if not found.is_dir():
        return None
    folder = Path(tempfile.mkdtemp())
    shutil.copytree(found, folder / name)
    for file, manifest in zip(MANIFESTS, manifests, strict=False):
        (folder / name / file).write_text(manifest, encoding="utf-8")
    return folder


@cache
def _butterfly(command: str, folder: Path) -> str:
    ended = subprocess.run(  # noqa: S603 - our own program
        [PROGRAM, *shlex.split(command)],
        cwd=folder,
        env=os.environ | {"COLUMNS": "100"},
        capture_output=True,
        text=True,
        check=False,
    )
    said = ended.stdout + (ended.stderr if ended.returncode else "")
    return said.replace(f"{folder.resolve()}/", "")


def quoted(mark: re.Match[str], page: str) -> str:
    """Return what stands between the marks, as the program prints it now."""
    if mark["logs"] and mark["logs"].startswith("examples."):
        folder = made(mark["logs"])
    elif mark["logs"]:
        manifests = () if mark["bare"] else re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
        folder = _strangers(mark["logs"], mark["folder"], tuple(manifests))
        if folder is None:
            return mark["shown"]
    else:
        folder, _ = _quickstart()
    command = mark["command"].strip().removeprefix("butterfly ")
    said = _quickstart()[1] if command == "run quickstart" else _butterfly(command, folder)
    kept = _kept(said, mark["keep"], mark["what"])
    if not kept:
        sys.exit(f"{mark['command']} prints nothing with {mark['what']!r}")
    if mark["keep"] == "table":
        return "\n".join(["", *(f"    {line}".rstrip() for line in kept), "", ""])
    return "\n>\n".join(f"> {line}" for line in kept) + "\n"


def _kept(said: str, keep: str, what: str) -> list[str]:
    """Return the lines of what was printed that a mark asks for."""
    lines = said.splitlines()
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
        if MARK.search(before):
            path.write_text(written(before), encoding="utf-8")
