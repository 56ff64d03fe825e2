"""The logs of a manifest, read and cut into pieces; and manifests drafted for logs without one."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from itertools import count, pairwise
from pathlib import Path, PurePath
from types import MappingProxyType
from typing import Any

import numpy as np

from butterfly.errors import InputError
from butterfly.logs.faults import restarts
from butterfly.logs.formats import (
    DEFAULT_COLUMNS,
    ENDINGS,
    FORMATS,
    OFTEN_OTHERS,
    NoColumnError,
    holds_table,
    read_log,
    unsaid,
)
from butterfly.logs.headers import columns_by_joint, columns_meant, columns_of_drive, meaning_of
from butterfly.logs.health import refuse_separators
from butterfly.logs.json import logs_in, numbers_in
from butterfly.logs.log import MIN_SAMPLES, InputKind, Log
from butterfly.logs.manifest import (
    MANIFEST_NAME,
    LogEntry,
    Manifest,
    columns_of_entry,
    described,
    manifest_text,
)
from butterfly.logs.units import Units
from butterfly.model.prior import known_of
from butterfly.model.servo import ServoLoop
from butterfly.progress import Track, untracked


def read_logs(manifest: Manifest, track: Track = untracked) -> tuple[Manifest, list[Log]]:
    """Read all logs of a manifest as recorded; return it with an entry for each, and the logs."""
    pieces = [read_pieces(manifest, entry) for entry in track(manifest.logs, "Reading logs")]
    pairs = [pair for pairs in pieces for pair in pairs]
    entries = [entry for entry, _ in pairs]
    return manifest.model_copy(update={"logs": entries}), [log for _, log in pairs]


def with_parts(manifest: Manifest) -> Manifest:
    """Return a manifest with an entry for each recording of the readable, split files."""
    entries: list[LogEntry] = []
    for entry in manifest.logs:
        try:
            wanted = read_pieces(manifest, entry) if entry.split or manifest.split else []
        except InputError:
            wanted = []
        entries += [piece for piece, _ in wanted] or [entry]
    return manifest.model_copy(update={"logs": entries})


def read_entry(manifest: Manifest, entry: LogEntry) -> Log:
    """Read the whole file of a log."""
    log = read_log(
        Path(manifest.root) / entry.file,
        columns=entry.columns or manifest.columns,
        units=manifest.scale(entry),
        name=piece_name(LogEntry(file=entry.file, at=entry.at)),
        **manifest.properties(entry),
    )
    return log if manifest.encoder == "joint" else log.at_joint(manifest.turns)


def read_pieces(manifest: Manifest, entry: LogEntry) -> list[tuple[LogEntry, Log]]:
    """Read the logs of an entry, each with its own entry (see `read_logs`)."""
    return pieces_of(manifest, entry, read_entry(manifest, entry))


def pieces_of(manifest: Manifest, entry: LogEntry, whole: Log) -> list[tuple[LogEntry, Log]]:
    """Return the logs of an entry from its whole file, each with its own entry."""
    if (entry.part, entry.begin, entry.end) != (None, None, None):
        return [(entry, replace(_piece(whole, entry), name=piece_name(entry)))]
    parts = _parts(whole) if entry.split or manifest.split else [whole]
    if len(parts) == 1:
        return [(entry, whole)]
    owns = [entry.model_copy(update={"part": k, "split": None}) for k in range(1, len(parts) + 1)]
    pairs = zip(owns, parts, strict=True)
    return [(piece, replace(part, name=piece_name(piece))) for piece, part in pairs]


def piece_name(entry: LogEntry) -> str:
    """Return the name of an entry's log: its file, and the piece of it."""
    which = [entry.at] if entry.at else []
    which += [] if entry.part is None else [f"part {entry.part}"]
    if entry.begin is not None or entry.end is not None:
        begin = "start" if entry.begin is None else f"{entry.begin:g} s"
        end = "end" if entry.end is None else f"{entry.end:g} s"
        which.append(f"{begin} to {end}")
    return f"{entry.file} ({', '.join(which)})" if which else entry.file


def _parts(whole: Log) -> list[Log]:
    """Return the recordings of a file, split where its clock falls back."""
    refuse_separators(whole)
    edges = list(pairwise([0, *restarts(whole.time), whole.time.size]))
    for first, last in edges:
        if last - first < MIN_SAMPLES:
            length = f"{last - first} samples after the clock falls back at sample {first}"
            raise InputError(whole.source, "time", length, f"at least {MIN_SAMPLES} per recording")
    return [whole.take(np.arange(first, last)) for first, last in edges]


