"""A report: one HTML file that opens offline, its figures as pictures, its numbers as JSON."""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from butterfly import __version__
from butterfly.files import replacing
from butterfly.report.parameter_table import Whisker
from butterfly.result import TextTable, write_document
from butterfly.verdict import Level, Verdict

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from butterfly.report.figures import Series

_PLOTLY = Path(__file__).parent / "plotly_js/plotly-cartesian.min.js.gz"


class Link(NamedTuple):
    """A text in a table that leads to a file beside the report."""

    text: str
    href: str

    def __str__(self) -> str:
        return self.text


class Chip(NamedTuple):
    """A short text in a table that stands out by how much it matters."""

    text: str
    level: Level

    def __str__(self) -> str:
        return self.text


class Named(NamedTuple):
    """A symbol in a table, and below it what it stands for."""

    text: str
    meaning: str

    def __str__(self) -> str:
        return self.text


Cell: TypeAlias = "str | Link | Chip | Named | Whisker"
"""What stands in a table."""


class Fact(NamedTuple):
    """A number that stands large on a page's first screen, and what it is."""

    label: str
    value: str
    detail: str = ""


class Badge(NamedTuple):
    """What may be done with what a page is about, at one glance; each reason stands alone."""

    level: Level
    text: str
    reasons: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class PageTable:
    """Rows of cells under headers, units in the headers."""

    headers: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]
    caption: str = ""
    name: str = ""  # by which a page's links and programs find it
    words: tuple[int, ...] = ()  # columns of text: on the left, broken into lines; so is the first
    picks: Sequence[int] = ()  # for each row the number of the log that it chooses


@dataclass(frozen=True, kw_only=True, eq=False)
class Section:
    """A part of a report: text, a line a paragraph, then figures by name, then tables.

    ``series`` are figures of the log that is chosen, by name.
    """

    title: str
    text: str = ""
    tables: tuple[PageTable, ...] = ()
    figures: Mapping[str, Figure] = field(default_factory=dict)
    series: Mapping[str, Series] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Page:
    """A report: on its first screen badge, facts and lead; then the summary, and the sections."""

    name: str
    description: str
    kind: str
    summary: Sequence[str]
    sections: Sequence[Section]
    numbers: dict[str, Any]  # what it says, for programs: anything that JSON can hold
    verdict: Verdict | None = None  # on the estimate that it rests on
    badge: Badge | None = None  # that of the verdict if not given
    facts: Sequence[Fact] = ()
    lead: Section | None = None
    logs: Sequence[str] = ()  # labels of the logs that can be chosen
    chosen: int = 0  # number of the log that is chosen at first
    pictures: Mapping[str, Callable[[], Figure]] = field(default_factory=dict)
    """Figures that are not on the page but among its pictures, drawn where these are asked for."""

    @property
    def headed(self) -> Badge | None:
        """The badge on top."""
        if self.badge is not None or self.verdict is None:
            return self.badge
        text = self.verdict.level.verdict
        text = text if self.kind == "identification" else f"parameters: {text}"
        return Badge(self.verdict.level, text.capitalize(), self.verdict.paragraphs)

    @property
    def parts(self) -> list[Section]:
        """All sections, the lead first."""
        return [*([self.lead] if self.lead else []), *self.sections]

    @property
    def figures(self) -> dict[str, Figure]:
        """The figures of all sections, by name."""
        return {name: each for part in self.parts for name, each in part.figures.items()}

    @property
    def text_tables(self) -> tuple[TextTable, ...]:
        """The tables of its sections, as a command prints them."""
        return tuple(
            TextTable(section.title, each.headers, [[*map(str, row)] for row in each.rows])
            for section in self.sections
            for each in section.tables
        )

    @property
    def series(self) -> dict[str, Series]:
        """The figures of the chosen log, of all sections, by name."""
        return {name: each for part in self.parts for name, each in part.series.items()}


def rendered(page: Page) -> str:
    """Return a page as HTML."""
    environment = Environment(
        loader=PackageLoader("butterfly.report"),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["packed"] = _packed
    figures = ",".join(
        f"{json.dumps(name)}: {each.to_json()}" for name, each in page.figures.items()
    )
    return environment.get_template("page.html.j2").render(
        page=page,
        version=__version__,
        plotly=gzip.decompress(_PLOTLY.read_bytes()).decode(),
        figures="{" + figures + "}",
        series=json.dumps({name: vars(each) for name, each in page.series.items()}),
    )


def _packed(program: str) -> str:
    """Return a program as a page holds it: packed, and the same bytes at any time."""
    return b64encode(gzip.compress(program.encode(), 6, mtime=0)).decode("ascii")


def write_html(page: Page, path: Path) -> None:
    """Write a page as HTML alone."""
    text = rendered(page)
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8")


def write_page(page: Page, path: Path, *, figures: bool = False) -> None:
    """Write a report as ``path`` (HTML), and its numbers beside it as JSON.

    Its ``figures``, if wanted, go as PNG and SVG to a folder ``NAME-figures`` beside ``NAME.html``.
    """
    if figures:
        from butterfly.report.pictures import write_pictures  # noqa: PLC0415 - slow to import

        pictures = {name: draw() for name, draw in page.pictures.items()}
        write_pictures({**page.figures, **pictures}, path.with_name(f"{path.stem}-figures"))
    write_document(page.numbers, path.with_suffix(".json"))
    write_html(page, path)
