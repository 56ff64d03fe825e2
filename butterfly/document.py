"""The one form of all answers in JSON, and its one writer.

Every document has the keys of `HEAD`; docs/commands.md says what they and the others hold.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from butterfly import __version__
from butterfly.files import finite, replacing
from butterfly.verdict import Verdict

SCHEMA_NUMBER = 2
"""Of a document; raised when an older program could no longer read it."""

HEAD = ("schema", "schema_number", "versions", "title", "verdict", "reasons", "summary", "units")
"""Keys that every document has."""

_LIBRARIES = ("mujoco", "numba", "scipy")  # not imported for that: a simulator is slow to


@cache
def versions() -> dict[str, str]:
    """Return what results are made with."""
    return {
        "butterfly": __version__,
        "numpy": np.__version__,
        **{name: version(name) for name in _LIBRARIES},
        "python": platform.python_version(),
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class Told:
    """What an answer says."""

    kind: str  # Of answer: its schema is called `butterfly.KIND`
    title: str  # What it is, in a line
    verdict: Verdict | None = None  # On the estimate that it rests on; None if it rests on none
    summary: tuple[str, ...] = ()  # What it says, in plain English, the verdict first
    # The rest, as JSON can hold it but for numbers that are not finite
    content: Mapping[str, Any] = field(default_factory=dict)
    # Of quantities whose own key or column does not say it, by their keys, with dots between
    units: Mapping[str, str] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """Return it as JSON can hold it; None stands for what is unknown."""
        judged = (
            {"verdict": None, "reasons": []} if self.verdict is None else self.verdict.numbers()
        )
        head = {
            "schema": f"butterfly.{self.kind}",
            "schema_number": SCHEMA_NUMBER,
            "versions": versions(),
            "title": self.title,
            **judged,
            "summary": list(self.summary),
            "units": dict(self.units),
        }
        said: dict[str, Any] = finite({**head, **self.content})
        return said


def json_text(document: Mapping[str, Any], *, ascii_only: bool = False) -> str:
    """Return a document as text.

    `document`: Without numbers that JSON does not have (see `finite`); `ascii_only`: Whether to
    write other letters as escapes, for what cannot take them.
    """
    return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=ascii_only) + "\n"


def write_document(document: Mapping[str, Any], path: Path) -> None:
    """Write a document to a file.

    Raises InputError if the file cannot be written.
    """
    with replacing(path) as draft:
        draft.write_text(json_text(finite(document)), encoding="utf-8")
