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
from butterfly.report.numbers.document import write_document
from butterfly.report.parameter_table import Whisker
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
    """What may be done with what a page is about, at one glance.

    Parameters
    ----------
    level
        How much speaks against it.
    text
        In a word or two.
    reasons
        Why, each to stand alone.
    """

    level: Level
    text: str
    reasons: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of cells under headers, units in the headers.

    Parameters
    ----------
    headers, rows, caption
        What it shows.
    name
        By which a page's links and programs find it; nothing if none do.
    words
        Numbers of the columns that hold words, which begin at the left and may be broken into
        lines; so does the first.
    picks
        For each row the number of the log that it chooses; nothing if rows choose none.
    """

    headers: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]
    caption: str = ""
    name: str = ""
    words: tuple[int, ...] = ()
    picks: Sequence[int] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Section:
    """A part of a report: text, a line a paragraph, then figures by name, then tables.

    ``series`` are figures of the log that is chosen, by name.
    """

    title: str
    text: str = ""
    tables: tuple[Table, ...] = ()
    figures: Mapping[str, Figure] = field(default_factory=dict)
    series: Mapping[str, Series] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Page:
    """A report.

    Parameters
    ----------
    name, description
        Of what it is about.
    kind
        Of report.
    summary
        In plain words.
    sections
        In order.
    numbers
        What it says, for programs: anything that JSON can hold.
    verdict
        On the estimate that it rests on; None if it rests on none.
    badge
        What may be done with what it is about; that of the verdict if not given.
    facts
        The numbers that matter most.
    lead
        The section that belongs on the first screen, before the words.
    logs
        Labels of the logs that can be chosen.
    chosen
        Number of the log that is chosen at first.
    stills
        Figures that are not on the page but among its pictures, by name; drawn where these are
        asked for.
    """

    name: str
    description: str
    kind: str
    summary: Sequence[str]
    sections: Sequence[Section]
    numbers: dict[str, Any]
    verdict: Verdict | None = None
    badge: Badge | None = None
    facts: Sequence[Fact] = ()
    lead: Section | None = None
    logs: Sequence[str] = ()
    chosen: int = 0
    stills: Mapping[str, Callable[[], Figure]] = field(default_factory=dict)

    @property
    def headed(self) -> Badge | None:
        """The badge on top."""
        if self.badge is not None or self.verdict is None:
            return self.badge
        text = self.verdict.level.verdict
        said = text if self.kind == "identification" else f"parameters: {text}"
        return Badge(self.verdict.level, said.capitalize(), self.verdict.paragraphs)

    @property
    def parts(self) -> list[Section]:
        """All sections, the lead first."""
        return [*([self.lead] if self.lead else []), *self.sections]

    @property
    def figures(self) -> dict[str, Figure]:
        """The figures of all sections, by name."""
        return {name: each for part in self.parts for name, each in part.figures.items()}

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
        plotly=_plotly(),
        figures="{" + figures + "}",
        series=json.dumps({name: vars(each) for name, each in page.series.items()}),
    )


def _plotly() -> str:
    """Return the JavaScript that draws figures."""
    return gzip.decompress(_PLOTLY.read_bytes()).decode()


def _packed(program: str) -> str:
    """Return a program as a page holds it: packed, and the same bytes at any time."""
    return b64encode(gzip.compress(program.encode(), 6, mtime=0)).decode("ascii")


def write_html(page: Page, path: Path) -> None:
    """Write a page as HTML alone.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    text = rendered(page)
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8")


def write_page(page: Page, path: Path, *, figures: bool = False) -> None:
    """Write a report as ``path`` (HTML), and its numbers beside it as JSON.

    Its ``figures``, if wanted, go as PNG and SVG to a folder ``NAME-figures`` beside ``NAME.html``.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    if figures:
        from butterfly.report.pictures import write_stills  # noqa: PLC0415 - slow to import

        stills = {name: draw() for name, draw in page.stills.items()}
        write_stills({**page.figures, **stills}, path.with_name(f"{path.stem}-figures"))
    write_document(page.numbers, path.with_suffix(".json"))
    write_html(page, path)
