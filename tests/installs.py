"""Wheel and source distribution, installed by each tool on each Python that can be had here.

Built once, checked, installed into empty environments outside the checkout, and used there: both
commands, a quick start, tests that come out of the source distribution. A table says what could
not be done, and why.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = ROOT / "pyproject.toml"
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
TESTS = (
    *("tests/signals", "tests/logs/test_csv.py", "tests/logs/test_mat.py"),
    *("tests/logs/test_matlab_variables.py", "tests/test_butterfly_testbed.py"),
)
TOOLS = ("hypothesis", "pytest", "pyyaml")
EXTRAS = ("can", "excel", "hdf5", "matlab", "mcap", "pandas")
COLUMNS = ("Python", "versions", "quick start", "tests", "pip, sdist", "uv tool", "pipx")
NAME, NO = "butterfly-testbed", "no: "
_LONGEST = 90  # characters of a reason


class FailedError(Exception):
    """A command failed; the last line that it printed says why."""


def run(*words: object, cwd: Path | None = None, **environment: str) -> str:
    """Run a command; return what it printed."""
    clean = {name: text for name, text in os.environ.items() if name != "PYTHONPATH"}
    ended = subprocess.run(  # noqa: S603 - ours
        [*map(str, words)],
        cwd=cwd,
        env=clean | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    if ended.returncode:
        lines = [line.strip() for line in ended.stdout.splitlines() if line.strip()]
        reasons = [line for line in lines if line.startswith(("error", "E ", "FAILED", "×"))]
        raise FailedError([f"exit code {ended.returncode}", *lines, *reasons][-1][:_LONGEST])
    return ended.stdout


def python_of(version: str, uv: str) -> str:
    """Return an interpreter of a version: of the path, of pyenv, or one that uv can install."""
    named = [
        shutil.which(f"python{version}"),
        *Path.home().glob(f".pyenv/versions/{version}.*/bin/python"),
    ]
    for candidate in filter(None, named):
        try:
            run(candidate, "-c", "import sys, venv")
        except (FailedError, OSError):
            continue
        return str(candidate)
    run(uv, "python", "install", version)
    return run(uv, "python", "find", version).strip()


def built(uv: str, place: Path) -> tuple[Path, Path]:
    """Build wheel and source distribution, and check what they say of themselves."""
    run(uv, "build", "--out-dir", place, ROOT)
    (wheel,), (source,) = place.glob("*.whl"), place.glob("*.tar.gz")
    print(run(uv, "tool", "run", "twine", "check", "--strict", wheel, source).strip())
    return wheel, source


def attempt(what: Callable[[], str]) -> str:
    """Return what something answers, or why it failed."""
    try:
        return what()
    except (FailedError, FileNotFoundError) as error:
        return f"{NO}{error}"


def on_python(
    version: str, *, uv: str, wheel: Path, source: Path, place: Path, asked: Sequence[str]
) -> list[str]:
    """Return a row of the table: all that is tried on a Python, with the tests asked for."""
    python = python_of(version, uv)
    lowest = version == VERSIONS[0]
    own = place / "wheel"
    elsewhere = place / "elsewhere"
    elsewhere.mkdir(parents=True)
    run(uv, "venv", "--quiet", "--python", python, own)
    binaries = own / ("Scripts" if os.name == "nt" else "bin")

    def by_wheel() -> str:
        install = (uv, "pip", "install", "--quiet", "--no-build", "--python", own)
        if lowest:  # of what the project itself declares: a wheel's requirements are not direct
            install = (*install, "--resolution", "lowest-direct", "--requirement", PROJECT)
            run(*install)
            run(uv, "pip", "install", "--quiet", "--no-deps", "--python", own, wheel)
        else:
            run(*install, wheel)
        for command in ("butterfly", "butterfly-testbed"):
            run(binaries / command, "--version", cwd=elsewhere)
        more: dict[str, tuple[str, ...]] = {
            extra: ("--extra", extra) if lowest else (f"{NAME}[{extra}] @ {wheel.as_uri()}",)
            for extra in EXTRAS
        }
        done = {extra: attempt(partial(run, *install, *words)) for extra, words in more.items()}
        without = [extra for extra, answer in done.items() if answer.startswith(NO)]
        missing = f", without {', '.join(without)} (no wheels)" if without else ""
        return f"{'lowest' if lowest else 'newest'}{missing}"

    def quick_start() -> str:
        out = ("--force", "--out", "run")
        text = run(binaries / "butterfly", "run", elsewhere / "two-logs.yaml", *out, cwd=elsewhere)
        verdict = next(line for line in text.splitlines() if line.startswith("Good: "))
        return verdict.partition(";")[0]

    def tests() -> str:
        run(uv, "pip", "install", "--quiet", "--python", own, *TOOLS)
        with tarfile.open(source) as parts:
            parts.extractall(elsewhere, filter="data")
        (sources,) = elsewhere.glob("butterfly_testbed-*")
        for name in ("butterfly", "butterfly_testbed", "models", "experiments"):
            shutil.rmtree(sources / name)  # those of the wheel are tested
        # An old Matplotlib calls what a new pyparsing has renamed.
        announced = f"{'default' if lowest else 'error'}::DeprecationWarning"
        quiet = ("-q", "-p", "no:cacheprovider", "-m", "not slow", "-W", announced, *asked)
        text = run(binaries / "python", "-m", "pytest", *quiet, cwd=sources)
        return text.strip().splitlines()[-1].partition(" in ")[0]

    def by_pip() -> str:
        run(python, "-m", "venv", place / "pip")
        pip = place / "pip" / binaries.name
        run(pip / "python", "-m", "pip", "install", "--quiet", source)
        return run(pip / "butterfly-testbed", "--version", cwd=elsewhere).strip()

    def by_uv_tool() -> str:
        folders = {"UV_TOOL_DIR": str(place / "tools"), "UV_TOOL_BIN_DIR": str(place / "tool-bin")}
        run(uv, "tool", "install", "--quiet", "--python", python, wheel, **folders)
        return run(place / "tool-bin/butterfly", "--version", cwd=elsewhere).strip()

    def by_pipx() -> str:
        folders = {"PIPX_HOME": str(place / "pipx"), "PIPX_BIN_DIR": str(place / "pipx-bin")}
        call = (uv, "tool", "run", "pipx", "install", "--python", python, wheel)
        run(*call, **folders)
        return run(place / "pipx-bin/butterfly", "--version", cwd=elsewhere).strip()

    shutil.copy(ROOT / "tests/data/two-logs.yaml", elsewhere)
    tried = (by_wheel, quick_start, tests, by_pip, by_uv_tool, by_pipx)
    exact = run(python, "-c", "import platform; print(platform.python_version())").strip()
    return [exact, *map(attempt, tried)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table; end with 1 if something failed on a Python that is there."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", default=VERSIONS, choices=VERSIONS)
    parser.add_argument("--tests", nargs="+", default=TESTS, help="of the source distribution")
    parser.add_argument("--uv", default=shutil.which("uv") or "uv")
    asked = parser.parse_args(arguments)
    rows = [COLUMNS, tuple("---" for _ in COLUMNS)]
    with tempfile.TemporaryDirectory() as folder:
        wheel, source = built(asked.uv, Path(folder) / "dist")
        for version in asked.only:
            place = Path(folder) / version
            try:
                row = on_python(
                    version,
                    uv=asked.uv,
                    wheel=wheel,
                    source=source,
                    place=place,
                    asked=asked.tests,
                )
            except FailedError as error:
                row = [version, f"not tried, no such Python here: {error}"]
            rows.append(tuple([*row, *[""] * len(COLUMNS)][: len(COLUMNS)]))
            print(*row, sep=" | ", flush=True)
            shutil.rmtree(place, ignore_errors=True)
    print(*(f"| {' | '.join(row)} |" for row in rows), sep="\n")
    sys.exit(any(cell.startswith(NO) for row in rows for cell in row))


if __name__ == "__main__":
    main()
