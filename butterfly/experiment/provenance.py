"""What a result was made with: the code that computes, and the versions of what it rests on."""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

from butterfly import __version__
from butterfly.files import shipped

COMPUTING = ("model", "plant", "signals", "logs", "identification", "thesis", "orbit", "experiment")
"""The subpackages that a run computes with."""

_PACKAGE = Path(__file__).parents[1]
_OTHERS = ("mujoco", "numba", "scipy")  # not imported for that: a simulator is slow to


@cache
def versions() -> dict[str, str]:
    """Return what the result was made with."""
    return {
        "butterfly": __version__,
        "numpy": np.__version__,
        **{name: version(name) for name in _OTHERS},
        "python": platform.python_version(),
    }


@cache
def fingerprint() -> str:
    """Return a hash over `computing_sources`; it takes some milliseconds, once for a process."""
    return hash_of(computing_sources())


def computing_sources() -> dict[str, Path]:
    """Return the files that a run computes with, by name: sources, and the shipped robots."""
    models = shipped("models")
    files = {name: (_PACKAGE / name).rglob("*.py") for name in COMPUTING}
    return {
        path.relative_to(_PACKAGE).as_posix(): path for paths in files.values() for path in paths
    } | {path.relative_to(models).as_posix(): path for path in models.rglob("*.xml")}


def hash_of(files: dict[str, Path]) -> str:
    """Return a hash over the names and contents of files, whatever their order."""
    total = hashlib.sha256()
    for name, path in sorted(files.items()):
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        total.update(f"{name} {content}\n".encode())
    return total.hexdigest()
