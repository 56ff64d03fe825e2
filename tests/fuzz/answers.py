"""Files with an answer, which are damaged: what is still read of them, and what then is answered.

An outcome is one word, its details behind a colon: *refused*; *same*; *said*, where the verdict is
worse or a sentence is new; *covered*, where of each parameter the interval before or after the
damage has the other value; *cells*, where some samples have other values of the column's range,
which nobody can know; *stated*, where a value in a manifest is another one that a person may have
written; and *silent*, whatever else is answered differently.
"""

import json
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import scipy.io
from pyarrow import parquet

import butterfly as bf
from butterfly.campaigns.bench import Contact, Recording
from butterfly.campaigns.folder import JOURNAL, Folder, Journal, Step
from butterfly.errors import InputError
from butterfly.logs.log import InputKind, Log
from butterfly.logs.parquet import parquet_bytes
from butterfly.model.parameters import AddedMass
from butterfly.verdict import Level
from butterfly.yaml_files import load_yaml
from tests.fuzz.escape import escape_of
from tests.independent.integrator import Joint, motion
from tests.logs.written import mat73, put73, write_bag, write_sheets

_FORMS = ("csv", "json", "npz", "npy", "parquet", "mat", "mat73", "xlsx", "mcap")
KINDS = tuple(f"answer-{each}" for each in (*_FORMS, "manifest", "journal", "saved"))
"""Their names."""

OUTCOMES = ("refused", "same", "said", "covered", "cells", "stated")
"""Outcomes that are no escape."""


def is_escape(outcome: str) -> bool:
    """Whether what came of a damaged file, of any kind, is neither an answer nor a line."""
    return outcome.partition(":")[0] not in ("", *OUTCOMES)


_FEW = 16  # samples that one misfortune can reach, as it changes bytes
_SAMPLES = 800
_KNOWN = {"p4": 0.05}
Table = dict[str, np.ndarray[Any, Any]]


@dataclass(frozen=True)
class StatedAnswer:
    """An answer: its values with their intervals, its level, its sentences, and what was read."""

    values: dict[str, tuple[float, float, float]]
    level: int
    sentences: frozenset[str]
    read: tuple[Table, ...] = ()


@cache
def _motion(added: float = 0.0) -> Table:
    """Time, input and angle of a joint that follows three sines, with a noisy encoder."""
    rng = np.random.default_rng(7)
    time = np.round(0.005 * np.arange(_SAMPLES), 4)
    inputs = np.round(sum(np.sin(w * time + w) for w in (3.0, 5.0, 7.3)), 4)
    joint = Joint(inertia=0.011 + added * 0.01, viscous=0.01, gravity=0.3 + added, gain=0.05)
    angles, _ = motion(joint, time, inputs, 0.1)
    return {
        "time": time,
        "input": inputs,
        "angle": np.round(angles + 1e-4 * rng.normal(size=time.size), 5),
    }


def _csv(table: Table) -> bytes:
    rows = np.column_stack(list(table.values())).tolist()
    lines = ["time [s],input [V],angle [rad]", *(",".join(map(repr, row)) for row in rows)]
    return "\n".join([*lines, ""]).encode()


def _files() -> Iterator[tuple[str, bytes]]:
    """Yield the log in each format, by ending."""
    table = _motion()
    matrix = np.column_stack(list(table.values()))
    columns = {name: values[:, None] for name, values in table.items()}
    yield ".csv", _csv(table)
    yield ".json", json.dumps({name: each.tolist() for name, each in table.items()}).encode()
    for save in (np.savez, np.savez_compressed):
        save(file := BytesIO(), **table)
        yield ".npz", file.getvalue()
    np.save(file := BytesIO(), matrix)
    yield ".npy", file.getvalue()
    yield ".parquet", parquet_bytes(Log(**table, input_kind=InputKind.VOLTAGE))
    for packing in ("snappy", "none"):
        parquet.write_table(pa.table(table), file := BytesIO(), compression=packing)
        yield ".parquet", file.getvalue()
    for packed in (False, True):
        scipy.io.savemat(file := BytesIO(), columns, do_compression=packed)
        yield ".mat", file.getvalue()
    with mat73(file := BytesIO()) as root:
        put73(root, columns)
    yield ".73.mat", file.getvalue()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.xlsx"
        write_sheets(path, {"a": [[*table], *matrix[:400].tolist()]})
        yield ".xlsx", path.read_bytes()
    parts = {"effort": table["input"], "position": table["angle"], "velocity": 0 * table["time"]}
    stamps = np.rint(table["time"] * 1e9).astype(int)
    write_bag(file := BytesIO(), stamps, {name: each[:, None] for name, each in parts.items()})
    yield ".mcap", file.getvalue()


def sounds(kind: str) -> list[tuple[bytes, Callable[[bytes, Path], str]]]:
    """Return sound files of a kind, each with what says how a damaged one is answered."""
    form = kind.removeprefix("answer-")
    if form in _FOLDERS:
        return _FOLDERS[form]()
    endings = {"mat73": ".73.mat"}
    wanted = endings.get(form, f".{form}")
    found = [each for each in _files() if each[0] == wanted]
    return [(content, partial(_log_outcome, wanted, content)) for _, content in found]


