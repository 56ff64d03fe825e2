"""Damaged identifications that were saved, as the commands that go on from them take them."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

from tests.fuzz.command import escape_of_command
from tests.fuzz.results import kept_logs


@cache
def sound() -> bytes:
    """Return a saved identification."""
    with tempfile.TemporaryDirectory() as folder:
        logs, saved = Path(folder) / "logs", Path(folder) / "saved.json"
        for name, content in kept_logs().items():
            logs.mkdir(exist_ok=True)
            (logs / name).write_bytes(content)
        escape_of_command("identify", logs, "--method", "weak-form", "--save", saved)
        return saved.read_bytes()


def escapes(content: bytes, path: Path) -> str:
    """Compare a damaged identification with a sound one, and show its model."""
    before, after = path.with_suffix(".before.json"), path.with_suffix(".after.json")
    before.write_bytes(sound())
    after.write_bytes(content)
    looks = [("compare", before, after), ("inspect", after)]
    return next(filter(None, (escape_of_command(*words) for words in looks)), "")