def _piece(whole: Log, entry: LogEntry) -> Log:
    """Cut the piece of an entry out of its file."""
    part = whole
    if entry.part is not None:
        parts = _parts(whole)
        if entry.part > len(parts):
            bound = f"a number up to {len(parts)}, the recordings in this file"
            raise InputError(whole.source, "part", entry.part, bound)
        part = parts[entry.part - 1]
    if entry.begin is None and entry.end is None:
        return part
    begin = -math.inf if entry.begin is None else entry.begin
    end = math.inf if entry.end is None else entry.end
    numbers = np.flatnonzero((part.time >= begin) & (part.time <= end))
    if numbers.size < MIN_SAMPLES:
        span = f"{np.nanmin(part.time):g} s to {np.nanmax(part.time):g} s"
        length = f"{numbers.size} samples in {piece_name(entry)}"
        expected = f"at least {MIN_SAMPLES} samples within {span}"
        raise InputError(whole.source, "from, to", length, expected)
    first, last = int(numbers[0]), int(numbers[-1]) + 1
    return deepcopy(part.piece(first, last))  # a copy, which does not hold the whole log


def with_unique_names(logs: Sequence[Log]) -> list[Log]:
    """Return the logs with unique names: the label, and ``NAME (2)`` for a second."""
    firsts = [log.name or log.label for log in logs]
    names: list[str] = []
    taken, seen = set(firsts), set[str]()
    for first in firsts:
        numbered = (f"{first} ({number})" for number in count(2))
        name = next(label for label in numbered if label not in taken) if first in seen else first
        seen.add(first)
        taken.add(name)
        names.append(name)
    pairs = zip(logs, names, strict=True)
    return [log if log.name == name else replace(log, name=name) for log, name in pairs]


def numbers_named(logs: Sequence[Log], names: Sequence[str], source: str) -> list[int]:
    """Return the numbers of logs by name or glob pattern, of the log or its file."""
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise InputError(source, "holdout", names, "a list of log names or glob patterns")
    forms = [{log.name, PurePath(log.name).name, PurePath(log.name).stem} for log in logs]
    chosen = set[int]()
    for name in names:
        exact = [k for k, form in enumerate(forms) if name in form]
        matches = exact or [
            k for k, form in enumerate(forms) if any(fnmatchcase(label, name) for label in form)
        ]
        if not matches:
            known = [log.name for log in logs]
            (close,) = get_close_matches(name, known, n=1, cutoff=0.0) or known[:1]
            raise InputError(source, "holdout", name, f"a log name, such as {close}")
        chosen.update(matches)
    return sorted(chosen)


_THESIS_NAME = re.compile(r"Data_(\d+(?:_\d+)?)__(\d+(?:_\d+)?)__0(\d+)")
_GRAMS = re.compile(r"(\d+(?:\.\d+)?)g")  # a part of another name
_GAIN = re.compile(r"(k[pid])(\d+(?:\.\d+)?)")  # another
_QUESTIONS = {
    "input": "what does the input command: voltage, torque, current, duty, or the setpoint of a "
    "servo (which needs its loop)?",
    "known": "is the input the torque at the joint, in N m? Then p4 is 1, and no added mass is "
    "needed: {p4: 1.0}, or {p4: 1+-0.03} if the drive's gain is known to 3 %.",
    "loop": "which law does the servo have, with which gains, as {law: dynamixel-x, kp: 400}?",
    "columns": "which column holds the {}, by name or number from 0? ",
    "logs": "which mass was added in each log (added_mass in kg, arm in m)?",
}
_WHICH_JOINT = "which joint of the model moved in each log (of: its name)?"
_WHICH_GAIN = "which {0} had the loop ({0}: 400 here, or loop: {{{0}: 400}} in each log's line)?"
_REPAIRED = "Samples that repeat a stamp are dropped and counted; without this they are a fault."
_FACTS = {
    "mass": "added_mass",
    **dict.fromkeys(("length", "arm"), "arm"),
    **dict.fromkeys(("vin", "supply", "supply_voltage"), "supply"),
    **{gain: gain for gain in ("kp", "ki", "kd")},
}  # keys of numbers beside a log, and what they are of a manifest's log or of its loop
_MOST = 4  # logs whose facts are quoted
_DIGITS = 12  # of a number in another unit: the others are rounding


