"""A report: one HTML file that opens offline, its figures as pictures, its numbers as JSON."""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from butterfly import __version__
from butterfly.files import replacing
from butterfly.report.numbers.document import write_document

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from plotly.graph_objects import Figure

    from butterfly.report.verdict import SaidVerdict

_PLOTLY = Path(__file__).parent / "plotly_js/plotly-cartesian.min.js.gz"


class Link(NamedTuple):
    """A text in a table that leads to a file beside the report."""

    text: str
    href: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of texts and links under headers, units in the headers."""

    headers: tuple[str, ...]
    rows: Sequence[tuple[str | Link, ...]]
    caption: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Section:
    """A part of a report: text, then tables, then figures by name."""

    title: str
    text: str = ""
    tables: tuple[Table, ...] = ()
    figures: dict[str, Figure] = field(default_factory=dict)


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
        In plain words, on top.
    sections
        In order.
    numbers
        What it says, for programs: anything that JSON can hold.
    verdict
        On the estimate that it rests on; None if it rests on none.
    """

    name: str
    description: str
    kind: str
    summary: list[str]
    sections: list[Section]
    numbers: dict[str, Any]
    verdict: SaidVerdict | None = None


def render(template: str, **content: Any) -> str:  # noqa: ANN401 - whatever the template shows
    """Fill in a template of this package; see ``templates/base.html.j2`` for what all need."""
    environment = Environment(
        loader=PackageLoader("butterfly.report"),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["packed"] = _packed
    page = environment.get_template(template)
    return page.render(version=__version__, plotly=_plotly(), **content)


def _plotly() -> str:
    """Return the JavaScript that draws figures."""
    return gzip.decompress(_PLOTLY.read_bytes()).decode()


def _packed(program: str) -> str:
    """Return a program as a page holds it: packed, and the same bytes at any time."""
    return b64encode(gzip.compress(program.encode(), 6, mtime=0)).decode("ascii")


def write_page(page: Page, path: Path, *, figures: bool = False) -> None:
    """Write a report as ``path`` (HTML), and its numbers beside it as JSON.

    Its ``figures``, if wanted, go as PNG and SVG to a folder ``NAME-figures`` beside ``NAME.html``.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    drawn = {name: each for part in page.sections for name, each in part.figures.items()}
    parts = ",".join(f"{json.dumps(name)}: {each.to_json()}" for name, each in drawn.items())
    text = render(
        "page.html.j2",
        name=page.name,
        description=page.description,
        kind=page.kind,
        verdict=page.verdict,
        summary=page.summary,
        sections=page.sections,
        figures="{" + parts.replace("</", "<\\/") + "}",
    )
    write_beside(path, drawn if figures else {}, page.numbers)
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8")


def write_beside(path: Path, figures: Mapping[str, Figure], numbers: dict[str, Any]) -> None:
    """Write what accompanies a report: its figures, if any, as pictures, its numbers as JSON.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    if figures:
        from butterfly.report.still import write_stills  # noqa: PLC0415 - slow to import

        write_stills(figures, path.with_name(f"{path.stem}-figures"))
    write_document(numbers, path.with_suffix(".json"))
