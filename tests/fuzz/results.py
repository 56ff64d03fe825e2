"""Damaged results of a sweep, and saved identifications, as the commands that look at them do."""

import json
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

from butterfly.experiment.record import RunRecord
from butterfly.experiment.source import Source
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep import plan_sweep, run_sweep
from tests.experiment.setting import HereEngine
from tests.fuzz.escape import escape_of, escape_of_command

_EXPERIMENT = """
extends: quickstart
name: fuzzed
added_masses: [{mass: 0.0, arm: 0.1}, {mass: 0.05, arm: 0.1}]
excitations: [{amplitude: 0.05, omega: 6.0}]
signals: []
duration: 6
method: linear
keep_signals: true
sweep: {grid: {plant.encoder.noise: [0.0, 1.0e-4]}}
"""
_LOOKS = (
    "inspect {0}",
    "inspect {0}/..",
    "inspect {0}/0",
    "compare {0}/0 {0}/1",
    "results clean {0} --failed",
)


@cache
def _sound() -> dict[str, bytes]:
    """Return the files of a folder of results, by their paths in it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fuzzed.yaml"
        path.write_text(_EXPERIMENT, encoding="utf-8")
        plan = plan_sweep(Source(path))
        run_sweep(plan, Path(folder) / "out", HereEngine())
        root = Path(folder) / "out"
        files = (each for each in root.rglob("*") if each.is_file())
        return {each.relative_to(root).as_posix(): each.read_bytes() for each in files}


def _kept_logs() -> dict[str, bytes]:
    """Return the files of the logs that one of the runs kept, by their names."""
    paths = [Path(each) for each in _sound() if each.endswith("manifest.yaml")]
    inside = (each for each in _sound() if Path(each).parent == paths[0].parent)
    return {Path(each).name: _sound()[each] for each in inside}


def sounds() -> list[tuple[bytes, Callable[[bytes, Path], str]]]:
    """Return each file of sound results, and what tells what escapes if it is damaged."""

    def teller(name: str) -> Callable[[bytes, Path], str]:
        return lambda content, path: _escapes(name, content, path)

    return [(content, teller(name)) for name, content in _sound().items()]


def _escapes(name: str, content: bytes, path: Path) -> str:
    """Damage one file of sound results, look at them by every command, and resume."""
    folder = path.with_suffix("")
    for each, sound in _sound().items():
        (folder / each).parent.mkdir(parents=True, exist_ok=True)
        (folder / each).write_bytes(content if each == name else sound)
    experiment = path.with_suffix(".yaml")
    experiment.write_text(_EXPERIMENT, encoding="utf-8")
    store = ResultStore(folder)
    found = [_resumed(name, store, experiment)]
    found += [escape_of_command(*look.format(folder).split()) for look in _LOOKS]
    return next(filter(None, found), "")


def _resumed(name: str, store: ResultStore, experiment: Path) -> str:
    """Tell whether a damaged record, or log that was kept, is not noticed on resuming."""
    tasks = plan_sweep(Source(experiment)).tasks
    to_do: list[bool] = []
    escape = escape_of(lambda: to_do.extend(store.complete(task.key) is None for task in tasks))
    missed = name.startswith("runs/") and not any(to_do) and not _same(name, store)
    return escape or (f"{name}: damaged, and resuming takes it for whole" if missed else "")


def _same(name: str, store: ResultStore) -> bool:
    """Tell whether a record says what it did, if with other blanks or digits."""
    if not name.endswith(".json"):
        return False
    sound = RunRecord.from_json(_sound()[name].decode())
    return sound is not None and store.read(sound.key) == sound


@cache
def saved() -> bytes:
    """Return a saved identification."""
    with tempfile.TemporaryDirectory() as folder:
        logs, file = Path(folder) / "logs", Path(folder) / "saved.json"
        for name, content in _kept_logs().items():
            logs.mkdir(exist_ok=True)
            (logs / name).write_bytes(content)
        escape_of_command("identify", logs, "--method", "weak-form", "--save", file)
        content = json.loads(file.read_bytes())
        del content["digest"]  # which would show all damage, and hide what comes behind
        return json.dumps(content, indent=1).encode()


def saved_escapes(content: bytes, path: Path) -> str:
    """Compare a damaged identification with a sound one, and show its model."""
    before, after = path.with_suffix(".before.json"), path.with_suffix(".after.json")
    before.write_bytes(saved())
    after.write_bytes(content)
    looks = [("compare", before, after), ("inspect", after)]
    return next(filter(None, (escape_of_command(*words) for words in looks)), "")
