"""What all results have in common: words, rows, a frame, a page, and the one form of JSON.

Every document has the keys of `HEAD`; docs/commands.md says what they and the others hold.
"""

from __future__ import annotations

import math
import platform
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np

from butterfly import __version__
from butterfly.errors import ButterflyError
from butterfly.files import finite, write_document
from butterfly.progress import current_search
from butterfly.verdict import Level, Verdict

if TYPE_CHECKING:
    import pandas as pd
    from plotly.graph_objects import Figure

    from butterfly.report.page import Fact, Page

SCHEMA_NUMBER = 2
"""Of a document; raised when an older program could no longer read it."""

HEAD = ("schema", "schema_number", "versions", "title", "verdict", "reasons", "summary", "units")
"""Keys that every document has."""

_LIBRARIES = ("mujoco", "numba", "scipy")  # not imported for that: a simulator is slow to

_SIGNIFICANT, _WHOLE = 4, 1e6  # digits of a number; up to here whole ones have all of theirs


@cache
def versions() -> dict[str, str]:
    """Return what results are made with."""
    return {
        "butterfly": __version__,
        "numpy": np.__version__,
        **{name: version(name) for name in _LIBRARIES},
        "python": platform.python_version(),
    }


def document(
    kind: str,
    title: str,
    content: Mapping[str, Any],
    *,
    verdict: Verdict | None = None,
    summary: Sequence[str] = (),
    units: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Return what commands and results say for programs, as JSON can hold it.

    The ``units`` are of quantities whose own key or column does not say it, by their keys, with
    dots between; None stands for what is unknown.
    """
    found: dict[str, Any] = finite(
        {
            "schema": f"butterfly.{kind}",
            "schema_number": SCHEMA_NUMBER,
            "versions": versions(),
            "title": title,
            **({"verdict": None, "reasons": []} if verdict is None else verdict.numbers()),
            "summary": list(summary),
            "units": dict(units or {}),
            **content,
        }
    )
    return found


class TextTable(NamedTuple):
    """A table as a command prints it; of empty headers, names and what belongs to them."""

    title: str
    headers: Sequence[str]
    rows: Sequence[Sequence[object]]

    @classmethod
    def of_page(cls, page: Page) -> tuple[TextTable, ...]:
        """Return the tables of a page's sections."""
        return tuple(
            cls(section.title, [*map(str, each.headers)], [[*map(str, row)] for row in each.rows])
            for section in page.sections
            for each in section.tables
        )


class Result(ABC):
    """A result that can be looked at, tabulated, saved and reported."""

    kind: ClassVar[str]
    """What it is, in files."""

    short: ClassVar[bool] = False
    """Whether its table is, so that `print` shows it."""

    schema_number: ClassVar[int] = SCHEMA_NUMBER
    """Of its JSON; raised when an older program could no longer read it."""

    title: str
    """What it is, in a line."""

    summary: tuple[str, ...]
    """What it says, in plain English, the verdict first, then the most important."""

    judged: Verdict | None
    """The verdict on the estimate that it rests on; None if there is none, or none was saved."""

    @property
    def standing(self) -> str | None:
        """What may be done with the estimate that it rests on: good, use with care, do not use."""
        return None if self.judged is None else self.judged.level.verdict

    @property
    def verdict(self) -> list[str]:
        """How far to trust it, in words: first what may be done with it."""
        return [] if self.judged is None else list(self.judged.lines)

    @property
    def notes(self) -> list[str]:
        """What the summary says below the verdict."""
        return list(self.summary[len(self.judged.lines) if self.judged else 0 :])

    @abstractmethod
    def rows(self) -> list[dict[str, Any]]:
        """Return the table that it is about, a row each, units in the names of its columns."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain values that JSON can hold; None stands for what is unknown.

        It is what the commands write with ``--json``, and holds no path of this machine.
        """

    def shown_rows(self) -> list[dict[str, str]]:
        """Return `rows` as a person reads them."""
        return [{name: cell_text(value) for name, value in row.items()} for row in self.rows()]

    def paragraphs(self) -> list[str]:
        """Return what a command prints above its tables, the verdict first if there is one."""
        return list(self.summary)

    def tables(self) -> list[TextTable]:
        """Return the tables that a command prints below the summary."""
        rows = self.shown_rows()
        if not rows:
            return []
        return [TextTable(self.title, tuple(rows[0]), [tuple(row.values()) for row in rows])]

    def shown_lines(self) -> list[str]:
        """Return what `print` shows of the table, numbers at the right; nothing if not `short`."""
        rows = self.shown_rows() if self.short else []
        table = [list(row) for row in rows[:1]] + [list(row.values()) for row in rows]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        return [
            "  ".join([line[0].ljust(widths[0]), *map(str.rjust, line[1:], widths[1:])])
            for line in table
        ]

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        return {}

    def facts(self) -> list[Fact]:
        """Return the numbers that matter most, for the first screen of its page."""
        return []

    def to_dataframe(self) -> pd.DataFrame:
        """Return `rows` as a pandas frame.

        Raises
        ------
        ButterflyError
            If pandas is not installed.
        """
        try:
            import pandas as pd  # noqa: PLC0415 - an extra
        except ImportError:
            raise ButterflyError(
                "to_dataframe needs pandas: pip install 'butterfly-testbed[pandas]'"
            ) from None
        return pd.DataFrame(self.rows())

    def save(self, path: str | PathLike[str]) -> None:
        """Write the result as JSON, which `butterfly.load` reads.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        write_document(self.to_dict(), Path(path))

    def report(self, path: str | PathLike[str], *, figures: bool = False) -> None:
        """Write a page that opens offline, and its numbers as JSON beside it.

        Parameters
        ----------
        path
            The file.
        figures
            Whether to write the figures as PNG and SVG too.

        Raises
        ------
        InputError
            If a file cannot be written.
        """
        from butterfly.report.page import write_page  # noqa: PLC0415 - a view

        write_page(self.page(), Path(path), figures=figures)

    def page(self) -> Page:
        """Put together the page of `report`."""
        from butterfly.report.page import Page, PageTable, Section  # noqa: PLC0415 - a view

        rows, figures = self.shown_rows(), self.figures()
        headers = tuple(rows[0]) if rows else ()
        lines = [tuple(row.values()) for row in rows]
        words = [k for k in range(len(headers)) if any(line[k][:1].isalpha() for line in lines)]
        table = PageTable(headers=headers, rows=lines, words=tuple(words))
        return Page(
            name=self.title,
            description="",
            kind=self.kind,
            summary=self.notes,
            verdict=self.judged,
            facts=self.facts(),
            lead=Section(title="At a glance", figures=figures) if figures else None,
            sections=[Section(title="In numbers", tables=(table,))],
            numbers=self.to_dict(),
        )

    def __str__(self) -> str:
        return "\n".join([self.title, *self.summary, *self.shown_lines()])

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.title}{self._unless_good()}>"

    def _unless_good(self) -> str:
        """Return what a line says of the verdict: nothing if it is good."""
        return f", {self.standing}" if self.standing not in {None, Level.GOOD.verdict} else ""

    def _repr_html_(self) -> str:
        from butterfly.report.cell import cell_html  # noqa: PLC0415 - a view

        return cell_html(self.page())


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Answer(Result):
    """A result that is its JSON: what a verb found, and how a command prints and draws it."""

    table: ClassVar[str] = "rows"
    """Key of its rows."""

    title: str
    summary: tuple[str, ...] = ()
    content: dict[str, Any]  # what `to_dict` says besides what all say
    judged: Verdict | None = None
    units: dict[str, str] = field(default_factory=dict)
    printed: tuple[TextTable, ...] = ()  # by a command; its rows if there are none
    live: Page | None = None  # that draws it; none of a result that was loaded

    def __post_init__(self) -> None:
        """Say what its search left out, if that was stopped."""
        stopped = current_search().sentence
        if stopped and stopped not in self.summary:
            object.__setattr__(self, "summary", (*self.summary, stopped))

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], **more: Any) -> Self:  # noqa: ANN401 - own fields
        """Return what `to_dict` gave.

        Raises
        ------
        KeyError, TypeError, ValueError
            If something is missing, or not what it should be.
        """
        rows = [dict(row) for row in content[cls.table]]
        return cls(
            title=text(content["title"]),
            summary=texts(content["summary"]),
            content={key: content[key] for key in content if key not in HEAD} | {cls.table: rows},
            judged=Verdict.of_numbers(content),
            units={str(key): str(unit) for key, unit in content.get("units", {}).items()},
            **more,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return what all results say, and the content (see `Result`)."""
        found = self.kind, self.title, self.content
        return document(*found, verdict=self.judged, summary=self.summary, units=self.units)

    def rows(self) -> list[dict[str, Any]]:
        """Return the table that it is about, a row each, units in the names of its columns."""
        return [dict(row) for row in self.content[self.table]]

    def tables(self) -> list[TextTable]:
        """Return the tables that a command prints below the summary."""
        return list(self.printed) or super().tables()

    def page(self) -> Page:
        """Put together the page of `report`."""
        return self.live or super().page()

    def drawn_as(self, page: Page) -> Self:
        """Return the same with a page, whose tables a command prints unless there are others."""
        return replace(self, live=page, printed=self.printed or TextTable.of_page(page))


def cell_text(value: object) -> str:
    """Return a cell as a person reads it."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, float) and value.is_integer() and abs(value) < _WHOLE:
        return f"{value:.0f}"
    return f"{value:.{_SIGNIFICANT}g}" if isinstance(value, float) else str(value)


def text(value: object) -> str:
    """Return a text that was saved; anything else is a TypeError."""
    if not isinstance(value, str):
        raise TypeError(f"{type(value).__name__} instead of a text")
    return value


def texts(values: object) -> tuple[str, ...]:
    """Return texts that were saved; anything else is a TypeError."""
    if not isinstance(values, list):
        raise TypeError(f"{type(values).__name__} instead of texts")
    return tuple(map(text, values))
