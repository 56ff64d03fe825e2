"""A report: one HTML file that opens offline, its figures as pictures, its numbers as JSON."""

from __future__ import annotations

import gzip
import json
import math
import shlex
import sys
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from butterfly.files import write_document, write_file
from butterfly.identification.trust import Parameter, Trust
from butterfly.outputs import mark_of, require_endings, require_free
from butterfly.report.format import cell_text
from butterfly.verdict import VERDICTS, Level, Verdict

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from butterfly.report.figures import Series

MOST = 100.0
"""Per cent of the value at which the axis ends: beyond it a value may be 0."""


class Axis(NamedTuple):
    """The axis of a forest plot, as the header of its column: powers of ten in per cent."""

    first: int
    last: int

    @property
    def decades(self) -> list[float]:
        """The per cents of its marks, evenly spaced."""
        return [10.0**power for power in range(self.first, self.last + 1)]

    def place(self, percent: float) -> float:
        """Return where a size is, from 0 to 100 along the axis: at an end if beyond it."""
        power = math.log10(self.clipped(percent))
        return round(100 * (power - self.first) / (self.last - self.first), 2)

    def clipped(self, percent: float) -> float:
        """Return a size as it is drawn."""
        return min(max(abs(percent), self.decades[0]), self.decades[-1])

    def __str__(self) -> str:
        return ""


class Bar(NamedTuple):
    """A row of a forest plot: sizes in per cent of a value; None where there is nothing to draw."""

    axis: Axis
    half_width: float | None  # of the 95 % interval, up to its farther limit
    left_out: float | None  # deviation of the farthest estimate without one mass
    true: float | None  # deviation of the truth
    may_be_zero: bool

    def __str__(self) -> str:
        return ""


def forest(rows: Sequence[Parameter]) -> list[Bar]:
    """Return the rows of an estimate's table as bars on one axis, which ends at 100 % at most."""
    marks = []
    for row in rows:
        limits = (None, None) if row.known else (row.lower, row.upper)
        half = _farthest(row.value, *limits)
        left_out = _farthest(row.value, row.least_left_out, row.largest_left_out)
        zero = half is not None and (row.lower or 0.0) <= 0.0 <= (row.upper or 0.0)
        marks.append((half, left_out, _farthest(row.value, row.true, row.true), zero))
    sizes = [min(size, MOST) for half, deviation, *_ in marks for size in (half, deviation) if size]
    powers = [math.log10(size) for size in sizes]
    last = math.ceil(max(powers, default=math.log10(MOST)))
    axis = Axis(min(math.floor(min(powers, default=last)), last - 1), last)
    return [Bar(axis, *mark) for mark in marks]


def _farthest(value: float | None, *limits: float | None) -> float | None:
    """Return how far the farther limit is from a value, in per cent of it; endless of 0."""
    if value is None:
        return None
    known = [limit for limit in limits if limit is not None and math.isfinite(limit - value)]
    if len(known) < len(limits):
        return None
    most = max(abs(limit - value) for limit in known)
    if value == 0.0:
        return math.inf if most else 0.0
    return 100 * most / abs(value)


def forest_caption(bars: Sequence[Bar]) -> str:
    """Explain the marks of a forest plot, those that it has."""
    if all(bar.half_width is None for bar in bars):
        return ""
    parts = [
        "Bars: half-width of the 95 % interval in % of the value, on a logarithmic axis; shorter "
        "is better."
    ]
    if any(bar.may_be_zero for bar in bars):
        parts.append("Orange: the interval includes 0.")
    if any(bar.left_out for bar in bars):
        parts.append(
            "Grey: the farthest estimate without the logs of one added mass, which the interval "
            "includes; where it is long, the model lacks something that depends on the mass."
        )
    if any(bar.true is not None for bar in bars):
        parts.append("Green: distance to the true value.")
    return " ".join(parts)


_PLOTLY = Path(__file__).parent / "plotly_js/plotly-cartesian.min.js.gz"
_Row = TypeVar("_Row")


class Marked(NamedTuple):
    """A text in a table, with a link to a file, a level of gravity or its meaning."""

    text: str
    href: str = ""  # from the report on
    level: Level | None = None
    meaning: str = ""

    def __str__(self) -> str:
        return self.text


class Fact(NamedTuple):
    """A number shown large on a page's first screen, with its label and a detail."""

    label: str
    value: str
    detail: str = ""


class Badge(NamedTuple):
    """The verdict on top of a page: its level, a short text, and separate reasons."""

    level: Level
    text: str
    reasons: Sequence[str]


