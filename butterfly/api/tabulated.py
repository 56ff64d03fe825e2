"""Results that are a table and what it says: of validate, design and compare."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from plotly.graph_objects import Bar, Figure, Scatter

from butterfly import __version__
from butterfly.api.result import Result, text, texts
from butterfly.identify.identification import held_out_fits
from butterfly.identify.predict import FitSummary, Predictor
from butterfly.report.figures import PALETTE
from butterfly.report.next_experiment import most_telling
from butterfly.report.three_way import three_way_page
from butterfly.report.verdict import SaidVerdict
from butterfly.report.words import fit_said, held_out_sentences, verdict_on

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Self

    from butterfly.compare.three_way import ThreeWay
    from butterfly.identify.data import DataSet
    from butterfly.identify.design import Candidate
    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.identify.judgement.misfit import Misfit
    from butterfly.identify.judgement.validation import HeldOut
    from butterfly.logs.log import Log
    from butterfly.report.page import Page


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
    """

    title: str
    summary: tuple[str, ...]
    table: tuple[dict[str, Any], ...]
    judged: SaidVerdict | None = None

    @classmethod
    def of_content(cls, content: dict[str, Any]) -> Self:
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
            judged=SaidVerdict.of_numbers(content),
        )

    def content(self) -> dict[str, Any]:
        """Return all that is saved."""
        said = {"verdict": None} if self.judged is None else self.judged.numbers()
        about = {"butterfly": __version__, "title": self.title, "summary": list(self.summary)}
        return said | about | {"rows": self.rows()}

    def rows(self) -> list[dict[str, Any]]:
        """Return the table."""
        return [dict(row) for row in self.table]

    @property
    def plot(self) -> TablePlots:
        """Its figures, as plotly's."""
        return TablePlots(self)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Validated(Tabulated):
    """How well logs are followed that an estimator has seen, and that it has not."""

    kind: ClassVar[str] = "validation"

    @classmethod
    def of(cls, data: DataSet, label: str, held: HeldOut, whole: ParameterEstimate) -> Validated:
        """Tabulate what was held out, beside an estimate from all logs."""
        predictor = Predictor(data)
        seen = predictor.fits(whole)
        rows = tuple(
            {**_about(log), "FIT seen in %": float(inside), "FIT left out in %": float(outside)}
            for log, inside, outside in zip(data.logs, seen, held.fits, strict=True)
        )
        within = FitSummary.of(seen, predictor.horizon(whole))
        without, judged = held.summary, verdict_on(whole)
        return cls(
            title=f"{label} of {data.name!r}, {held.division.left_out} at a time",
            summary=(
                judged.sentence,
                held.division.said,
                f"What was left out is followed with a median FIT{without.over} of "
                f"{fit_said(without.median)} % (mean {fit_said(without.mean)} %, worst "
                f"{fit_said(without.worst)} %); those that were seen, {fit_said(within.median)} %.",
                *held_out_sentences(held_out_fits(data, whole)),
            ),
            table=rows,
            judged=judged,
        )

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        return {"fits": self.plot.fits()}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Designed(Tabulated):
    """Next experiments, the most telling first."""

    kind: ClassVar[str] = "design"

    @classmethod
    def of(cls, data: DataSet, found: ParameterEstimate, ranked: Sequence[Candidate]) -> Designed:
        """Tabulate candidates: standard errors after each, over those now."""
        rows = tuple(
            {
                "added mass": str(each.added_mass),
                "input": each.what,
                f"swing in {data.joint.way}": each.swing,
                "mean": each.score,
                **dict(zip(found.names, map(float, each.errors), strict=True)),
                "warning": each.warning,
            }
            for each in ranked
        )
        judged = verdict_on(found)
        return cls(
            title=f"Next experiments after {data.name!r}: standard errors over those now",
            summary=(
                judged.sentence,
                most_telling(ranked[0]),
            ),
            table=rows,
            judged=judged,
        )

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
        cls, data: DataSet, compared: Sequence[ThreeWay], misfit: Misfit, found: ParameterEstimate
    ) -> Compared:
        """Tabulate logs, each simulated twice with an estimate, and the misfit of the data set."""
        verdict = verdict_on(found)
        page = three_way_page(data.name, data.description, compared, misfit, verdict)
        judged = {log.name: log for log in misfit.logs}
        rows = tuple(
            {
                **_about(each.log),
                **{f"FIT {name} in %": fit for name, fit in each.fits.items()},
                f"simulators apart in {data.joint.way}": each.difference,
                **{f"gain {name}": abs(gain) for name, gain in each.gains.items()},
                "error in % of the motion": 100 * judged[each.log.name].relative,
                "outside its bands": judged[each.log.name].outside,
                "left over looks like": judged[each.log.name].left_over.looks_like,
            }
            for each in compared
        )
        title = f"MuJoCo and grey box beside {data.name!r}"
        summary = (verdict.sentence, *page.summary)
        return cls(title=title, summary=summary, table=rows, judged=verdict, live=page)

    def page(self) -> Page:
        """Put together the page of `report`."""
        return self.live or super().page()

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        return {"fits": self.plot.fits()}


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
        rows = self.result.rows()
        columns = [name for name in (rows[0] if rows else ()) if name.startswith("FIT")]
        logs = [row.get("log", number) for number, row in enumerate(rows)]
        figure = Figure(
            [
                Scatter(
                    x=logs,
                    y=[row[name] for row in rows],
                    name=name.removeprefix("FIT ").removesuffix(" in %"),
                    mode="markers",
                    marker={"color": PALETTE[k % len(PALETTE)], "size": 8},
                )
                for k, name in enumerate(columns)
            ]
        )
        figure.update_yaxes(title="FIT in %")
        figure.update_layout(height=420)
        return figure

    def ranking(self, count: int = 12) -> Figure:
        """Draw the mean of what is left of the standard errors, for the first candidates."""
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


def _about(log: Log) -> dict[str, Any]:
    """Name a log and what was done in it."""
    sine = log.excitation
    return {
        "log": log.name,
        "added mass in kg": log.added_mass.mass,
        "frequency in rad/s": sine.omega if sine else np.nan,
    }
