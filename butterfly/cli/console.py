"""What the commands print with: sentences, tables and pages.

A pipe gets the same tables as a terminal of 80 columns (or of as many as ``COLUMNS`` says), but
each sentence in one line, which `grep` finds whole.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, NoReturn

import typer
from rich.console import Console

from butterfly.cli.loudness import print_verdict
from butterfly.cli.table_layout import folded, laid_out

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from butterfly.report.page import Page


class _Console(Console):
    def on_broken_pipe(self) -> NoReturn:
        """Leave it to the program how it ends where nobody reads on."""
        raise BrokenPipeError


CONSOLE = _Console(markup=False, emoji=False, highlight=False)
"""Where tables go; brackets in names are brackets."""

_PIPED = 80  # columns, where nobody says how many there are
_READABLE = 100  # characters in a line of a sentence, however wide a terminal is


def width() -> int:
    """Return how many characters a line has."""
    if CONSOLE.is_terminal:
        return CONSOLE.width
    said = os.environ.get("COLUMNS", "")
    return int(said) if said.isdigit() and int(said) > 0 else _PIPED


def say(sentence: str) -> None:
    """Print a sentence: folded between words on a terminal, in one line elsewhere."""
    typer.echo(_folded(sentence))


def say_verdict(sentence: str) -> None:
    """Print the verdict, which is what remains of an answer that is quiet."""
    print_verdict(_folded(sentence))


def _folded(sentence: str) -> str:
    if not CONSOLE.is_terminal:
        return sentence
    return "\n".join(folded(sentence, min(width(), _READABLE)))


def show_pairs(pairs: Iterable[tuple[str, str]]) -> None:
    """Print names and texts as a table without header."""
    (block,) = laid_out((), list(pairs), width(), lead=2).blocks
    typer.echo("\n".join(["", *block.lines, ""]))


def show_table(
    title: str, headers: Sequence[str], rows: Iterable[Sequence[object]], *, lead: int = 1
) -> None:
    """Print a table as it fits (see `laid_out`), headers and title bold on a terminal."""
    layout = laid_out(headers, [[str(cell) for cell in row] for row in rows], width(), lead=lead)
    _print("")
    _print(title, "bold")
    for block in layout.blocks:
        _print("")
        for line in block.lines:
            _print(line, "bold" if line in block.headers else "")
    if layout.notes:
        _print("")
        _print(f"  {headers[-1]}", "bold")
        for note in layout.notes:
            for line in folded(note, width() - 4, hanging="  "):
                _print(f"    {line}")
    _print("")


def show_page(page: Page) -> None:
    """Print a report: its verdict, then what else it says, then its tables."""
    if page.verdict is not None:
        say_verdict(page.verdict.sentence)
    for sentence in page.summary:
        say(sentence)
    for section in page.sections:
        for part in section.tables:
            show_table(section.title, part.headers, part.rows)


def _print(line: str, style: str = "") -> None:
    CONSOLE.print(line, style=style or None, soft_wrap=True)
