"""What the first run after installation compiles: every function, its seconds of CPU, and why.

`python -m tests.benchmarks.compilation` runs each command in a fresh folder with an empty cache of
kernels, and prints a table of its processes together: a function that two of them compile stands
there twice. Times are those of the machine, and of what else runs on it; the last line has the
total as a multiple of importing what the program needs, by which machines compare.
"""

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.benchmarks.kept import keep

ROOT = Path(__file__).parents[2]
QUICKSTART = ROOT / "experiments" / "quickstart.yaml"
IMPORTS = "import mujoco, scipy.optimize, numba, control, plotly, pydantic"
PROGRAM = "import sys; from butterfly.cli import main; sys.exit(main())"
MANIFEST = "results/quickstart/manifest.yaml"
COMMANDS = {
    "run": ("run", str(QUICKSTART)),
    "identify": ("identify", MANIFEST),
    "campaign": ("campaign", str(QUICKSTART), "--out", "results/campaign"),
}


def main():
    """Print a table for each command, or for those that are named."""
    imports = min(_cpu([sys.executable, "-c", IMPORTS], os.environ) for _ in range(3))
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        simulated = Path(folder) / "simulated"
        simulated.mkdir()
        _run(COMMANDS["run"], simulated, Path(folder) / "kernels")
        for name in sys.argv[1:] or COMMANDS:
            place = Path(folder) / name
            shutil.copytree(simulated, place, ignore=None if name == "identify" else _results)
            first, rows = _run(COMMANDS[name], place, place / "kernels")
            if name != "identify":
                shutil.rmtree(place / "results")
            again, _ = _run(COMMANDS[name], place, place / "kernels")
            _print(name, rows)
            compiled = sum(row["seconds"] for row in rows)
            lines.append(
                f"| {name} | {first:.1f} s, {first / imports:.1f} | {compiled:.1f} s, {len(rows)} "
                f"functions | {again:.1f} s, {again / imports:.1f} | {imports:.2f} s |"
            )
    heads = "| command | first: CPU, imports | of it compilation | again | an import |"
    table = "\n".join([heads, "|---" * 5 + "|", *lines])
    print(f"\n{table}")
    keep("compilation", table, "make compilation")


def _results(_, names):
    """Return what a command is to make itself, out of the names in a folder."""
    return {"results"} & {*names}


def _run(command, place, kernels):
    """Run a command in a folder; return its seconds of CPU and what its processes compiled."""
    notes = place / "notes"
    shutil.rmtree(notes, ignore_errors=True)
    notes.mkdir()
    paths = [str(Path(__file__).parent / "watched"), str(ROOT), os.environ.get("PYTHONPATH", "")]
    more = {
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        "NUMBA_CACHE_DIR": str(kernels),
        "BUTTERFLY_COMPILED": str(notes),
    }
    spent = _cpu([sys.executable, "-c", PROGRAM, *command], os.environ | more, place)
    return spent, [row for path in notes.iterdir() for row in json.loads(path.read_text())]


def _cpu(command, environment, place=None):
    """Return the seconds of CPU of a command and its children."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(  # noqa: S603
        command, cwd=place, env=environment, capture_output=True, text=True, check=False
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(f"{command}: {done.stdout}{done.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _print(name, rows):
    """Print a row for each function, the longest first."""
    print(f"\n| {name}: function | s | times | what it does | needed by |")
    print("| --- | --- | --- | --- | --- |")
    together = {}
    for row in rows:
        together.setdefault(row["function"], []).append(row)
    for function, some in sorted(
        together.items(), key=lambda item: -sum(row["seconds"] for row in item[1])
    ):
        callers = ", ".join(sorted({row["caller"].removeprefix("butterfly.") for row in some}))
        seconds = sum(row["seconds"] for row in some)
        said = some[0]["said"].rstrip(".")
        print(
            f"| {function.removeprefix('butterfly.')} | {seconds:.2f} | {len(some)} "
            f"| {said} | {callers} |"
        )


if __name__ == "__main__":
    main()
