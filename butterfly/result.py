"""The answer of a verb: text, rows, a data frame, a page, and one form of JSON.

Every document has the keys of `HEAD`; docs/commands.md describes all keys.
"""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

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

ANSWERS = (
    {"identification": _SCHEMA_NUMBER}
    | dict.fromkeys(("change", "design", "leaderboard", "model", "physical"), 4)
    | dict.fromkeys(("prediction", "run", "selection"), 4)
    | dict.fromkeys(("campaign", "comparison", "draws", "inspection"), 5)
    | dict.fromkeys(("residual", "sweep", "validation"), 5)
    | {"joints": 1, "results": 1}
)
"""Kinds of answers, which can be loaded, and the numbers of their schemas."""

SWEEP = "sweep.json"
"""File of a folder of results that lists their runs."""

_ROWS = {"inspection": "logs", "leaderboard": "entries", "sweep": "recovery"}
"""Keys of the rows of kinds that do not call them so."""

_SHORT = {"change", "physical"}
"""Kinds of which `print` shows the first table."""

_OF_RUNS = {"run", "sweep"}
"""Kinds that have no rows where every estimate failed."""

_GOAL = 2  # first sentences of a campaign: whether its goal is reached, and what to do next

_FEWEST = 3  # sentences that a notebook shows

HEAD = ("schema", "schema_number", "versions", "title", "verdict", "reasons", "summary", "units")
"""Keys that every document has."""

