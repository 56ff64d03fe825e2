"""What all results share: text, rows, a data frame, a page, and one form of JSON.

Every document has the keys of `HEAD`; docs/commands.md describes all keys.
"""

from __future__ import annotations

import math
import platform
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from butterfly import __version__
from butterfly.arguments import checked
from butterfly.errors import ButterflyError, visible
from butterfly.files import finite, write_document
from butterfly.progress import current_search
from butterfly.verdict import Level, Verdict

if TYPE_CHECKING:
    import pandas as pd
    from plotly.graph_objects import Figure

    from butterfly.report.page import Fact, Page, PageTable

_SCHEMA_NUMBER = 3
_THIRD = {"campaign", "comparison", "draws", "inspection", "residual", "sweep", "validation"}

HEAD = ("schema", "schema_number", "versions", "title", "verdict", "reasons", "summary", "units")
"""Keys that every document has."""

_LIBRARIES = ("mujoco", "numba", "scipy")  # not imported, since a simulator is slow to

_SIGNIFICANT, _WHOLE = 4, 1e6  # digits of a number; up to here whole ones have all of theirs


@cache
def versions() -> dict[str, str]:
    """Return the versions that results are made with."""
    return {
        "butterfly": __version__,
        "numpy": np.__version__,
        **{name: version(name) for name in _LIBRARIES},
        "python": platform.python_version(),
    }


def schema_number(kind: str) -> int:
    """Return the number of a kind's schema; raised when its keys change."""
    return _SCHEMA_NUMBER + (kind in _THIRD)