def draft(path: Path, given: Mapping[str, Any], *, massless: bool = False) -> Manifest:
    """Return a manifest for a log, or for all logs below a folder, without one.

    ``given`` comes from `checked_options`. Masses and sines are read from names as in the thesis:
    ``Data_120_5__3_5__0015.mat`` is 120.5 g, 3.5 rad/s, 0.015. Without an arm the mass of a single
    log is ignored, and all masses of a folder if it may be ``massless``.
    """
    units, folder = Units.of(given.get("units")), path
    if not path.is_dir():
        folder = path.parent
        named = LogEntry(file=path.name, added_mass=_mass_by_name(path, given))
        entry = _entry_by_name(path, folder, units) or named
        entry = entry if "arm" in given else entry.model_copy(update={"added_mass": 0.0})
        entries = _each_log(entry, folder, given)
    elif not has_thesis_names(path) or (massless and "arm" not in given):
        entries = _entries(path, given)
    elif "arm" in given:
        entries = _entries_by_name(path, units)
    else:
        expected = "a manifest, or --arm in m for the masses in the file names"
        raise InputError(path, MANIFEST_NAME, "no such file", expected)
    name = path.resolve().name if path.is_dir() else path.name
    return of_logs(name, folder, entries, given)


def _entries_by_name(folder: Path, units: Units) -> list[LogEntry]:
    entries = []
    for path in log_files(folder):
        entry = _entry_by_name(path, folder, units)
        if entry is not None:
            entries.append(entry)
        elif path.suffix.lower() not in OFTEN_OTHERS:
            expected = "Data_<grams>__<rad/s>__<0amplitude>, or a manifest"
            raise InputError(path, "file name", path.stem, expected)
    return sorted(entries, key=lambda log: (known_of(log.added_mass).value, log.omega or 0.0))


def _entries(folder: Path, given: Mapping[str, Any]) -> list[LogEntry]:
    """Return an entry for each log; a file that is often no log must hold a table."""
    paths = [
        path
        for path in log_files(folder)
        if path.suffix.lower() not in OFTEN_OTHERS
        or holds_table(path, 2 if "interval" in given else 3)
    ]
    if not paths:
        raise InputError(folder, "path", f"no {ENDINGS} file with a table", "a folder of logs")
    masses = [_mass_by_name(path, given) if "arm" in given else 0.0 for path in paths]
    names = [path.relative_to(folder).as_posix() for path in paths]
    pairs = zip(names, masses, strict=True)
    entries = [LogEntry(file=name, added_mass=mass) for name, mass in pairs]
    return [log for entry in entries for log in _each_log(entry, folder, given)]


def _each_log(entry: LogEntry, folder: Path, given: Mapping[str, Any]) -> list[LogEntry]:
    """Return an entry for each log in a file, unless the given columns name one."""
    path, names = folder / entry.file, [*map(str, given.get("columns", {}).values())]
    places = logs_in(path) if FORMATS[path.suffix.lower()] == "json" else []
    named = {name.partition(".")[0] for name in names} & {
        place.partition(".")[0] for place in places
    }
    return [entry.model_copy(update={"at": place}) for place in places if not named] or [entry]


def of_logs(
    name: str, root: Path, entries: Collection[LogEntry], given: Mapping[str, Any]
) -> Manifest:
    """Return the manifest of some logs; the input is a voltage unless given otherwise."""
    content = {"name": name, "root": str(root.resolve()), "logs": list(entries)}
    return described(content, {"input": InputKind.VOLTAGE} | dict(given))


def with_columns(manifest: Manifest, given: Mapping[str, Any] = MappingProxyType({})) -> Manifest:
    """Return a manifest with the columns, the kind of input and the facts that files name.

    ``given`` is from `checked_options`. Columns without a clear name are left out.
    """
    kind, entries, by_ending = given.get("input"), [*manifest.logs], dict[str, LogEntry]()
    if manifest.columns is None:
        for k, entry in enumerate(entries):
            ending = PurePath(entry.file).suffix.lower()
            if ending not in by_ending or FORMATS[ending] == "json":
                by_ending[ending] = _with_own_columns(manifest, entry, kind)
            known = by_ending[ending]
            entries[k] = entry.model_copy(update={"columns": known.columns, "at": known.at})
        common = entries[0].columns
        for k, entry in enumerate(entries):
            columns = DEFAULT_COLUMNS if entry.columns is None else entry.columns
            update = {"columns": None if entry.columns == common else columns}
            entries[k] = entry.model_copy(update=update)
        manifest = manifest.model_copy(update={"columns": common})
    if manifest.columns is not None and manifest.input is InputKind.SETPOINT:
        extra = columns_of_drive(columns_of_entry(manifest, entries[0]))
        manifest = manifest.model_copy(update={"columns": manifest.columns | extra})
    names = {(log.columns or manifest.columns or {}).get("input") for log in entries}
    kinds = {meaning_of(str(name)).kind for name in names}
    if kind is None and len(kinds) == 1 and None not in kinds:
        manifest = manifest.model_copy(update={"input": kinds.pop()})
    return manifest.model_copy(
        update={"logs": [_with_facts(log, manifest, given) for log in entries]}
    )


