"""What is attached to a report of an error: versions, health, verdict; no name, no path, no text.

It is made of numbers and of words of the program (`butterfly.logs.anonymous`), not by searching
texts for what looks private. Sentences about logs are made anew, of logs without names.
"""

from __future__ import annotations

import io
import os
import platform
import re
import traceback
from collections.abc import Callable, Mapping
from functools import partial
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from butterfly.errors import InputError
from butterfly.experiment.methods import ESTIMATORS
from butterfly.files import finite, json_text, write_file
from butterfly.identification.trust import KINDS, Ending, Trust
from butterfly.logs.anonymous import anonymous_log, anonymous_manifest, format_of, manifest_facts
from butterfly.logs.csv import csv_text
from butterfly.logs.formats import MAPPED
from butterfly.logs.health import examine
from butterfly.logs.log import InputKind, Log
from butterfly.logs.manifest import LogEntry, Manifest, manifest_text
from butterfly.logs.reading import read_pieces
from butterfly.model.parameters import JointKind
from butterfly.model.terms import TERMS
from butterfly.outputs import mark_of
from butterfly.progress import Track, untracked
from butterfly.report.inspection import STATES, Inspected, log_row
from butterfly.result import document, versions
from butterfly.verdict import VERDICTS, Level

TEXT, NUMBERS, MANIFEST = "report.txt", "report.json", "manifest.yaml"
"""Files of a bundle, besides its logs."""

_PACKAGE = Path(__file__).parents[1]
_DISTRIBUTION = "butterfly-testbed"
_NAME_OF_REQUIREMENT = re.compile(r"[\w.-]+")
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of all files: when a bundle was made is nobody's business
_FIELDS = {*MAPPED, *Manifest.model_fields, *LogEntry.model_fields}
_FIELDS |= {"content", "file name", "path", "schema", "schema_number", "digest"}
_OF_ROW = ("name", "log", "columns", "topics", "unclear", "regimes", "contradiction")
OF_RESULT = (
    *("verdict", "method", "ending", "input", "joint", "condition", "freedom", "horizon", "known"),
    *("held", "on_bound", "unestimated", "covariance", "fit", "fits", "held_out", "zeros"),
)
WORDS = frozenset(
    (
        *(*OF_RESULT, "parameters", "findings", *TERMS, *KINDS),
        *map(str, (*InputKind, *JointKind, *Ending)),
        *(str(trust.value[0]) for trust in Trust),
        *(level.verdict for level in VERDICTS),
        *(word for method in ESTIMATORS for word in (method, method.replace("-", " "))),
        *("value", "standard_error", "lower", "upper", "claim", "kind", "number"),
        *("name", "names", "matrix", "median", "mean", "worst", "whole", "longest"),
    )
)
"""What a result may say in words here; everything else in it is left out."""

_HOLDS = (
    "the versions of Python, the system and the packages",
    "facts of the manifest, and the health of each log",
    "level, parameters and kinds of findings of the result",
    "the recorded samples of the logs, each clock from 0",
)
_HOLDS_NOT = "names of files, folders, columns, joints, users and computers; texts of yours; dates"
_NO_SAMPLES = "; samples of the logs (--logs adds them)"


_T = TypeVar("_T")


class BundledLog(NamedTuple):
    """A log without names, or why there is none."""

    entry: LogEntry
    log: Log | None
    row: dict[str, Any]


def bundle_files(
    manifest: Manifest | Exception | None,
    result: Mapping[str, Any] | Exception | None,
    *,
    samples: bool = False,
    track: Track = untracked,
) -> dict[str, str]:
    """Return the files of a bundle, by name; of what could not be read, where that failed."""
    logs: list[BundledLog] = []
    data: dict[str, Any] | None = None
    texts: dict[str, str] = {}
    if isinstance(manifest, Exception):
        data = failure(manifest)
    elif manifest is not None:
        logs = bundled_logs(manifest, track)
        data = manifest_facts(manifest)
        readable = [(part.entry, part.log) for part in logs if part.log is not None]
        written = attempted(lambda: manifest_text(anonymous_manifest(manifest, readable)))
        if isinstance(written, str):  # not without logs, and not of masses without an arm
            texts[MANIFEST] = written
        if samples:
            texts |= {f"{log.name}.csv": csv_text(log) for _, log in readable}
    judged = failure(result) if isinstance(result, Exception) else result and judgement(result)
    content = {
        "system": system(),
        "packages": packages(),
        "data": data,
        "logs": [part.row for part in logs],
        "result": judged,
    }
    there = (True, data is not None, judged is not None, samples and bool(logs))
    head = [
        f"Holds: {'; '.join(text for text, has in zip(_HOLDS, there, strict=True) if has)}.",
        f"Does not hold: {_HOLDS_NOT}{_NO_SAMPLES * (not there[-1])}.",
    ]
    numbers = document("bundle", "Report of an error", content, summary=head)
    lines = [*head, "", *_lines(content)]
    return {TEXT: "\n".join([*lines, ""]), NUMBERS: json_text(finite(numbers)), **texts}


