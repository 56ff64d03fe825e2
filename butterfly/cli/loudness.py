"""How much a command prints: everything, the verdict alone (``--quiet``), or a document alone."""

from __future__ import annotations

import os
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import typer

if TYPE_CHECKING:
    from collections.abc import Iterator


@dataclass
class _Loudness:
    """What holds for the command that runs."""

    quiet: bool = False
    document_alone: bool = False
    kept: TextIO | None = None  # standard output, while what is printed goes nowhere

    def hush(self) -> None:
        """Print into nowhere, which is a file, for whoever asks standard output for its own."""
        if self.kept is None:
            nowhere = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - see `speak`
            self.kept, sys.stdout = sys.stdout, nowhere

    def speak(self) -> None:
        """Print everything again."""
        if self.kept is not None:
            sys.stdout.close()
            sys.stdout = self.kept
        self.quiet, self.document_alone, self.kept = False, False, None


_now = _Loudness()


@contextmanager
def one_command() -> Iterator[None]:
    """Print everything, until the command says otherwise; at the end everything again."""
    try:
        yield
    finally:
        _now.speak()


def be_quiet() -> None:
    """Print nothing more but the verdict, documents that were asked for, and errors."""
    _now.quiet = True
    _now.hush()


def print_document_alone() -> None:
    """Print nothing more but `print_document`, and errors."""
    _now.document_alone = True
    _now.hush()


def is_quiet() -> bool:
    """Whether nobody wants to know how far work has come."""
    return _now.quiet


def standard_output() -> TextIO:
    """Return where documents and verdicts go."""
    return _now.kept or sys.stdout


def print_verdict(sentence: str) -> None:
    """Print the verdict, which is what remains of an answer that is quiet."""
    if not _now.document_alone:
        typer.echo(sentence, file=standard_output())


def print_document(text: str) -> None:
    """Print a document that was asked for, however quiet the command is."""
    typer.echo(text, file=standard_output(), nl=False)


def writes_any_letter() -> bool:
    """Whether standard output takes all letters, or ASCII's for sure only."""
    encoding = getattr(standard_output(), "encoding", None) or ""
    return encoding.lower().startswith("utf")