def _with_own_columns(manifest: Manifest, entry: LogEntry, kind: InputKind | None) -> LogEntry:
    """Return an entry with its columns by name; None for those if the usual ones are there."""
    plain = InputKind.NONE if kind is InputKind.NONE else InputKind.VOLTAGE
    try:
        read_entry(manifest.model_copy(update={"loop": {}, "input": plain}), entry)
    except InputError as error:
        names = (
            [*error.names]
            if isinstance(error, NoColumnError)
            else columns_of_entry(manifest, entry)
        )
    else:
        return entry
    columns = columns_meant(names, kind)
    if kind is InputKind.NONE:
        columns.pop("input", None)
    parents = {name.rpartition(".")[0] for name in columns.values()}
    if entry.at is None and len(parents) == 1 and any(parents) and _is_json(entry):
        (at,) = parents
        columns = {field: name.removeprefix(f"{at}.") for field, name in columns.items()}
        entry = entry.model_copy(update={"at": at})
    return entry.model_copy(update={"columns": columns})


def _is_json(entry: LogEntry) -> bool:
    return FORMATS[PurePath(entry.file).suffix.lower()] == "json"


def _with_facts(entry: LogEntry, manifest: Manifest, given: Mapping[str, Any]) -> LogEntry:
    """Return an entry with what its file says of mass and loop, except what is given."""
    facts = {_FACTS[key]: number for key, number in _facts(manifest, entry).items()}
    mass, arm = facts.pop("added_mass", None), facts.pop("arm", None)
    if mass is not None and (arm or "arm" in given) and not known_of(entry.added_mass).value:
        extra = {} if "arm" in given else {"arm": arm}
        entry = entry.model_copy(update={"added_mass": mass, **extra})
    facts = _gains_by_name(entry.file) | facts
    loop = {key: number for key, number in facts.items() if key not in given.get("loop", {})}
    if manifest.input is InputKind.SETPOINT and loop:
        entry = entry.model_copy(update={"loop": loop})
    return entry


def _facts(manifest: Manifest, entry: LogEntry) -> dict[str, float]:
    """Return the numbers beside a log that are facts of a manifest, by their keys."""
    numbers = numbers_in(Path(manifest.root) / entry.file) if _is_json(entry) else {}
    return {key: number for key, number in numbers.items() if key in _FACTS and number >= 0}


def open_questions(manifest: Manifest, given: Collection[str], *, named: bool) -> dict[str, str]:
    """Return the questions on a draft, by key not given; names of ``named`` files give masses."""
    questions = {"units": _unit_taken(manifest)} | _QUESTIONS
    settled = {*given, "columns", "logs" * named}
    if manifest.model is not None:  # whose links weigh what is known of them
        of_joints = all(entry.of or manifest.of for entry in manifest.logs)
        questions["logs"] = "" if of_joints else _WHICH_JOINT
    settled |= _settled_of_scale(manifest)
    about = {"interval": manifest.interval, "input_kind": manifest.input}
    called = [str((manifest.columns or {}).get("input", ""))]
    if manifest.model is not None and (joint := manifest.logs[0].of):
        called = [*columns_by_joint(columns_of_entry(manifest, manifest.logs[0]), [joint])[joint]]
    for entry in manifest.logs:
        columns = manifest.columns if entry.columns is None else entry.columns
        lacking = [] if columns is None else unsaid(columns, about)
        if lacking:
            names = columns_of_entry(manifest, entry)
            called = names if "input" in lacking else called
            listing = ", ".join(map(repr, names)) or "without names"
            which = f"The columns of {entry.file}: {listing}."
            questions["columns"] = questions["columns"].format(" and the ".join(lacking)) + which
            settled.discard("columns")
            break
    kinds = {name: meaning.kind for name in called if (meaning := meaning_of(name)).kind}
    answer = " or ".join(f"{kind} by the name of {name!r}" for name, kind in kinds.items())
    questions["input"] += f" It is {answer}." if answer else " No column name says it."
    for entry in manifest.logs[:_MOST]:
        if facts := [f"{key} {number:g}" for key, number in _facts(manifest, entry).items()]:
            questions["logs"] += f" {entry.file} says {', '.join(facts)}."
    if manifest.input is not InputKind.SETPOINT:
        settled.add("loop")
    elif "law" in manifest.loop:
        gain = _lacking_gain(manifest)
        questions["loop"] = _WHICH_GAIN.format(gain)
        settled = settled - {"loop"} if gain else settled | {"loop"}
    return {key: text for key, text in questions.items() if text and key not in settled}