def write_bundle(texts: Mapping[str, str], path: Path) -> None:
    """Write the files of a bundle as a zip file, which replaces nothing but another bundle."""
    mark = mark_of(path, "bundle")
    packed = io.BytesIO()
    with ZipFile(packed, "w", ZIP_DEFLATED) as parts:
        for name, text in texts.items():
            part = ZipInfo(name, _EPOCH)
            part.compress_type = ZIP_DEFLATED
            parts.writestr(part, text)
        parts.comment = mark.encode()
    write_file(path, packed.getvalue(), mark)


def system() -> dict[str, Any]:
    """Return what runs the program: kinds and versions, no name of a computer."""
    return {
        "system": platform.system(),
        "release": platform.release().partition("-")[0],
        "machine": platform.machine(),
        "implementation": platform.python_implementation(),
        "python": platform.python_version(),
        "cores": os.cpu_count(),
    }


def packages() -> dict[str, str]:
    """Return the installed versions of the program and of all that it may use."""
    try:
        requirements = requires(_DISTRIBUTION) or []
    except PackageNotFoundError:  # run from its sources
        return dict(versions())
    names = {match[0] for text in requirements if (match := _NAME_OF_REQUIREMENT.match(text))}
    return {"butterfly": versions()["butterfly"]} | {
        name: installed for name in sorted(names) if (installed := _version(name))
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def bundled_logs(manifest: Manifest, track: Track = untracked) -> list[BundledLog]:
    """Return all logs of a manifest without names, each with its health."""
    logs: list[BundledLog] = []
    for entry in track(manifest.logs, "Looking at logs"):
        name = f"log-{len(logs) + 1}"
        pieces = attempted(partial(read_pieces, manifest, entry))
        if isinstance(pieces, Exception):
            row = {"log": name, "condition": STATES[Level.WARNING]}
            logs.append(BundledLog(entry, None, row | failure(pieces) | _format(entry)))
            continue
        for piece, recorded in pieces:
            log = anonymous_log(recorded, f"log-{len(logs) + 1}")
            factors = {name: column.factor for name, column in recorded.reading.columns.items()}
            row = _health(log, manifest) | _format(entry) | {"factors": factors}
            logs.append(BundledLog(piece, log, row))
    return logs


def _format(entry: LogEntry) -> dict[str, str]:
    return {"format": format_of(entry)}


def _health(log: Log, manifest: Manifest) -> dict[str, Any]:
    """Return the health of a log that has no names, or where it is refused."""
    examined = attempted(partial(examine, log, manifest.repair))
    if isinstance(examined, Exception):
        refused = {"log": log.name, "condition": STATES[Level.WARNING]} | failure(examined)
        return refused | ({"message": str(examined)} if isinstance(examined, InputError) else {})
    repaired, health = examined
    row = log_row(
        Inspected(name=log.name, log=repaired, health=health, remarks=tuple(health.remarks))
    )
    return {name: value for name, value in row.items() if name not in _OF_ROW} | {"log": log.name}


def judgement(result: Mapping[str, Any]) -> dict[str, Any]:
    """Return level, parameters and kinds of findings of a saved result, without any text."""
    parts = {name: result.get(name) for name in (*OF_RESULT, "parameters", "findings")}
    judged: dict[str, Any] = _without_texts(parts)
    return judged


def failure(error: Exception) -> dict[str, Any]:
    """Return the kind of an error, its field, and the lines of this program that led to it."""
    frames = traceback.extract_tb(error.__traceback__)
    inside = [(Path(frame.filename), frame) for frame in frames]
    field = re.split(r"[.,]", error.field)[0] if isinstance(error, InputError) else None
    return {
        "refused": type(error).__name__,
        "field": field if field in _FIELDS else None,
        "at": [
            f"{path.relative_to(_PACKAGE).as_posix()}:{frame.lineno} {frame.name}"
            for path, frame in inside
            if path.is_relative_to(_PACKAGE)
        ],
    }


def _without_texts(value: Any) -> Any:  # noqa: ANN401 - any JSON
    """Return a part of a document as numbers and the program's words; other keys are numbered."""
    if isinstance(value, Mapping):
        parts = {key: _without_texts(part) for key, part in value.items()}
        some = {key: part for key, part in parts.items() if part is not None}
        return {key if key in WORDS else str(k): some[key] for k, key in enumerate(some, start=1)}
    if isinstance(value, list | tuple):
        return [_without_texts(entry) for entry in value]
    return value if isinstance(value, int | float | None) or value in WORDS else None


def attempted(made: Callable[[], _T]) -> _T | Exception:
    """Return what is made, or the error: a bug, too, is reported."""
    try:
        return made()
    except Exception as error:
        return error


def _lines(content: Mapping[str, Any], indent: str = "") -> list[str]:
    """Return a document in lines for a person, to be read before it is attached."""
    lines: list[str] = []
    for name, value in content.items():
        if isinstance(value, Mapping) and value:
            lines += [f"{indent}{name}:", *_lines(value, f"{indent}  ")]
        elif isinstance(value, list) and any(isinstance(entry, Mapping) for entry in value):
            for number, entry in enumerate(value, start=1):
                lines += [f"{indent}{name} {number}:", *_lines(entry, f"{indent}  ")]
        elif value not in (None, [], {}):
            lines.append(f"{indent}{name}: {_shown(value)}")
    return lines


def _shown(value: Any) -> str:  # noqa: ANN401 - any JSON
    if isinstance(value, float):
        return f"{value:.6g}"
    return ", ".join(map(_shown, value)) if isinstance(value, list) else str(value)
