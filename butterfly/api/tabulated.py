"""Results that are a table and what it says: of validate, design and compare."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar, Self

from butterfly.document import HEAD, Told
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.misfit import Misfit
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.physical import PhysicalParameters
from butterfly.report.page import Page
from butterfly.report.parameter_table import TITLE, physical_numbers, physical_sentences
from butterfly.result import Result, TextTable, aligned, text, texts
from butterfly.verdict import Verdict

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from butterfly.comparison.three_way import ThreeWay


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Tabulated(Result):
    """A table and what it says.

    Parameters
    ----------
    title, summary
        What it is, and what it says.
    table
        Its rows, units in the names of the columns.
    judged
        The verdict on the estimate that it rests on; None of a result of an older program.
    besides, units
        What else `to_dict` says, and the units of what it says.
    printed
        The tables that a command prints; none of a result that was loaded, which prints its rows.
    """

    title: str
    summary: tuple[str, ...]
    table: tuple[dict[str, Any], ...]
    judged: Verdict | None = None
    besides: dict[str, Any] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    printed: tuple[TextTable, ...] = ()

    @classmethod
    def of_told(cls, told: Told, **more: Any) -> Self:  # noqa: ANN401 - fields of its own
        """Return what was told for programs as a result."""
        content = dict(told.content)
        return cls(
            title=told.title,
            summary=told.summary,
            table=tuple(content.pop("rows")),
            judged=told.verdict,
            besides=content,
            units=dict(told.units),
            **more,
        )

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Self:
        """Return what `to_dict` told of.

        Raises
        ------
        KeyError, TypeError, ValueError
            If something is missing, or not what it should be.
        """
        return cls(
            title=text(content["title"]),
            summary=texts(content["summary"]),
            table=tuple(dict(row) for row in content["rows"]),
            judged=Verdict.of_numbers(content),
            besides={key: content[key] for key in content if key not in {*HEAD, "rows"}},
            units={str(key): str(unit) for key, unit in content.get("units", {}).items()},
        )

    def told(self) -> Told:
        """Return what it says, for programs."""
        return Told(
            kind=self.kind,
            title=self.title,
            verdict=self.judged,
            summary=self.summary,
            content={**self.besides, "rows": self.rows()},
            units=self.units,
        )

    def rows(self) -> list[dict[str, Any]]:
        """Return the table."""
        return [dict(row) for row in self.table]

    def tables(self) -> list[TextTable]:
        """Return the tables that a command prints below the summary."""
        return list(self.printed) or super().tables()

    @property
    def plot(self) -> TablePlots:
        """Its figures, as plotly's."""
        return TablePlots(self)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Validated(Tabulated):
    """How well logs are followed that an estimator has seen, and that it has not."""

    kind: ClassVar[str] = "validation"

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        return {"fits": self.plot.fits()}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Designed(Tabulated):
    """Next experiments, the most telling first."""

    kind: ClassVar[str] = "design"

    def tables(self) -> list[TextTable]:
        """Return the candidates with their ranks, two decimals of each number."""
        rows = self.rows()
        cells = [[f"{v:.2f}" if isinstance(v, float) else v for v in row.values()] for row in rows]
        ranked = [(str(rank), *row) for rank, row in enumerate(cells, start=1)]
        return [TextTable(self.title, ("", *rows[0]), ranked)]

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        return {"ranking": self.plot.ranking()}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Compared(Tabulated):
    """MuJoCo, the grey-box model and the logs, given the same input.

    Parameters
    ----------
    live
        The page that drew them; None for a result that was loaded.
    """

    kind: ClassVar[str] = "comparison"

    live: Page | None = None

    @classmethod
    def of(
        cls,
        data: DataSet,
        estimator: Estimator | None,
        compared: Sequence[ThreeWay],
        misfit: Misfit,
        found: Estimate,
    ) -> Compared:
        """Tabulate logs, each simulated twice with an estimate, and the misfit of the data set."""
        from butterfly.report.numbers.comparison_numbers import (  # noqa: PLC0415 - slow to import
            told_comparison,
        )
        from butterfly.report.three_way_page import three_way_page  # noqa: PLC0415 - slow to import

        told = told_comparison(data, estimator, compared, misfit, found)
        page = three_way_page(data, compared, misfit, told)
        return cls.of_told(told, live=page, printed=page_tables(page))

    def page(self) -> Page:
        """Put together the page of `report`."""
        return self.live or super().page()

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        return {"fits": self.plot.fits()}


def page_tables(page: Page) -> tuple[TextTable, ...]:
    """Return the tables of a page's sections, as a command prints them."""
    return tuple(
        TextTable(section.title, part.headers, [[str(cell) for cell in row] for row in part.rows])
        for section in page.sections
        for part in section.tables
    )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Separated(Tabulated):
    """Physical parameters, and what is left open of them."""

    kind: ClassVar[str] = "physical"

    @classmethod
    def of(cls, parameters: PhysicalParameters, name: str, judged: Verdict) -> Separated:
        """Wrap what is told of the robot of some data."""
        return cls(
            title=f"{TITLE} of {name!r}",
            summary=(judged.sentence, *physical_sentences(parameters)),
            table=tuple(
                {"parameter": each} | row for each, row in physical_numbers(parameters).items()
            ),
            judged=judged,
        )

    def shown_lines(self) -> list[str]:
        """Return the table as lines."""
        return aligned(self.shown_rows()) if self.table else []


@dataclass(frozen=True)
class TablePlots:
    """Figures of a table.

    Parameters
    ----------
    result
        That has it.
    """

    result: Tabulated

    def fits(self) -> Figure:
        """Draw every column of FITs, a point for each log."""
        from plotly.graph_objects import Figure, Scatter  # noqa: PLC0415 - slow to import

        from butterfly.report.figures import look  # noqa: PLC0415 - slow to import

        rows = self.result.rows()
        columns = [name for name in (rows[0] if rows else ()) if name.startswith("FIT")]
        places = list(range(1, len(rows) + 1))
        figure = Figure()
        for number, name in enumerate(columns):
            colour, symbol = look(number)
            marker = {"color": colour, "symbol": symbol + "-open" * (number % 2)}
            drawn = Scatter(
                x=places,
                y=[row[name] for row in rows],
                text=[
                    escape(str(row.get("log", place)))
                    for place, row in zip(places, rows, strict=True)
                ],
                name=name.removeprefix("FIT ").removesuffix(" in %"),
                mode="markers",
                marker=marker | {"size": 8 + 4 * (number % 2)},
                hovertemplate="%{text}: %{y:.1f} %",
            )
            figure.add_trace(drawn)
        figure.update_xaxes(title="log, in the order of the table")
        figure.update_yaxes(title="FIT in %")
        figure.update_layout(height=420)
        return figure

    def ranking(self, count: int = 12) -> Figure:
        """Draw the mean of what is left of the standard errors, for the first candidates."""
        from plotly.graph_objects import Bar, Figure  # noqa: PLC0415 - slow to import

        from butterfly.report.figures import PALETTE  # noqa: PLC0415 - slow to import

        rows = self.result.rows()[:count]
        bars = Bar(
            x=[str(rank) for rank in range(1, len(rows) + 1)],
            y=[row["mean"] for row in rows],
            text=[f"{row['input']}, {row['added mass']}" for row in rows],
            textposition="none",
            hovertemplate="%{text}: %{y:.2f}<extra></extra>",
            marker={"color": PALETTE[0]},
        )
        figure = Figure(bars)
        figure.update_xaxes(title="candidate, in the order of the table")
        figure.update_yaxes(title="standard errors after, over those now")
        figure.update_layout(height=420)
        return figure
