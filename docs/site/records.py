"""What a picture of docs/pictures shows, in a file of numbers and words beside it.

A record names the command that made the picture, quotes what pages quote of that command's answer,
and lists every text that a reader can see in the picture. The tests hold it against the pages.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from outputs import DOCS, MARK, as_shown

PICTURES = DOCS / "pictures"


def record_of(name: str) -> dict[str, Any]:
    """Return the record beside a picture."""
    text = (PICTURES / f"{name}.json").read_text(encoding="utf-8")
    record: dict[str, Any] = json.loads(text)
    return record


def write_record(picture: Path, record: dict[str, Any]) -> None:
    """Write a record beside its picture, with the digest of the picture that it is of."""
    text = json.dumps(record | {"digest": digest(picture)}, ensure_ascii=False, indent=1)
    picture.with_suffix(".json").write_text(f"{text}\n", encoding="utf-8")


def digest(picture: Path) -> str:
    """Return what tells one drawing of a picture from another."""
    return hashlib.sha256(picture.read_bytes()).hexdigest()[:16]


def recorded(command: str, shown: Iterable[str], answer: str = "") -> dict[str, Any]:
    """Return the record of what a command made, and of its answer where pages quote it."""
    quotations = {
        f"{mark['keep']} {mark['what']}": as_shown(answer, mark).splitlines()
        for mark in quoting(command)
        if answer
    }
    return {"command": command, "quoted": quotations, "shown": [*shown]}


def quoting(command: str) -> list[re.Match[str]]:
    """Return the marks on pages between which a command's answer stands."""
    return [mark for mark in marks() if mark["command"].strip() == command]


def marks() -> list[re.Match[str]]:
    """Return all marks on pages."""
    pages = [path.read_text(encoding="utf-8") for path in sorted(DOCS.glob("*.md"))]
    return [mark for page in pages for mark in MARK.finditer(page)]


def texts_of(figure: Path) -> list[str]:
    """Return the texts of a figure, which its SVG has as comments: axes, marks, legend."""
    parser = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))  # noqa: S314 - our own
    drawing = ET.parse(figure.with_suffix(".svg"), parser)  # noqa: S314
    return [(node.text or "").strip() for node in drawing.iter(ET.Comment)]
