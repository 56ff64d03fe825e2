"""Write what the program prints into the pages of docs/: `make outputs`.

A page marks it so, the lines between as a quotation:

    <!-- output: butterfly identify my-robot | head 2 -->
    <!-- output needs xl330 as my-servo: butterfly inspect my-servo | grep all ok -->
    <!-- end -->

`head N` keeps the first N sentences, `grep TEXT` those that hold TEXT. Commands run in a folder
that holds the quick start's results (also as `my-robot`), or the logs that are needed from
BUTTERFLY_STRANGERS with the page's first manifest; without these the page stays as it was.
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
from pathlib import Path

DOCS = Path(__file__).parents[1]
PROGRAM = Path(sys.executable).with_name("butterfly")
MARK = re.compile(
    r"(?P<begin><!-- output(?: needs (?P<logs>\S+) as (?P<folder>\S+))?: "
    r"(?P<command>butterfly [^|\n]*) \| (?P<keep>head|grep) (?P<what>[^\n]*) -->\n)"
    r"(?P<shown>.*?)(?P<end><!-- end -->)",
    re.DOTALL,
)
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
def _strangers(logs: str, name: str, page: str) -> Path | None:
    """Make the folder of logs that a page describes, if these logs are here."""
    found = Path(os.environ.get("BUTTERFLY_STRANGERS", "nowhere")) / logs
    if not found.is_dir():
        return None
    folder = Path(tempfile.mkdtemp())
    shutil.copytree(found, folder / name)
    manifest = re.search(r"```yaml\n(.*?)```", page, re.DOTALL)
    if manifest:
        (folder / name / "manifest.yaml").write_text(manifest[1], encoding="utf-8")
    return folder


@cache
def _butterfly(command: str, folder: Path) -> str:
    ended = subprocess.run(  # noqa: S603 - our own program
        [PROGRAM, *shlex.split(command)], cwd=folder, capture_output=True, text=True, check=False
    )
    return ended.stdout + (ended.stderr if ended.returncode else "")


def quoted(mark: re.Match[str], page: str) -> str:
    """Return what stands between the marks, as the program prints it now."""
    if mark["logs"]:
        folder = _strangers(mark["logs"], mark["folder"], page)
        if folder is None:
            return mark["shown"]
    else:
        folder, _ = _quickstart()
    command = mark["command"].strip().removeprefix("butterfly ")
    said = _quickstart()[1] if command == "run quickstart" else _butterfly(command, folder)
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    if mark["keep"] == "head":
        kept = lines[: int(mark["what"])]
    else:
        kept = [line for line in lines if mark["what"] in line]
    if not kept:
        sys.exit(f"{mark['command']} prints nothing with {mark['what']!r}")
    return "\n>\n".join(f"> {line}" for line in kept) + "\n"


def written(page: str) -> str:
    """Return a page with what the program prints now."""
    return MARK.sub(lambda mark: f"{mark['begin']}{quoted(mark, page)}{mark['end']}", page)


if __name__ == "__main__":
    for path in sorted(DOCS.glob("*.md")):
        before = path.read_text(encoding="utf-8")
        if MARK.search(before):
            path.write_text(written(before), encoding="utf-8")