def _settled_of_scale(manifest: Manifest) -> set[str]:
    """Return which of p4 and masses need not be asked for: a known p4 fixes the scale."""
    scaled = {"logs"} if "p4" in manifest.known and manifest.model is None else set()
    asks = manifest.model is None and manifest.input is InputKind.TORQUE
    return scaled if asks else {"known", *scaled}


def _lacking_gain(manifest: Manifest) -> str:
    """Return the gain that the loop of a log lacks; "" if none does."""
    for entry in manifest.logs:
        try:
            ServoLoop.of(manifest.loop_of(entry), entry.file)
        except InputError as error:
            return error.field.rpartition(".")[2]
    return ""


def _unit_taken(manifest: Manifest) -> str:
    """Say what the input of the first log was taken in, and how to say another; "" if it says."""
    try:
        log = read_entry(manifest, manifest.logs[0])
    except InputError:
        return ""
    read = log.reading.columns.get("input")
    if read is None or not read.assumed or log.input_kind is InputKind.NONE:
        return ""
    return f"I{read.taken[1:]}. Another unit: units: {{input: {read.other}}}."


def draft_text(manifest: Manifest, questions: Mapping[str, str]) -> str:
    """Return a manifest as YAML, each question as a comment above its key."""
    names = {"added_mass": "kg", "arm": "m"}
    units = {name: manifest.units.get(name.removeprefix("added_"), names[name]) for name in names}
    places = ", ".join(f"{name}: ({unit})" for name, unit in units.items())
    places = "of: (joint)" if manifest.model is not None else places
    lines = manifest_text(manifest).splitlines(keepends=True)
    for key in ("loop", "known"):  # which are not written if empty
        if key in questions and not getattr(manifest, key):
            after = next(k for k, line in enumerate(lines, 1) if line.startswith("input:"))
            lines.insert(after, f"{key}: {{}}\n")
    if "units" in questions and not manifest.units:  # as a comment where it would stand
        both = filter(None, (questions.get("input"), questions["units"]))
        questions = {**questions, "input": " ".join(both)}
    return "".join(
        f"# To settle: {questions[key]}\n{line}"
        + f"  # - {{file: ..., {places}}}\n" * (key == "logs")
        if key in questions
        else f"# {_REPAIRED}\n" * (key == "repair") + line
        for line in lines
        for key in [line.partition(":")[0]]
    )


def log_files(folder: Path) -> list[Path]:
    """Return the files below a folder with the endings of logs."""
    if not folder.is_dir():
        raise InputError(folder, "path", "no such folder", "a folder of logs")

    def refuse(error: OSError) -> None:
        raise InputError(error.filename, "path", error.strerror, "a readable folder")

    walked = os.walk(folder, onerror=refuse)
    paths = (Path(below) / name for below, _, names in walked for name in names)
    return sorted(path for path in paths if path.suffix.lower() in FORMATS)


def has_thesis_names(folder: Path) -> bool:
    """Whether a file below a folder is named as in the thesis."""
    return any(_THESIS_NAME.fullmatch(path.stem) for path in log_files(folder))


def _entry_by_name(path: Path, folder: Path, units: Units) -> LogEntry | None:
    """Read added mass and sine from a file name of the thesis; None for another name."""
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


def _mass_by_name(path: Path, given: Mapping[str, Any]) -> float:
    """Return the mass that a name gives in grams, else 0: not of 120_5g, which is unclear."""
    parts = ["", *re.split("[_-]", path.stem)]
    pairs = zip(parts, (_GRAMS.fullmatch(part) for part in parts[1:]), strict=False)
    matches = [match for before, match in pairs if match and not before.isdigit()]
    factor = Units.of(given.get("units")).factor("mass")
    return _in_unit(float(matches[0][1]) / 1e3, factor) if len(matches) == 1 else 0.0


def _gains_by_name(file: str) -> dict[str, float]:
    """Return the gains of a loop that a name gives, as ``sine_kp400.csv`` does."""
    parts = map(_GAIN.fullmatch, re.split("[_-]", PurePath(file).stem.lower()))
    return {match[1]: float(match[2]) for match in parts if match}


def _in_unit(value: float, factor: float) -> float:
    return value if factor == 1.0 else float(f"{value / factor:.{_DIGITS}g}")