_LIBRARIES = ("mujoco", "numba", "scipy")  # not imported, since a simulator is slow to


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
    return ANSWERS.get(kind, _SCHEMA_NUMBER)


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


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Answer:
    """The answer of a verb: sentences, tables, figures, and numbers for programs.

    Everything that it prints and draws is in its content, which a file holds too.
    """

    kind: str
    """The kind of answer, in files too."""

    title: str
    """Title in one line."""

    summary: tuple[str, ...] = ()
    """Sentences in plain English: any headline, the verdict, then the most important."""

    content: dict[str, Any]
    """What `to_dict` has besides `HEAD`: numbers, rows, tables, facts, names of figures."""

    judged: Verdict | None = None
    """Verdict on the underlying estimate; None without one."""

    units: dict[str, str] = field(default_factory=dict)
    """Units that no key or column names, by dotted key."""

    identifications: Mapping[str, Any] = field(default_factory=dict)
    """Each `Identification` that it made or rests on, by estimator; none of most kinds."""

    reports: tuple[Path, ...] = ()
    """Pages that were written; none of most kinds, or if loaded."""

    note: str = ""
    """What was done before, or how many runs were done now; it is printed and not saved."""

    live: Callable[[Page], Page] | None = None
    """Adds figures of the logs to its page; None if loaded."""

    def __post_init__(self) -> None:
        """Say what a stopped search skipped, and hold what a file would."""
        stopped = current_search().sentence
        if stopped and stopped not in self.summary:
            object.__setattr__(self, "summary", (*self.summary, stopped))
        object.__setattr__(self, "content", finite(self.content))

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], **more: Any) -> Self:  # noqa: ANN401 - fields
        """Return the answer of `to_dict`'s values; ``more``: fields that are not saved.

        Raises
        ------
        KeyError, TypeError, ValueError
            If something is missing or invalid.
        """
        answer = cls(
            kind=text(content["schema"]).removeprefix("butterfly."),
            title=text(content["title"]),
            summary=texts(content["summary"]),
            content={key: content[key] for key in content if key not in HEAD},
            judged=Verdict.of_numbers(content),
            units={str(key): str(unit) for key, unit in content.get("units", {}).items()},
            **more,
        )
        rows = answer.rows()
        if not rows and answer.kind not in _OF_RUNS:
            raise ValueError("no rows")
        if "rows" in content and len({tuple(row) for row in rows}) > 1:
            raise ValueError("rows with different columns")
        for table in answer.tables():
            widths = {len(texts([*row])) for row in table.rows}
            if table.headers and widths != {len(texts(table.headers))}:
                raise ValueError("lines and headers of different lengths")
        return answer

    @property
    def identification(self) -> Any:  # noqa: ANN401 - an `Identification`
        """The first of its identifications; None without one."""
        return next(iter(self.identifications.values()), None)

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
        """The sentences above the verdict; none if the verdict comes first."""
        first = next(iter(self.verdict), None)
        if first in self.summary:
            return self.summary[: self.summary.index(first)]
        return self.summary[:_GOAL] if self.kind == "campaign" else ()

    @property
    def sets_goal(self) -> bool:
        """Whether its headline says if a goal is reached, which a command says with --quiet too."""
        return self.kind in {"campaign", "run"}

    @property
    def notes(self) -> list[str]:
        """The summary below the verdict."""
        return list(self.summary[len(self.headline) + len(self.verdict) :])

    @property
    def first_lines(self) -> tuple[str, ...]:
        """The lines that it prints first: title, headline and verdict; a notebook begins so too."""
        first = max(len(self.headline) + len(self.verdict), _FEWEST)
        return self.title, *self.summary[:first]

    def rows(self) -> list[dict[str, Any]]:
        """Return the rows of its table, with units in the column names."""
        return [dict(row) for row in self.content[_ROWS.get(self.kind, "rows")]]

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as plain values for JSON; None means unknown.

        The commands write it with ``--json``. It contains no path of this machine.
        """
        parts = self.kind, self.title, self.content
        return document(*parts, verdict=self.judged, summary=self.summary, units=self.units)

    def paragraphs(self) -> list[str]:
        """Return what a command prints above its tables: the summary, its note after the top."""
        return [*self.summary[:1], *([self.note] if self.note else []), *self.summary[1:]]

    def tables(self) -> list[PageTable]:
        """Return the tables that a command prints below the summary."""
        from butterfly.report.page import PageTable  # noqa: PLC0415 - a view

        return [PageTable.of_plain(table) for table in self.content["tables"]]

    def printed(self) -> PageTable | None:
        """Return the table that `print` shows, if any."""
        return next(iter(self.tables()), None) if self.kind in _SHORT else None

    def shown_lines(self) -> list[str]:
        """Return the lines of the table that `print` shows, numbers right-aligned."""
        table = self.printed()
        lines = [] if table is None else [[*map(str, r)] for r in (table.headers, *table.rows)]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        return [
            "  ".join([first.ljust(widths[0]), *map(str.rjust, others, widths[1:])])
            for first, *others in lines
        ]

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page that its numbers make, by name."""
        from butterfly.report.answer_page import figures_of  # noqa: PLC0415 - slow to import

        return figures_of(self.to_dict())

    def facts(self) -> list[Fact]:
        """Return the most important numbers, for the first screen of its page."""
        from butterfly.report.page import Fact  # noqa: PLC0415 - a view

        return [Fact(**fact) for fact in self.content["facts"]]

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
        """Write the answer as JSON for `butterfly.load`."""
        write_document(self.to_dict(), Path(path), sign=True)

    @checked
    def report(
        self, path: str | PathLike[str], *, figures: bool = False, numbers: bool = True
    ) -> None:
        """Write an offline page, with its numbers as JSON beside it.

        Parameters
        ----------
        path
            The file.
        figures
            Also write the figures as PNG and SVG.
        numbers
            Write the JSON; not needed if the answer is saved.
        """
        from butterfly.report.page import write_page  # noqa: PLC0415 - a view

        write_page(self.page(), Path(path), figures=figures, numbers=numbers)

    def page(self) -> Page:
        """Return the page of `report`."""
        from butterfly.report.answer_page import answer_page  # noqa: PLC0415 - slow to import

        plain = answer_page(self.to_dict())
        return plain if self.live is None else self.live(plain)

    def __str__(self) -> str:
        return visible("\n".join([self.title, *self.summary, *self.shown_lines()]))

    def __repr__(self) -> str:
        return visible(f"<{self.kind.capitalize()}: {self.title}{self._unless_good()}>")

    def _unless_good(self) -> str:
        """Return the level for one line; empty if good."""
        return f", {self.standing}" if self.standing not in {None, Level.GOOD.verdict} else ""

    def _repr_html_(self) -> str:
        from butterfly.report.page import cell_html  # noqa: PLC0415 - a view

        return cell_html(self.page(), self.first_lines)


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