def _log_outcome(ending: str, sound: bytes, content: bytes, path: Path) -> str:
    path = path.with_name(f"{path.name}{ending}")
    return _outcome(partial(_of_log, ending), sound, content, path)


def _of_log(ending: str, path: Path) -> bf.DataSet:
    """Read a log."""
    about: dict[str, Any] = {"known": _KNOWN, "input": "voltage"}
    if ending == ".npy":
        about["columns"] = {"time": 0, "input": 1, "angle": 2}
    elif ending == ".mcap":
        about["input"] = "torque"
    elif ending != ".csv":
        about["columns"] = {name: name for name in _motion()}
    return bf.read(path, **about)


def _read(data: bf.DataSet) -> tuple[Table, ...]:
    return tuple({"time": g.time, "input": g.input, "angle": g.angle} for g in data.recorded)


def _told(data: bf.DataSet) -> StatedAnswer:
    """Identify from logs."""
    found = bf.identify(data, "weak-form", terms=())
    said = {*found.notes, *(sentence for each in data.health for sentence in each.findings)}
    return _of_estimate(found, said, _read(data))


def _of_estimate(
    found: bf.Identification, said: Iterable[str], read: tuple[Table, ...]
) -> StatedAnswer:
    estimate, level = found.estimate, [*Level].index(found.judged.level)
    rows = zip(estimate.values, estimate.lower, estimate.upper, strict=True)
    values = {name: (*map(float, r),) for name, r in zip(estimate.names, rows, strict=True)}
    return StatedAnswer(values, level, frozenset(map(_wording, said)), read)


def _wording(sentence: str) -> str:
    """Return a sentence without its numbers, which are others in any other answer."""
    return re.sub(r"[-+]?\d[\d.,e+-]*", "0", sentence)


_ANSWERS: dict[tuple[str, bytes], StatedAnswer] = {}


def _outcome(read: Callable[[Path], bf.DataSet], sound: bytes, content: bytes, path: Path) -> str:
    """Read a damaged file, identify where it has other samples or is a manifest, and compare."""
    key = (path.suffix, sound)
    if key not in _ANSWERS:
        path.write_bytes(sound)
        _ANSWERS[key] = _told(read(path))
    before, after = _ANSWERS[key], list[StatedAnswer]()
    path.write_bytes(content)

    def answered() -> None:
        data = read(path)
        same = path.suffix != ".yaml" and _same(before.read, _read(data))
        after.append(before if same else _told(data))

    return escape_of(answered) or (compared(before, after[0]) if after else "refused")


def compared(before: StatedAnswer, after: StatedAnswer) -> str:
    """Return the outcome for an answer from a damaged file."""
    if _same(before.read, after.read) and before.values == after.values:
        return "same"
    if after.level > before.level or not after.sentences <= before.sentences:
        return "said"
    if set(before.values) != set(after.values):
        return "silent: other parameters"
    apart = [name for name in before.values if _apart(before.values[name], after.values[name])]
    if not apart:
        return "covered"
    if _in_cells(before.read, after.read):
        return "cells"
    sizes = [len(each["time"]) for each in after.read]
    return f"silent: {', '.join(apart)}; {sizes} samples; {_changes(before.read, after.read)}"