class PageTable(NamedTuple):
    """Rows of texts, or on a page `Marked` and `Bar`, under headers; without headers, pairs."""

    title: str = ""  # as it is printed; on a page its section has one
    headers: Sequence[str | Axis] = ()  # with units
    rows: Sequence[Sequence[object]] = ()
    detail: bool = False  # whether it is printed with --verbose alone
    caption: str = ""  # on a page
    name: str = ""  # by which a page's links and programs find it
    words: tuple[int, ...] = ()  # columns of text: on the left, broken into lines; so is the first
    picks: Sequence[int] = ()  # for each row the number of the log that it chooses

    @classmethod
    def of(
        cls,
        title: str,
        rows: Sequence[_Row],
        columns: Mapping[str, Callable[[_Row], object]] | None = None,
        **more: Any,  # noqa: ANN401 - other fields
    ) -> PageTable:
        """Tabulate rows: each column has a header, and makes a cell of a row.

        Without columns a row is a mapping, whose keys are headers.
        """
        chosen: Any = columns
        if columns is None:
            first: Any = rows[:1]
            chosen = {key: itemgetter(key) for row in first for key in row}
        cells = [tuple(cell_text(cell(row)) for cell in chosen.values()) for row in rows]
        return cls(title, tuple(chosen), cells, **more)

    def plain(self) -> dict[str, Any]:
        """Return what is printed of it, as JSON holds it."""
        return {
            "title": self.title,
            "headers": [*map(str, self.headers)],
            "rows": [[*map(str, row)] for row in self.rows],
            "detail": self.detail,
            "caption": self.caption,
        }

    @classmethod
    def of_plain(cls, content: Mapping[str, Any]) -> PageTable:
        """Return the table of which `plain` made a content."""
        return cls(**{**content, "rows": [tuple(row) for row in content["rows"]]})

    def on_page(self) -> PageTable:
        """Return it with texts and the badges of verdicts, and what columns have words."""
        texts = [[*map(str, row)] for row in self.rows]
        rated = {k for k, header in enumerate(self.headers) if k and str(header) in _RATED}
        rows = [
            tuple(_badged(cell) if k in rated else cell for k, cell in enumerate(row))
            for row in texts
        ]
        some = (k for k in range(len(self.headers)) if any(row[k][:1].isalpha() for row in texts))
        return self._replace(rows=rows, words=tuple(some))


_RATED = {"", "verdict"}
"""Headers of columns that rate a row; that of a parameter needs none."""

_LEVELS = {
    **{trust.badge: trust.level for trust in Trust},
    **{level.verdict: level for level in VERDICTS},
}
"""Levels of the texts that rate a row."""


def _badged(text: str) -> str | Marked:
    level = _LEVELS.get(text)
    return text if level is None else Marked(text, level=level)


