"""Answers that are put together when they are made: their words, tables and page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from butterfly.document import Told
from butterfly.errors import InputError
from butterfly.report.page import Page, write_html
from butterfly.result import Result, TextTable
from butterfly.verdict import Level, Verdict

if TYPE_CHECKING:
    from butterfly.report.inspection import Inspected


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Answer(Result):
    """An answer, its tables as they are printed, and its page.

    Parameters
    ----------
    content
        What it says, for programs.
    printed
        The tables that a command prints.
    draw
        Makes the page of `report`; None for a page of the tables alone.
    """

    content: Told
    printed: tuple[TextTable, ...] = ()
    draw: Callable[[], Page] | None = None

    @property
    def title(self) -> str:  # type: ignore[override]
        """What it is, in a line."""
        return self.content.title

    @property
    def summary(self) -> tuple[str, ...]:  # type: ignore[override]
        """What it says, the verdict first if there is one."""
        return self.content.summary

    @property
    def judged(self) -> Verdict | None:  # type: ignore[override]
        """The verdict on the estimate that it rests on; None if it rests on none."""
        return self.content.verdict

    def told(self) -> Told:
        """Return what it says, for programs."""
        return self.content

    def rows(self) -> list[dict[str, Any]]:
        """Return its first list of rows: of logs, candidates, terms, methods or estimates."""
        lists = (each for each in self.content.content.values() if isinstance(each, list))
        return next((rows for rows in lists if rows and isinstance(rows[0], dict)), [])

    def tables(self) -> list[TextTable]:
        """Return the tables that a command prints below the summary."""
        return list(self.printed)

    def page(self) -> Page:
        """Put together the page of `report`."""
        return super().page() if self.draw is None else self.draw()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Selection(Answer):
    """Terms chosen by how well they predict what was left out."""

    kind: ClassVar[str] = "selection"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Leaderboard(Answer):
    """Methods over data sets, the best of each first."""

    kind: ClassVar[str] = "leaderboard"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotModel(Answer):
    """The robot of an experiment, or the identified twin of data."""

    kind: ClassVar[str] = "model"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Residual(Answer):
    """The errors of the free runs, beside what sensors explain, and what they look like.

    Parameters
    ----------
    draw_worst
        Makes the page of the log with the largest error of those that were asked for.
    """

    kind: ClassVar[str] = "residual"

    draw_worst: Callable[[], Page]

    def plot(self, path: str | PathLike[str]) -> None:
        """Draw the residual torque and error of the log with the largest error to a page.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        write_html(self.draw_worst(), Path(path))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Inspection(Answer):
    """In which condition logs are, the worst first.

    Parameters
    ----------
    source
        The data, in words.
    logs
        What was found of each.
    """

    kind: ClassVar[str] = "inspection"

    source: str
    logs: tuple[Inspected, ...]

    @property
    def unusable(self) -> int:
        """How many logs cannot be used."""
        return sum(each.condition is Level.WARNING for each in self.logs)

    def require_usable(self) -> None:
        """Raise InputError if there are logs that cannot be used."""
        if self.unusable:
            expected = "logs without such faults"
            raise InputError(self.source, "logs", f"{self.unusable} that cannot be used", expected)

    def plot(self, path: str | PathLike[str]) -> None:
        """Draw the one log that was looked at to a page.

        Raises
        ------
        InputError
            If there are several, or the file cannot be written.
        """
        from butterfly.report.inspection import inspection_page  # noqa: PLC0415 - slow

        (only,) = self.logs if len(self.logs) == 1 else (None,)
        if only is None or only.log is None or only.health is None:
            raise InputError(self.source, "plot", f"{len(self.logs)} logs", "one log (--log N)")
        write_html(inspection_page(only.log, only.health), Path(path))