def _apart(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    """Whether neither interval has the other value."""
    (a, a_low, a_high), (b, b_low, b_high) = one, other
    return not (a_low <= b <= a_high or b_low <= a <= b_high)


def _same(one: tuple[Table, ...], other: tuple[Table, ...]) -> bool:
    return len(one) == len(other) and all(
        np.array_equal(a[name], b[name], equal_nan=True)
        for a, b in zip(one, other, strict=True)
        for name in a
    )


def _in_cells(one: tuple[Table, ...], other: tuple[Table, ...]) -> bool:
    """Whether a few samples differ, by values that the column has too."""
    if [len(each["time"]) for each in one] != [len(each["time"]) for each in other]:
        return False
    for a, b in zip(one, other, strict=True):
        for name, values in a.items():
            changed = b[name][b[name] != values]
            inside = (changed >= values.min()) & (changed <= values.max())
            if changed.size > _FEW or not inside.all():
                return False
    return True


def _changes(one: tuple[Table, ...], other: tuple[Table, ...]) -> str:
    """Say how many samples of each column differ, and by what at most."""
    if [len(each["time"]) for each in one] != [len(each["time"]) for each in other]:
        return "another length"
    found = [
        f"{name}: {np.count_nonzero(a[name] != b[name])} by {np.abs(a[name] - b[name]).max():.3g}"
        for a, b in zip(one, other, strict=True)
        for name in a
        if not np.array_equal(a[name], b[name])
    ]
    return "; ".join(found)


def _manifests() -> list[tuple[bytes, Callable[[bytes, Path], str]]]:
    """Return manifests of two logs with a mass each."""
    lines = [
        "name: bench",
        "input: voltage",
        "arm: 0.1",
        "known: {p4: 0.05}",
        "units: {angle: rad, time: s}",
        "columns: {time: time, input: input, angle: angle}",
        "repair: [duplicate]",
        "logs:",
        "  - {file: a.csv, added_mass: 0}",
        "  - {file: b.csv, added_mass: 0.05}",
        "  - {file: c.csv, added_mass: 0.05, from: 0.5, to: 5.5}",
        "",
    ]
    sound = "\n".join(lines).encode()
    return [(sound, partial(_manifest_outcome, sound))]


def _manifest_outcome(sound: bytes, content: bytes, path: Path) -> str:
    folder = path.with_name("bench")
    if not folder.exists():
        folder.mkdir()
        mass = 0.05 * 9.81 * 0.1
        for name, added in (("a", 0.0), ("b", mass), ("c", mass)):
            text = _csv(_motion(added)).replace(b" [s]", b"").replace(b" [V]", b"")
            (folder / f"{name}.csv").write_bytes(text.replace(b" [rad]", b""))
    outcome = _outcome(bf.read, sound, content, folder / "manifest.yaml")
    return (
        f"stated: {outcome}"
        if outcome.startswith("silent") and _stated(sound, content)
        else outcome
    )


def _stated(sound: bytes, content: bytes) -> bool:
    """Whether the damage put another value in the place of one, with all keys as they were."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "m.yaml"
        shapes = []
        for each in (sound, content):
            path.write_bytes(each)
            shapes.append(_shape(load_yaml(path).content))
    return shapes[0] == shapes[1]


def _shape(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _shape(value) for key, value in content.items()}
    return [*map(_shape, content)] if isinstance(content, list) else None


def _journals() -> list[tuple[bytes, Callable[[bytes, Path], str]]]:
    """Return the files of a campaign's folder, of two runs; the journal three times."""
    with tempfile.TemporaryDirectory() as place:
        root = Path(place) / "campaign"
        _campaign(root)
        files = {each.name: each.read_bytes() for each in root.iterdir() if each.is_file()}
    names = [JOURNAL, JOURNAL, *sorted(files)]
    return [(files[name], partial(_journal_outcome, name, files)) for name in names]


def _campaign(root: Path) -> None:
    run = Recording(*_motion().values(), "", InputKind.VOLTAGE)
    with Folder(root) as folder:
        folder.begin(Journal(input_kind=InputKind.VOLTAGE, contact=Contact(1, 0.1), known=_KNOWN))
        for added in (AddedMass(), AddedMass(mass=0.05, arm=0.1)):
            shares = {"p1": 0.02, "p3": 0.01}
            about: dict[str, Any] = {"why": "first", "verdict": "good", "shares": shares}
            step = Step(what="sines", kind="sines", added_mass=added, seconds=6.0, **about)
            folder.add(run, step)
            folder.conclude(step)


def _journal_outcome(name: str, files: dict[str, bytes], content: bytes, path: Path) -> str:
    """Go on with a campaign one of whose files is damaged, and tell what it takes for done."""
    root = path.with_name("campaign")
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir()
    told = []
    for some in (files[name], content):
        for each, sound in files.items():
            (root / each).write_bytes(some if each == name else sound)
        for each in root.glob("*.unlisted*"):
            each.unlink()

        def entered() -> None:
            with Folder(root) as folder:
                told.append((folder.is_begun and folder.journal, folder.is_begun and folder.data()))

        if escape := escape_of(entered):
            return escape
    if len(told) == 1:
        return "refused"
    (journal, data), (other, others) = told
    if journal != other or not _same(_read(data), _read(others)):
        return f"silent: {name}: another journal, or other logs"
    return "same"


def _saved() -> list[tuple[bytes, Callable[[bytes, Path], str]]]:
    """Return a saved identification."""
    with tempfile.TemporaryDirectory() as place:
        log, saved = Path(place) / "a.csv", Path(place) / "saved.json"
        log.write_bytes(_csv(_motion()))
        found = bf.identify(bf.read(log, known=_KNOWN), "weak-form", terms=())
        found.save(saved)
        content = saved.read_bytes()
    return [(content, partial(_saved_outcome, content))]


def _saved_outcome(sound: bytes, content: bytes, path: Path) -> str:
    """Load a damaged result, and compare."""
    path, told = path.with_name("saved.json"), list[StatedAnswer]()

    def loaded() -> None:
        found = bf.load(path)
        if not isinstance(found, bf.Identification):
            raise InputError(path, "schema", found.kind, "an identification")
        told.append(_of_estimate(found, found.notes, ()))

    for some in (sound, content):
        path.write_bytes(some)
        if escape := escape_of(loaded):
            return escape
    return compared(*told) if len(told) > 1 else "refused"


_FOLDERS = {"manifest": _manifests, "journal": _journals, "saved": _saved}
