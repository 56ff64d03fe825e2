"""XML as it is written: where each element begins, and how its attributes change without the rest.

A parser that writes its tree again loses comments, digits and includes. Here expat says at which
byte each element begins, in whichever file it is, and only bytes of attributes are replaced.
"""

from __future__ import annotations

import codecs
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from butterfly.errors import InputError
from butterfly.files import read_file, require_path

_MARKED = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
_NAME = re.compile(r"<[^\s/>]+")
_ATTRIBUTE = re.compile(r"""\s+([^\s=/>]+)\s*=\s*("[^"]*"|'[^']*')""")
_INDENT = re.compile(r"\r?\n[ \t]*\Z")
_ESCAPES = {"&": "&amp;", "<": "&lt;", "\t": "&#9;", "\n": "&#10;", "\r": "&#13;"}
_QUOTES = {'"': "&quot;", "'": "&apos;"}


class Splice(NamedTuple):
    """Bytes of a file that others replace."""

    start: int
    end: int
    content: bytes


class XmlSource(NamedTuple):
    """A file as it is."""

    path: Path
    content: bytes
    encoding: str

    def text(self, start: int, end: int | None = None) -> str:
        """Return what is between two bytes."""
        return self.content[start:end].decode(self.encoding)

    def line(self, byte: int) -> int:
        """Return the line of a byte, from 1."""
        return self.text(0, byte).count("\n") + 1

    def splice(self, start: int, old: str, new: str) -> Splice:
        """Return what replaces a text that begins at a byte."""
        end = start + len(old.encode(self.encoding))
        return Splice(start, end, new.encode(self.encoding, "xmlcharrefreplace"))


@dataclass(eq=False)
class XmlElement:
    """An element, with the byte where it begins and, once it is read, that of its end tag."""

    tag: str
    attributes: dict[str, str]
    file: Path
    start: int
    parent: XmlElement | None
    end: int = 0
    children: list[XmlElement] = field(default_factory=list)

    @property
    def above(self) -> Iterator[XmlElement]:
        """Yield the elements that hold it, from the nearest to the root."""
        holder = self.parent
        while holder is not None:
            yield holder
            holder = holder.parent


@dataclass(kw_only=True, eq=False)
class XmlText:
    """A main file with all that it includes, as MuJoCo includes files.

    Each file by its path, the main one first; files included by an absolute path; all elements in
    their order, those of an included file in the place of its ``include``.
    """

    path: Path
    sources: dict[Path, XmlSource] = field(default_factory=dict)
    absolute: set[Path] = field(default_factory=set)
    elements: list[XmlElement] = field(default_factory=list)

    @classmethod
    def of(cls, path: Path, expected: str, including: str) -> XmlText:
        """Read a file, and what it includes if its root has the tag ``including``."""
        text = cls(path=path)
        _FileReader(text, path, None, including).read(expected)
        return text

    def place(self, element: XmlElement) -> str:
        """Return where an element begins, in words."""
        return f"{element.file.name} line {self.sources[element.file].line(element.start)}"


class _FileReader:
    """Reads one file, whose elements come in the place of its root where it is included."""

    def __init__(
        self, text: XmlText, path: Path, holder: XmlElement | None, including: str
    ) -> None:
        self._text, self._path, self._holder, self._including = text, path, holder, including
        self._encoding, self._open = "utf-8", list[XmlElement | None]()
        self._parser = expat.ParserCreate()

    def read(self, expected: str) -> None:
        """Read it; InputError, with ``expected``, if it is not there."""
        content, parser = read_file(self._path, expected), self._parser
        parser.specified_attributes = True
        parser.XmlDeclHandler, parser.EntityDeclHandler = self._declare, self._refuse
        parser.StartElementHandler, parser.EndElementHandler = self._begin, self._end
        self._text.sources[self._path] = XmlSource(self._path, content, "utf-8")
        try:
            parser.Parse(content, True)
        except InputError:
            raise
        except expat.ExpatError as error:
            problem = expat.ErrorString(error.code)
            raise InputError(
                self._path, f"line {error.lineno}", problem, "well-formed XML"
            ) from None
        except (LookupError, ValueError):  # unknown, or more than a byte for some letters
            raise InputError(self._path, "encoding", self._encoding, "UTF-8") from None
        self._encoding = _MARKED.get(content[:2], self._encoding)
        self._text.sources[self._path] = XmlSource(self._path, content, self._encoding)

    def _declare(self, _version: str, encoding: str | None, _standalone: int) -> None:
        self._encoding = encoding or self._encoding

    def _refuse(self, *_: object) -> None:
        line, expected = self._parser.CurrentLineNumber, "a file that defines no entities"
        raise InputError(self._path, f"line {line}", "<!ENTITY", expected)

    def _begin(self, tag: str, attributes: dict[str, str]) -> None:
        if not self._open and self._holder is not None:
            self._open.append(self._holder)
            return
        parent = self._open[-1] if self._open else None
        element = XmlElement(tag, attributes, self._path, self._parser.CurrentByteIndex, parent)
        self._open.append(element)
        self._text.elements.append(element)
        if parent is not None:
            parent.children.append(element)
        if tag == "include" and self._text.elements[0].tag == self._including:
            self._include(element)

    def _end(self, _tag: str) -> None:
        element = self._open.pop()
        if element is not None and element is not self._holder:
            element.end = self._parser.CurrentByteIndex

    def _include(self, element: XmlElement) -> None:
        """Read an included file: from the main file's folder, else from that of the including."""
        line, name = f"line {self._parser.CurrentLineNumber}", element.attributes.get("file", "")
        if not name:
            raise InputError(self._path, line, "<include> without a file", "its file")
        require_path(name, self._path, line)
        folders = (self._text.path.parent, self._path.parent)
        paths = [Path(os.path.normpath(folder / name)) for folder in folders]
        path = next((path for path in paths if path.exists()), paths[0])
        if any(is_same(path, other) for other in self._text.sources):
            raise InputError(self._path, line, f"{name}, a second time", "each file once")
        if Path(name).is_absolute():
            self._text.absolute.add(path)
        included = _FileReader(self._text, path, element.parent, self._including)
        included.read(f"the file that {self._path.name} includes in {line}")


