"""Tables laid out as lines that fit a width: numbers are never folded, and nothing is cut."""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.cells import cell_len

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    Rows = Sequence[Sequence[str]]

_INDENT, _GAP = 2, 2  # spaces before a line, and between columns
_PROSE = 24  # characters beyond which a cell of words may be folded at its spaces
_FEW_WORDS = 2  # of a cell that is never folded: an interval, say
_OF_A_NUMBER = 4  # words at most, with its unit and its error
_FOLDED = 3  # lines at most, into which it is
_MORE = 2  # columns that each block repeats at most, so that no two of its rows begin alike
_MANY = 3  # rows, up to which those that say the same are named
_EASY, _HEADER = 40, 3  # characters of words, lines of a header, where a table is split anyhow
_NUMBER = re.compile(r"[^\w]*[\d.]+(e[-+]?\d+)?([^\w]|$)")
_KEPT = re.compile(r"(?<=\d) (?=\S)|(?<=\bN) (?=m\b)|(?<=\bm) (?=s²?/rad)|(?<=\bkg) (?=m²)")
_GLUE = "\N{NO-BREAK SPACE}"


@dataclass(frozen=True)
class Block:
    """Columns of a table that stand side by side: lines of headers, and of each row."""

    headers: list[str]
    rows: list[list[str]]

    @property
    def lines(self) -> list[str]:
        """All of it, a rule below the headers."""
        body = [line for row in self.rows for line in row]
        if not self.headers:
            return body
        wide = max(map(cell_len, [*self.headers, *body])) - _INDENT
        return [*self.headers, " " * _INDENT + "─" * wide, *body]


@dataclass(frozen=True)
class Layout:
    """A table that fits a width.

    Parameters
    ----------
    blocks
        One where all columns fit side by side; else several, each with the leading columns.
    notes
        Texts too long for a column, each with the rows that it is about.
    """

    blocks: list[Block]
    notes: list[str]


def folded(text: str, width: int, *, hanging: str = "") -> list[str]:
    """Fold a text at its spaces, but not between a number and its unit, nor within that."""
    glued = _KEPT.sub(_GLUE, text)
    return [
        line.replace(_GLUE, " ")
        for line in textwrap.wrap(
            glued,
            max(width, 1),
            subsequent_indent=hanging,
            break_long_words=False,
            break_on_hyphens=False,
        )
    ] or [""]


def laid_out(headers: Sequence[str], rows: Rows, width: int, *, lead: int = 1) -> Layout:
    """Lay out a table.

    Columns without any text are left out. Headers are folded where need be, then texts; where that
    is not enough, or all say the same, the last column's texts are told below, and the rest is laid
    out in blocks.

    Parameters
    ----------
    headers, rows
        Texts; no headers for names and what is said of them.
    width
        In characters. Only what cannot be folded is wider.
    lead
        Columns at the left that name a row; each block repeats them, and those after them that it
        takes to tell rows apart.
    """
    names = headers or [""] * max(map(len, rows), default=0)
    columns = [
        _Column(name, [row[k] for row in rows], names=k < lead) for k, name in enumerate(names)
    ]
    told = [each for k, each in enumerate(columns) if k < lead or each.says]
    first, rest = told[:lead], told[lead:]
    notes: list[str] = []
    if len(rest) > 1 and rest[-1].prose and (rest[-1].same or not _fit([*first, *rest], width)):
        notes = _notes(first[0], rest.pop())
    split = not _fit([*first, *rest], width)
    if split:
        first, rest = _told_apart(first, rest)
    blocks: list[Block] = []
    while rest or not blocks:
        count = len(rest)
        while count > 1 and not _fit([*first, *rest[:count]], width, easily=split):
            count -= 1
        blocks.append(_block([*first, *rest[:count]], width, headed=bool(headers)))
        rest = rest[count:]
    return Layout(blocks, notes)


def _told_apart(first: list[_Column], rest: list[_Column]) -> tuple[list[_Column], list[_Column]]:
    """Take columns from the others until no two rows begin alike, if few do for that."""
    for more in range(_MORE + 1):
        leading = [*first, *rest[:more]]
        rows = list(zip(*(each.cells for each in leading), strict=True))
        if len(set(rows)) == len(rows):
            return leading, rest[more:]
    return first, rest