def document(
    kind: str,
    title: str,
    content: Mapping[str, Any],
    *,
    verdict: Verdict | None = None,
    summary: Sequence[str] = (),
    units: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Return a result for JSON; ``units``: those that no key or column names, by dotted key."""
    values: dict[str, Any] = finite(
        {
            "schema": f"butterfly.{kind}",
            "schema_number": schema_number(kind),
            "versions": versions(),
            "title": title,
            **({"verdict": None, "reasons": []} if verdict is None else verdict.numbers()),
            "summary": list(summary),
            "units": dict(units or {}),
            **content,
        }
    )
    return values


class Result(ABC):
    """A result that can be printed, tabulated, saved and reported."""

    kind: ClassVar[str]
    """Kind of result, in files."""

    short: ClassVar[bool] = False
    """Whether `print` shows its table."""

    brief: ClassVar[bool] = False
    """Whether a command prints its rows with --verbose alone, below them `further` tables."""

    sets_goal: ClassVar[bool] = False
    """Whether its headline says if a goal is reached, which a command says with --quiet too."""

    caption: ClassVar[str] = ""
    """What a page says of its rows."""

    title: str
    """Title in one line."""

    summary: tuple[str, ...]
    """Sentences in plain English: any headline, the verdict, then the most important."""

    judged: Verdict | None
    """Verdict on the underlying estimate; None without one."""

    @property
    def standing(self) -> str | None:
        """Level of the verdict on the underlying estimate: good, use with care, do not use."""
        return None if self.judged is None else self.judged.level.verdict

    @property
    def verdict(self) -> list[str]:
        """Lines of the verdict, the level first."""
        return [] if self.judged is None else list(self.judged.lines)

    @property
    def headline(self) -> tuple[str, ...]:
        """What leads the summary, above the verdict; nothing where that comes first."""
        first = next(iter(self.verdict), None)
        return self.summary[: self.summary.index(first)] if first in self.summary else ()

    @property
    def notes(self) -> list[str]:
        """The summary below the verdict."""
        return list(self.summary[len(self.headline) + len(self.verdict) :])

    @abstractmethod
    def rows(self) -> list[dict[str, Any]]:
        """Return the rows of its table, with units in the column names."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain values for JSON; None means unknown.

        The commands write it with ``--json``. It contains no path of this machine.
        """

    def shown_rows(self) -> list[dict[str, str]]:
        """Return `rows` formatted for reading."""
        return [{name: cell_text(value) for name, value in row.items()} for row in self.rows()]

    def paragraphs(self) -> list[str]:
        """Return what a command prints above its tables, any verdict first."""
        return list(self.summary)

    def tables(self) -> list[PageTable]:
        """Return the tables that a command prints below the summary: its rows, and `further`."""
        from butterfly.report.page import PageTable  # noqa: PLC0415 - a view

        rows = self.shown_rows()
        lines = [tuple(row.values()) for row in rows]
        more = self.brief, self.caption
        tables = [PageTable(self.title, tuple(rows[0]), lines, *more)] if rows else []
        return [*tables, *self.further()]

    def further(self) -> list[PageTable]:
        """Return the tables besides its rows."""
        return []

    def shown_lines(self) -> list[str]:
        """Return the table as `print` shows it, numbers right-aligned; nothing if not `short`."""
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
        """Return the most important numbers, for the first screen of its page."""
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
            remedy = "pip install 'butterfly-testbed[pandas]'"
            raise ButterflyError(f"to_dataframe needs pandas: {remedy}") from None
        return pd.DataFrame(self.rows())

    @checked
    def save(self, path: str | PathLike[str]) -> None:
        """Write the result as JSON for `butterfly.load`."""
        write_document(self.to_dict(), Path(path), sign=True)

    @checked
    def report(self, path: str | PathLike[str], *, figures: bool = False) -> None:
        """Write an offline page, with its numbers as JSON beside it.

        Parameters
        ----------
        path
            The file.
        figures
            Also write the figures as PNG and SVG.
        """
        from butterfly.report.page import write_page  # noqa: PLC0415 - a view

        write_page(self.page(), Path(path), figures=figures)

    def page(self) -> Page:
        """Return the page of `report`."""
        from butterfly.report.page import Page, Section  # noqa: PLC0415 - a view

        figures, numbers, tables = self.figures(), self.to_dict(), Result.tables(self)
        if self.rows():
            tables[0] = tables[0]._replace(title="In numbers")
        sections = [Section(title=table.title, tables=(table.on_page(),)) for table in tables]
        return Page(
            name=self.title,
            description=(numbers.get("data") or {}).get("description", ""),
            kind=self.kind,
            summary=[*self.headline, *self.notes],
            verdict=self.judged,
            facts=self.facts(),
            lead=Section(title="At a glance", figures=figures) if figures else None,
            sections=sections,
            numbers=numbers,
        )

    def __str__(self) -> str:
        return visible("\n".join([self.title, *self.summary, *self.shown_lines()]))

    def __repr__(self) -> str:
        return visible(f"<{type(self).__name__}: {self.title}{self._unless_good()}>")

    def _unless_good(self) -> str:
        """Return the level for one line; empty if good."""
        return f", {self.standing}" if self.standing not in {None, Level.GOOD.verdict} else ""

    def _repr_html_(self) -> str:
        from butterfly.report.page import cell_html  # noqa: PLC0415 - a view

        return cell_html(self.page())


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Answer(Result):
    """A result that is its JSON: all that is printed and drawn of it comes from there."""

    table: ClassVar[str] = "rows"
    """Key of its rows."""

    title: str
    summary: tuple[str, ...] = ()
    content: dict[str, Any]  # of `to_dict` besides `HEAD`; None means unknown
    judged: Verdict | None = None
    units: dict[str, str] = field(default_factory=dict)
    live: Callable[[Page], Page] | None = None  # adds figures of the logs; None if loaded

    def __post_init__(self) -> None:
        """Say what a stopped search skipped, and hold what a file would."""
        stopped = current_search().sentence
        if stopped and stopped not in self.summary:
            object.__setattr__(self, "summary", (*self.summary, stopped))
        object.__setattr__(self, "content", finite(self.content))

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], **more: Any) -> Self:  # noqa: ANN401 - own fields
        """Return the result of `to_dict`'s values.

        Raises
        ------
        KeyError, TypeError, ValueError
            If something is missing or invalid.
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
        """Return the document with its content (see `Result`)."""
        parts = self.kind, self.title, self.content
        return document(*parts, verdict=self.judged, summary=self.summary, units=self.units)

    def rows(self) -> list[dict[str, Any]]:
        """Return the rows of its table, with units in the column names."""
        return [dict(row) for row in self.content[self.table]]

    def page(self) -> Page:
        """Return the page of `report`."""
        plain = super().page()
        return plain if self.live is None else self.live(plain)


def cell_text(value: object) -> str:
    """Return a cell formatted for reading."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float) and value.is_integer() and abs(value) < _WHOLE:
        return f"{value:.0f}"
    return f"{value:.{_SIGNIFICANT}g}" if isinstance(value, float) else str(value)


def text(value: object) -> str:
    """Return a saved text; anything else is a TypeError."""
    if not isinstance(value, str):
        raise TypeError(f"{type(value).__name__} instead of a text")
    return value


def texts(values: object) -> tuple[str, ...]:
    """Return saved texts; anything else is a TypeError."""
    if not isinstance(values, list):
        raise TypeError(f"{type(values).__name__} instead of texts")
    return tuple(map(text, values))