def views(
    tables: Sequence[PageTable], facts: Sequence[Fact] = (), *figures: str
) -> dict[str, list[Any]]:
    """Return what an answer shows, for its content: ``figures`` are names of `FIGURES`."""
    return {
        "tables": [table.plain() for table in tables if table.rows],
        "facts": [fact._asdict() for fact in facts],
        "figures": [*figures],
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class Section:
    """A part of a report: text, a line a paragraph, then figures by name, then tables."""

    title: str
    text: str = ""
    tables: tuple[PageTable, ...] = ()
    figures: Mapping[str, Figure] = field(default_factory=dict)
    series: Mapping[str, Series] = field(default_factory=dict)
    markup: str | Markup = ""  # what it has besides, of its own template


def tabulated(title: str, table: PageTable, text: str = "") -> list[Section]:
    """Return the section of a table; none if that is empty."""
    return [Section(title=title, text=text, tables=(table,))] if table.rows else []


@dataclass(frozen=True, kw_only=True, eq=False)
class Page:
    """A report: on its first screen badge, facts and lead; then the summary, and the sections."""

    name: str
    description: str
    kind: str
    summary: Sequence[str] = ()
    sections: Sequence[Section] = ()
    numbers: dict[str, Any] = field(default_factory=dict)  # what it says, for programs, as JSON
    verdict: Verdict | None = None  # on the estimate that it rests on
    badge: Badge | None = None  # that of the verdict if not given
    asked: Sequence[str] = ()  # sentences on what was asked, before the verdict's reasons
    facts: Sequence[Fact] = ()
    lead: Section | None = None
    logs: Sequence[str] = ()  # labels of the logs that can be chosen
    chosen: int = 0  # number of the log that is chosen at first
    place: str = ""  # of the data, where that is known
    pictures: Mapping[str, Callable[[], Figure]] = field(default_factory=dict)
    """Figures that are not on the page but among its pictures, drawn where these are asked for."""

    @property
    def headed(self) -> Badge | None:
        """The badge on top."""
        if self.badge is not None or self.verdict is None:
            return self.badge
        text = self.verdict.level.verdict
        text = text if self.kind == "identification" else f"parameters: {text}"
        return Badge(self.verdict.level, text.capitalize(), [*self.asked, *self.verdict.reasons])

    @property
    def findings(self) -> list[str]:
        """The summary without the sentences of the badge."""
        reasons = self.headed.reasons if self.headed else ()
        return [sentence for sentence in self.summary if sentence not in reasons]

    @property
    def origin(self) -> dict[str, str]:
        """How the page was made: command, folder, data, options, date and versions."""
        about, chosen, made_with = (
            self.numbers.get(key) or {} for key in ("data", "chosen", "versions")
        )
        options = [
            f"{name} {'+'.join(map(str, value)) if isinstance(value, list | tuple) else value}"
            for name, value in (chosen.get("options") or {}).items()
            if value not in (None, [], ())
        ]
        name = about.get("name", "")
        texts = {
            "command": command_line() or "none: made from Python",
            "folder": str(Path.cwd()) if command_line() else "",
            "data": f"{name} ({self.place})" if self.place else name,
            "options": ", ".join([chosen["label"] or chosen["method"], *options]) if chosen else "",
            "date": datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
            "versions": ", ".join(f"{name} {number}" for name, number in made_with.items()),
        }
        return {key: text for key, text in texts.items() if text}

    @property
    def parts(self) -> list[Section]:
        """All sections, the lead first."""
        return [*([self.lead] if self.lead else []), *self.sections]

    @property
    def tables(self) -> list[PageTable]:
        """The tables of all sections as they are printed."""
        return [table._replace(title=part.title) for part in self.sections for table in part.tables]

    @property
    def figures(self) -> dict[str, Figure]:
        """The figures of all sections, by name."""
        return {name: figure for part in self.parts for name, figure in part.figures.items()}

    @property
    def series(self) -> dict[str, Series]:
        """The figures of the chosen log, of all sections, by name."""
        return {name: series for part in self.parts for name, series in part.series.items()}


def command_line() -> str:
    """Return how butterfly was called in a terminal; nothing where it was not."""
    program = Path(sys.argv[0])
    called = program.stem == "butterfly" or program.parts[-2:] == ("butterfly", "__main__.py")
    return shlex.join(["butterfly", *sys.argv[1:]]) if called else ""


@cache
def environment() -> Environment:
    """Return the jinja2 environment of the templates, which escapes HTML."""
    templates = Environment(
        loader=PackageLoader("butterfly.report"),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["coded"] = _coded
    templates.filters["packed"] = lambda program: b64encode(
        gzip.compress(program.encode(), 6, mtime=0)  # the same bytes at any time
    ).decode("ascii")
    return templates


def _coded(sentence: str) -> Markup:
    """Return a sentence as HTML, what stands between a pair of backticks as code."""
    parts = sentence.split("`")
    if len(parts) % 2 == 0:
        return escape(sentence)
    marked = (
        Markup("<code>{}</code>").format(part) if k % 2 else escape(part)
        for k, part in enumerate(parts)
    )
    return Markup("").join(marked)


def rendered(page: Page) -> str:
    """Return a page as HTML."""
    figures = ",".join(
        f"{json.dumps(name)}: {figure.to_json()}" for name, figure in page.figures.items()
    )
    return (
        environment()
        .get_template("page.html.j2")
        .render(
            page=page,
            plotly=gzip.decompress(_PLOTLY.read_bytes()).decode(),
            figures="{" + figures + "}",
            series=json.dumps({name: vars(series) for name, series in page.series.items()}),
        )
    )


def write_page(page: Page, path: Path, *, figures: bool = False, numbers: bool = True) -> None:
    """Write a report as HTML; beside it, if wanted, its ``figures`` and its ``numbers`` (JSON)."""
    mark = mark_of(path, page.kind)
    require_endings(path, (".html",))
    require_free(path, mark)
    if figures:
        from butterfly.report.pictures import write_pictures  # noqa: PLC0415 - slow to import

        pictures = {name: draw() for name, draw in page.pictures.items()}
        write_pictures({**page.figures, **pictures}, path.with_name(f"{path.stem}-figures"))
    if numbers:
        write_document(page.numbers, path.with_suffix(".json"))
    write_file(path, rendered(page), mark)


def cell_html(page: Page, lines: Sequence[str], figure: Figure | None = None) -> str:
    """Return what a notebook shows of an answer: the first ``lines`` that it prints, then more.

    More are the reasons on the page's badge that the lines lack, tiles, the leading table, and one
    figure of the page, the first if not given.
    """
    from butterfly.report.pictures import png_text  # noqa: PLC0415 - slow to import

    drawn = figure if figure is not None else next(iter(page.figures.values()), None)
    picture = "" if drawn is None else png_text(drawn)
    tables = next((part.tables for part in page.parts if part.tables), ())
    reasons = page.headed.reasons if page.headed else ()
    more = [reason for reason in reasons if not any(reason in line for line in lines)]
    shown = environment().get_template("cell.html.j2")
    return shown.render(page=page, lines=[*lines, *more], tables=tables[:1], picture=picture)
