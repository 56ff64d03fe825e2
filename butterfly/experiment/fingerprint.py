"""What code a result was made by."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from butterfly.resources import shipped

COMPUTING = ("model", "plant", "signals", "logs", "identify", "orbit", "experiment")
"""The subpackages that a run computes with."""

_PACKAGE = Path(__file__).parents[1]


@cache
def fingerprint() -> str:
    """Return a hash over the sources that a run computes with, and the shipped robots.

    It takes some milliseconds, once for a process.
    """
    models = shipped("models")
    return hash_of(
        {
            path.relative_to(_PACKAGE).as_posix(): path
            for name in COMPUTING
            for path in (_PACKAGE / name).rglob("*.py")
        }
        | {path.relative_to(models).as_posix(): path for path in models.rglob("*.xml")}
    )


def hash_of(files: dict[str, Path]) -> str:
    """Return a hash over the names and contents of files, whatever their order."""
    total = hashlib.sha256()
    for name, path in sorted(files.items()):
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        total.update(f"{name} {content}\n".encode())
    return total.hexdigest()
