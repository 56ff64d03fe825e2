"""Manifests of logs that come without one, from their files' names and what else is given."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from butterfly.errors import InputError
from butterfly.logs.formats import ENDINGS, FORMATS, OFTEN_TEXTS
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import (
    MANIFEST_NAME,
    LogEntry,
    Manifest,
    described,
    manifest_text,
)
from butterfly.logs.reading import read_entry
from butterfly.logs.units import Units
from butterfly.model.prior import known_of

_THESIS_NAME = re.compile(r"Data_(\d+(?:_\d+)?)__(\d+(?:_\d+)?)__0(\d+)")
_QUESTIONS = {
    "input": "what does the input command, voltage or torque? The files do not say.",
    "intersample": "how does the input go between two samples, held (zero_order_hold) or in a line "
    "(first_order_hold)? The files do not say.",
}
_OF_COLUMNS = (
    "which columns hold time, input and angle, by name or number? None is called so. Taken for the "
    "first three, in this order."
)
_FIRST_THREE = {"time": 0, "input": 1, "angle": 2}
_OF_LOGS = (
    "what was added in each log (added_mass in kg, arm in m), and omega and amplitude of a sine? "
    "The names of the files do not say."
)
_DIGITS = 12  # of a number in another unit: the last ones are those of rounding


def draft(path: Path, given: Mapping[str, Any], *, massless: bool = False) -> Manifest:
    """Return the manifest of a log, or of a folder of logs, that comes without one.

    ``given`` is what `checked_options` found. Added masses and sines are those of names like
    Data_52__8__002.mat, which need an arm; ``massless``: unless what is added may be left out.
    """
    if not path.is_dir():
        return manifest_of_log(path, given)
    if not has_thesis_names(path) or (massless and "arm" not in given):
        return manifest_of_files(path, given)
    if "arm" not in given:
        expected = "a manifest, or the arm (--arm) in m of the masses in the names of the files"
        raise InputError(path, MANIFEST_NAME, "no such file", expected)
    return manifest_from_names(path, given)


def manifest_from_names(folder: Path, given: Mapping[str, Any]) -> Manifest:
    """Generate a manifest from the thesis's file names, ``Data_<grams>__<rad/s>__<0amplitude>``.

    ``_`` stands for a decimal point within a number, and the amplitude's point follows its first
    0: ``Data_120_5__3_5__0015.mat`` is 120.5 g, 3.5 rad/s, 0.015. Subfolders are searched.
    """
    entries = []
    units = Units.of(given.get("units"))
    for path in log_files(folder):
        entry = _entry_by_name(path, folder, units)
        if entry is not None:
            entries.append(entry)
        elif path.suffix.lower() not in OFTEN_TEXTS:
            expected = "Data_<grams>__<rad/s>__<0amplitude>, or a manifest"
            raise InputError(path, "file name", path.stem, expected)
    if not entries:
        raise InputError(folder, "path", f"no {ENDINGS} file", "a folder of logs")
    entries.sort(key=lambda entry: (known_of(entry.added_mass).value, entry.omega or 0.0))
    return of_logs(folder.resolve().name, folder, entries, given)


def manifest_of_files(folder: Path, given: Mapping[str, Any]) -> Manifest:
    """Generate a manifest of all logs in a folder, whatever their names: nothing was added to any.

    Files that are often texts of another kind are logs if they hold a table. Subfolders are
    searched.
    """
    from butterfly.logs.csv import holds_table  # noqa: PLC0415 - slow to import

    paths = [
        path
        for path in log_files(folder)
        if path.suffix.lower() not in OFTEN_TEXTS or holds_table(path)
    ]
    if not paths:
        raise InputError(folder, "path", f"no {ENDINGS} file with a table", "a folder of logs")
    entries = [LogEntry(file=path.relative_to(folder).as_posix()) for path in paths]
    return of_logs(folder.resolve().name, folder, entries, given)


def manifest_of_log(path: Path, given: Mapping[str, Any]) -> Manifest:
    """Generate the manifest of one log; its name gives mass and sine, where it follows the pattern.

    Without an arm the added mass is not placed, and left out.
    """
    units = Units.of(given.get("units"))
    entry = _entry_by_name(path, path.parent, units) or LogEntry(file=path.name)
    if "arm" not in given:
        entry = entry.model_copy(update={"added_mass": 0.0})
    return of_logs(path.name, path.parent, [entry], given)


def of_logs(
    name: str, root: Path, entries: Collection[LogEntry], given: Mapping[str, Any]
) -> Manifest:
    """Return the manifest of some logs; the input is a voltage unless given otherwise."""
    content = {"name": name, "root": str(root.resolve()), "logs": list(entries)}
    return described(content, {"input": InputKind.VOLTAGE} | dict(given))


def with_columns(manifest: Manifest) -> Manifest:
    """Return a manifest by which its first log can be read: by the first columns, if need be.

    Columns that are given stay, and so does a log that cannot be read in this way either.
    """
    numbered = manifest.model_copy(update={"columns": _FIRST_THREE})
    if manifest.columns is not None or _is_read(manifest) or not _is_read(numbered):
        return manifest
    return numbered


def _is_read(manifest: Manifest) -> bool:
    try:
        read_entry(manifest, manifest.logs[0])
    except InputError:
        return False
    return True


def open_questions(manifest: Manifest, given: Collection[str], *, named: bool) -> dict[str, str]:
    """Return what a draft takes for granted, by the key whose value it is and was not given.

    ``named``: whether the names of the files give masses and sines.
    """
    asked = {key: text for key, text in _QUESTIONS.items() if key not in given}
    if manifest.columns is not None and "columns" not in given:
        asked["columns"] = _OF_COLUMNS
    return asked if named else asked | {"logs": _OF_LOGS}


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
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() in FORMATS)


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