class _Column:
    """A column, and how narrow it may become."""

    def __init__(self, header: str, cells: Sequence[str], *, names: bool) -> None:
        self.header, self.cells = header, list(cells)
        told = [cell for cell in cells if _says(cell)]
        longest = max(map(cell_len, cells), default=0)
        self.says = bool(told) or not cells
        self.prose = longest > _PROSE and any(len(cell.split()) > _FEW_WORDS for cell in told)
        numbers = sum(
            _NUMBER.match(cell) is not None and len(cell.split()) <= _OF_A_NUMBER for cell in told
        )
        self.same = len(told) == len(cells) > 1 and len(set(told)) == 1
        self.right = not (names or self.prose) and 2 * numbers > len(told)
        least = self._width_of(_FOLDED) if self.prose else longest
        self.least = max(least, _longest_word([header]))
        self.most = max(longest, cell_len(header))
        self.easy = max(self.least, min(self.most, _EASY)) if self.prose else self.least
        while len(folded(header, self.easy)) > _HEADER:
            self.easy += 1
        self.width = self.most

    def _width_of(self, lines: int) -> int:
        """Return how wide its texts must be, to be folded into so many lines at most."""
        width = max(_longest_word(self.cells), _PROSE)
        while any(len(folded(cell, width)) > lines for cell in self.cells):
            width += 1
        return width

    def line(self, text: str) -> str:
        """Fill up a line of a cell."""
        space = " " * (self.width - cell_len(text))
        return space + text if self.right else text + space


def _says(cell: str) -> bool:
    return cell not in {"", "–"}


def _longest_word(texts: Iterable[str]) -> int:
    return max((cell_len(line) for text in texts for line in folded(text, 1)), default=0)


def _fit(columns: Sequence[_Column], width: int, *, easily: bool = False) -> bool:
    return _total([each.easy if easily else each.least for each in columns]) <= width


def _total(widths: Sequence[int]) -> int:
    return _INDENT + sum(widths) + _GAP * (len(widths) - 1)


def _block(columns: Sequence[_Column], width: int, *, headed: bool) -> Block:
    """Make columns as narrow as they must be, headers before texts, and write them."""
    for column in columns:
        column.width = column.most
    for prose in (False, True):
        while _total([each.width for each in columns]) > width:
            wide = [each for each in columns if each.prose is prose and each.width > each.least]
            if not wide:
                break
            max(wide, key=lambda each: each.width - each.least).width -= 1
    titles = _lines(columns, [each.header for each in columns], below=False) if headed else []
    rows = list(zip(*(each.cells for each in columns), strict=True))
    return Block(titles, [_lines(columns, row) for row in rows])


def _lines(columns: Sequence[_Column], cells: Sequence[str], *, below: bool = True) -> list[str]:
    """Write the cells of a row, folded; those of fewer lines at the top, or at the bottom."""
    parts = [
        folded(cell, each.width) if cell_len(cell) > each.width else [cell]
        for each, cell in zip(columns, cells, strict=True)
    ]
    high = max(map(len, parts))
    parts = [
        [*part, *[""] * (high - len(part))] if below else [*[""] * (high - len(part)), *part]
        for part in parts
    ]
    return [
        " " * _INDENT
        + (" " * _GAP)
        .join(each.line(text) for each, text in zip(columns, line, strict=True))
        .rstrip()
        for line in zip(*parts, strict=True)
    ]


def _notes(names: _Column, texts: _Column) -> list[str]:
    """Tell texts with the rows that they are about, each once; what most rows say comes last."""
    about: dict[str, list[str]] = {}
    for name, text in zip(names.cells, texts.cells, strict=True):
        about.setdefault(text, []).append(name)
    subjects = {text: "; ".join(rows) for text, rows in about.items() if _says(text)}
    usual = max(about, key=lambda text: len(about[text]))
    silent = len(subjects) < len(about)
    if not silent and len(names.cells) > 1 == len(about):
        subjects[usual] = "all"
    elif not silent and len(about[usual]) > max(_MANY, len(names.cells) // 2):
        subjects.pop(usual)
        subjects[usual] = "all others"
    return [f"{rows}: {text}" for text, rows in subjects.items()]
