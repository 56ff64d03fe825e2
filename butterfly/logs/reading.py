"""The logs of a manifest: read, cut into pieces and recordings, and found by name."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from itertools import count, pairwise
from pathlib import Path, PurePath

import numpy as np

from butterfly.errors import InputError
from butterfly.logs.faults import restarts
from butterfly.logs.formats import read_log
from butterfly.logs.health import refuse_separators
from butterfly.logs.log import MIN_SAMPLES, Log
from butterfly.logs.manifest import LogEntry, Manifest
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