def is_same(path: Path, other: Path) -> bool:
    """Whether two paths are of one existing file."""
    try:
        return path.samefile(other)
    except OSError:
        return False


class AttributeChange(NamedTuple):
    """An attribute that is set, replaced or removed, and its line in the file as it is."""

    line: int
    attribute: str
    before: str | None
    after: str | None


def changed(
    source: XmlSource, element: XmlElement, attributes: Mapping[str, str | None]
) -> tuple[list[AttributeChange], list[Splice]]:
    """Return the changes of an element's start tag, and the bytes that make them.

    Quotes, spaces and order remain; a new attribute follows the last one; None removes one.
    """
    text, line = source.text(element.start), source.line(element.start)
    written, end = _start_tag(text)
    quote = next(reversed(written.values()))[2][0] if written else '"'
    changes: list[AttributeChange] = []
    splices: list[Splice] = []
    added = ""
    for name, after in attributes.items():
        before, match = element.attributes.get(name), written.get(name)
        if before == after:
            continue
        below = text.count("\n", 0, match.start(1) if match else end)
        changes.append(AttributeChange(line + below, name, before, after))
        if match is None:
            added += f" {name}={_quoted(after or '', quote)}"
            continue
        first, last = match.span(2) if after is not None else match.span()
        new = _quoted(after, match[2][0]) if after is not None else ""
        byte = element.start + len(text[:first].encode(source.encoding))
        splices.append(source.splice(byte, text[first:last], new))
    if added:
        byte = element.start + len(text[:end].encode(source.encoding))
        splices.append(source.splice(byte, "", added))
    return changes, splices


def inserted(
    source: XmlSource, element: XmlElement, tag: str, attributes: Mapping[str, str]
) -> tuple[list[AttributeChange], list[Splice]]:
    """Return the changes by a new last child of an element, and the bytes that make it.

    It is indented as the first child is. InputError for an element without content.
    """
    text = source.text(element.start, element.end)
    head, _, content = text[_start_tag(text)[1] :].partition(">")
    if "/" in head:
        line = f"line {source.line(element.start)}"
        raise InputError(source.path, line, f"<{element.tag}/>", f"a <{element.tag}> with content")
    indent = _INDENT.search(content[: len(content) - len(content.lstrip())])
    quoted = "".join(f" {name}={_quoted(value, chr(34))}" for name, value in attributes.items())
    byte = element.start + len(text.rstrip().encode(source.encoding))
    line_before = source.line(byte)
    changes = [AttributeChange(line_before, name, None, new) for name, new in attributes.items()]
    new = f"{indent[0] if indent else ''}<{tag}{quoted}/>"
    return changes, [source.splice(byte, "", new)]


def spliced(content: bytes, splices: Sequence[Splice]) -> bytes:
    """Return a content with some of its bytes replaced."""
    for start, end, new in sorted(splices, reverse=True):
        content = content[:start] + new + content[end:]
    return content


def _start_tag(text: str) -> tuple[dict[str, re.Match[str]], int]:
    """Return each attribute of the start tag that a text begins with, and where the last ends."""
    opened, written = _NAME.match(text), dict[str, re.Match[str]]()
    end = opened.end() if opened else 0
    while match := _ATTRIBUTE.match(text, end):
        written[match[1]], end = match, match.end()
    return written, end


def _quoted(value: str, quote: str) -> str:
    """Return a value between quotes."""
    escapes = _ESCAPES | {quote: _QUOTES[quote]}
    return f"{quote}{''.join(escapes.get(letter, letter) for letter in value)}{quote}"
