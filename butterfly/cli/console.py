"""What the commands print with: tables and pages."""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from butterfly.cli.loudness import say_verdict

if TYPE_CHECKING:
    from collections.abc import Iterable

    from butterfly.report.page import Page


class _Console(Console):
    def on_broken_pipe(self) -> NoReturn:
        """Leave it to the program how it ends where nobody reads on."""
        raise BrokenPipeError


CONSOLE = _Console(markup=False, emoji=False)
"""Where tables go; brackets in names are brackets."""

if not CONSOLE.is_terminal:
    CONSOLE.width = 140  # a pipe has no width of its own, and folded numbers cannot be read back


def show_pairs(pairs: Iterable[tuple[str, str]]) -> None:
    """Print names and texts as a table without header."""
    table = Table(show_header=False, box=SIMPLE_HEAD)
    for name, text in pairs:
        table.add_row(name, text)
    CONSOLE.print(table)


def new_table(title: str, *headers: str) -> Table:
    """Return an empty table, its first column of texts and the others of numbers."""
    table = Table(title=title, box=SIMPLE_HEAD)
    for k, header in enumerate(headers):
        table.add_column(header, justify="left" if k == 0 else "right", overflow="fold")
    return table


def show_page(page: Page) -> None:
    """Print a report: its verdict, its tables, then what else it says."""
    if page.verdict is not None:
        say_verdict(page.verdict.sentence)
    for section in page.sections:
        for part in section.tables:
            table = new_table(section.title, *part.headers)
            for row in part.rows:
                table.add_row(*map(str, row))
            CONSOLE.print(table)
    for sentence in page.summary:
        typer.echo(sentence)
