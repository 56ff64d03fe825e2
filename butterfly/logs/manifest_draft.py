"""Manifests of logs that come without one, from their files' names and what else is given."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from butterfly.errors import InputError
from butterfly.logs.formats import ENDINGS, FORMATS, OFTEN_TEXTS, holds_table
from butterfly.logs.log import InputKind, Log
from butterfly.logs.manifest import MANIFEST_NAME, LogEntry, Manifest, described, manifest_text
from butterfly.logs.reading import read_entry
from butterfly.logs.units import Units
from butterfly.model.prior import known_of

_THESIS_NAME = re.compile(r"Data_(\d+(?:_\d+)?)__(\d+(?:_\d+)?)__0(\d+)")
_QUESTIONS = {
    "input": "what does the input command: voltage, torque, current, duty, or the setpoint of a "
    "servo (which needs its loop)? The files do not say.",
    "intersample": "how does the input go between two samples, held (zero_order_hold) or in a line "
    "(first_order_hold)? The files do not say.",
    "columns": "which columns hold time, input and angle, by name or number? None is called so. "
    "Taken for the first three, in this order.",
    "logs": "what was added in each log (added_mass in kg, arm in m), and omega and amplitude of a "
    "sine? The names of the files do not say.",
}
_FIRST_THREE = {"time": 0, "input": 1, "angle": 2}
_INDEX = {"", "index", "Unnamed: 0"}  # names of a column in front that numbers rows
_DIGITS = 12  # of a number in another unit: the last ones are those of rounding


def draft(path: Path, given: Mapping[str, Any], *, massless: bool = False) -> Manifest:
    """Return the manifest of a log, or of all logs below a folder, that come without one.

    ``given`` is what `checked_options` found. Masses and sines are those of the thesis's names,
    ``Data_<grams>__<rad/s>__<0amplitude>``: ``_`` stands for a decimal point within a number, and
    the amplitude's point follows its first 0, so that ``Data_120_5__3_5__0015.mat`` is 120.5 g,
    3.5 rad/s, 0.015. Without an arm the mass of a single log is left out, and so are all those of a
    folder if it may be ``massless``. By any other name nothing was added.
    """
    units, folder = Units.of(given.get("units")), path
    if not path.is_dir():
        folder = path.parent
        entry = _entry_by_name(path, folder, units) or LogEntry(file=path.name)
        entries = [entry if "arm" in given else entry.model_copy(update={"added_mass": 0.0})]
    elif not has_thesis_names(path) or (massless and "arm" not in given):
        entries = _entries(path)
    elif "arm" in given:
        entries = _entries_by_name(path, units)
    else:
        expected = "a manifest, or the arm (--arm) in m of the masses in the names of the files"
        raise InputError(path, MANIFEST_NAME, "no such file", expected)
    name = path.resolve().name if path.is_dir() else path.name
    return of_logs(name, folder, entries, given)


def _entries_by_name(folder: Path, units: Units) -> list[LogEntry]:
    entries = []
    for path in log_files(folder):
        entry = _entry_by_name(path, folder, units)
        if entry is not None:
            entries.append(entry)
        elif path.suffix.lower() not in OFTEN_TEXTS:
            expected = "Data_<grams>__<rad/s>__<0amplitude>, or a manifest"
            raise InputError(path, "file name", path.stem, expected)
    return sorted(entries, key=lambda each: (known_of(each.added_mass).value, each.omega or 0.0))


def _entries(folder: Path) -> list[LogEntry]:
    """Return an entry for each log; files that are often other texts are if they hold a table."""
    paths = [
        path
        for path in log_files(folder)
        if path.suffix.lower() not in OFTEN_TEXTS or holds_table(path)
    ]
    if not paths:
        raise InputError(folder, "path", f"no {ENDINGS} file with a table", "a folder of logs")
    return [LogEntry(file=path.relative_to(folder).as_posix()) for path in paths]


def of_logs(
    name: str, root: Path, entries: Collection[LogEntry], given: Mapping[str, Any]
) -> Manifest:
    """Return the manifest of some logs; the input is a voltage unless given otherwise."""
    content = {"name": name, "root": str(root.resolve()), "logs": list(entries)}
    return described(content, {"input": InputKind.VOLTAGE} | dict(given))


def with_columns(manifest: Manifest) -> Manifest:
    """Return a manifest by which its first log can be read, if it can: by the first columns."""
    numbered = manifest.model_copy(update={"columns": _FIRST_THREE})
    if manifest.columns is not None or _read(manifest) or (log := _read(numbered)) is None:
        return manifest
    if log.reading.columns["time"].name in _INDEX and "no header" not in log.reading.layout:
        numbered = manifest.model_copy(
            update={"columns": {k: n + 1 for k, n in _FIRST_THREE.items()}}
        )
    return numbered


def _read(manifest: Manifest) -> Log | None:
    try:
        return read_entry(manifest, manifest.logs[0])
    except InputError:
        return None


def open_questions(manifest: Manifest, given: Collection[str], *, named: bool) -> dict[str, str]:
    """Return what a draft takes for granted, by the key whose value it is and was not given.

    ``named``: whether the names of the files give masses and sines.
    """
    settled = {*given, "columns" * (manifest.columns is None), "logs" * named}
    return {key: text for key, text in _QUESTIONS.items() if key not in settled}


def draft_text(manifest: Manifest, questions: Mapping[str, str]) -> str:
    """Return a manifest as YAML, each question as a comment above the key that it is about."""
    lines = manifest_text(manifest).splitlines(keepends=True)
    return "".join(
        f"# To settle: {questions[key]}\n{line}" if key in questions else line
        for line in lines
        for key in [line.partition(":")[0]]
    )


def log_files(folder: Path) -> list[Path]:
    """Return the files below a folder that end as logs do."""
    if not folder.is_dir():
        raise InputError(folder, "path", "no such folder", "a folder of logs")

    def refuse(error: OSError) -> None:
        raise InputError(error.filename, "path", error.strerror, "a folder that can be looked into")

    walked = os.walk(folder, onerror=refuse)
    paths = (Path(below) / name for below, _, names in walked for name in names)
    return sorted(path for path in paths if path.suffix.lower() in FORMATS)


def has_thesis_names(folder: Path) -> bool:
    """Whether a file below a folder is named as the thesis does it."""
    return any(_THESIS_NAME.fullmatch(path.stem) for path in log_files(folder))


def _entry_by_name(path: Path, folder: Path, units: Units) -> LogEntry | None:
    """Read added mass and sine off a file name as the thesis forms it; None if it is another."""
    match = _THESIS_NAME.fullmatch(path.stem)
    if match is None:
        return None
    grams, omega, digits = match.groups()
    return LogEntry(
        file=path.relative_to(folder).as_posix(),
        added_mass=_in_unit(float(grams.replace("_", ".")) / 1e3, units.factor("mass")),
        omega=_in_unit(float(omega.replace("_", ".")), units.factor("omega")),
        amplitude=float(f"0.{digits}"),
    )


def _in_unit(value: float, factor: float) -> float:
    return value if factor == 1.0 else float(f"{value / factor:.{_DIGITS}g}")
