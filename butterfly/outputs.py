"""Where results may be written: never over an input, nor over what the program did not write.

Every file is written by `butterfly.files.replacing`, which asks `require_free`. The program marks
its files with their kind (`mark_of`), and replaces a file only with one of the same kind. What can
hold no mark (CSV, C, films, logs, manifests) it replaces only if that is asked for.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path

from butterfly.errors import InputError

_MARKS = {
    ".html": '<meta name="generator" content="butterfly.{}">',
    ".svg": "<dc:title>butterfly.{}</dc:title>",
    ".png": "Software\0butterfly.{}",
    ".xml": "<!-- butterfly.{} -->",
    ".urdf": "<!-- butterfly.{} -->",
    ".parquet": "butterfly.{}",
    ".zip": "butterfly.{}",
}
"""What marks a file of a kind, by the ending of its name."""

_HEAD, _TAIL = 4096, 65_536  # bytes at the beginning and at the end that may hold a mark


@dataclass
class _Call:
    """The files of a command, or of a verb that writes several."""

    overwrite: bool = False
    inputs: set[tuple[int, int]] = field(default_factory=set)  # device and number of each file
    folder: Path | None = None  # of results, which is the program's own


_CALL: ContextVar[_Call | None] = ContextVar("call", default=None)


@contextmanager
def call(*, overwrite: bool = False, folder: Path | None = None) -> Iterator[None]:
    """Begin a call that may ``overwrite`` files without a mark, and whatever is in its ``folder``.

    A call within a call adds to what that one reads.
    """
    outer = _CALL.get() or _Call()
    inner = _Call(
        overwrite=overwrite or outer.overwrite,
        inputs=outer.inputs,
        folder=outer.folder if folder is None else folder.resolve(),
    )
    token = _CALL.set(inner)
    try:
        yield
    finally:
        _CALL.reset(token)


def note_input(path: Path) -> None:
    """Remember that the present call reads a file, or is given it as an input."""
    current, identity = _CALL.get(), _identity(path)
    if current is not None and identity is not None:
        current.inputs.add(identity)


def mark_of(path: Path, kind: str = "") -> str:
    """Return the mark of a kind in files with this ending; without one, what all marks begin with.

    It is empty if they can hold none.
    """
    mark = _MARKS.get(path.suffix.lower(), "")
    return mark.format(kind) if kind else mark.partition("{}")[0]


def mark_of_document(kind: str, second: str = "schema_number") -> str:
    """Return the mark of a kind of JSON document: its schema, then its second key."""
    return f'"schema": "butterfly.{kind}",\n "{second}"'


def require_free(path: Path, *marks: str, option: str = "path") -> None:
    """Raise InputError, naming an ``option``, unless a file with one of the marks may be written.

    Empty marks do not count.
    """
    current = _CALL.get() or _Call()
    if os.path.islink(path):  # noqa: PTH114 - no error where nobody may look
        raise InputError(path, option, "a link", "a file of its own")
    identity = _identity(path)
    if identity is None:
        return
    if path.is_dir():
        raise InputError(path, option, "a folder", "a file")
    if identity in current.inputs:
        raise InputError(path, option, "a file that is read here", "another path")
    within = current.folder is not None and path.resolve().is_relative_to(current.folder)
    if within or (current.overwrite and not any(marks)):
        return
    if not any(marks):
        expected = "a new path, or permission to overwrite it (--overwrite, or overwrite=True)"
        raise InputError(path, option, "an existing file", expected)
    if not any(_holds(path, mark) for mark in marks if mark):
        expected = "a new path, or a file that butterfly wrote as the same kind"
        raise InputError(path, option, "an existing file of another kind", expected)


def require_endings(path: Path, endings: Sequence[str], option: str = "path") -> None:
    """Raise InputError unless a file name ends with one of the ``endings``, in any case."""
    if path.suffix.lower() not in endings:
        known = [ending or "no ending" for ending in endings]
        expected = " or ".join([", ".join(known[:-1]), known[-1]] if known[:-1] else known)
        raise InputError(path, option, path.suffix or "no ending", expected)


def _identity(path: Path) -> tuple[int, int] | None:
    """Return device and number of an existing file, which all of its names share."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino


def _holds(path: Path, mark: str) -> bool:
    """Whether the beginning or the end of a file holds a mark."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
            file.seek(max(0, path.stat().st_size - _TAIL))
            return mark.encode() in head + b"\0" + file.read()
    except OSError:
        return False
