"""How a command ends, as a number for whoever called it."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from butterfly.verdict import Level


class ExitCode(IntEnum):
    """How a command ends."""

    DONE = 0
    NO_RESULT = 1
    BAD_INPUT = 2
    NOT_TO_BE_USED = 3
    STOPPED = 130
    UNREAD = 141

    @property
    def meaning(self) -> str:
        """What it says, in words."""
        return _MEANINGS[self]


def end_with(level: Level | None) -> None:
    """End with the exit code that says so, if what an answer rests on is not to be used."""
    if level is not None and not level.usable:
        raise typer.Exit(ExitCode.NOT_TO_BE_USED)


_MEANINGS = {
    ExitCode.DONE: "done",
    ExitCode.NO_RESULT: "some runs of a sweep gave no result",
    ExitCode.BAD_INPUT: "bad input",
    ExitCode.NOT_TO_BE_USED: "an answer not to be used: it did not converge, or warns of itself",
    ExitCode.STOPPED: "a sweep was stopped, by Ctrl-C or a signal to end; what is done is kept",
    ExitCode.UNREAD: "whoever read standard output closed it, as `head` does",
}
