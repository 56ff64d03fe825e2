"""Results of validate, design, select and residual."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.data import DataSet
from butterfly.identification.design import HELPS, Candidate
from butterfly.identification.diagnostics.residuals import Residuals, residual_units, residuals_of
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identify import held_out_fits
from butterfly.identification.inference.estimate import Estimate, left_out_content
from butterfly.identification.parameter import or_nan, unit_of
from butterfly.identification.test_functions import ResidualTorque
from butterfly.identification.validate import Bootstrap, CrossValidation, Structure
from butterfly.logs.log import Log
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import fit_text
from butterfly.report.numbers import residual_numbers, rests_on
from butterfly.report.page import Fact, Page
from butterfly.report.summary import (
    best_experiment_text,
    held_out_sentences,
    medians_of,
    selection_texts,
)
from butterfly.result import Answer, TextTable

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from butterfly.report.ranking_pages import TablePlots

_SEEN, _HELD_OUT = "FIT in sample in %", "FIT held out in %"  # columns
_WELL = 90  # % FIT of a well-predicted log


def about_log(log: Log) -> dict[str, Any]:
    """Return the first cells of a log's row: name, added mass and frequency."""
    sine = log.excitation
    return {
        "log": log.name,
        "added mass in kg": log.added_mass.mass,
        "frequency in rad/s": sine.omega if sine else np.nan,
    }


class Tabulated(Answer):
    """A table with figures."""

    @property
    def plot(self) -> TablePlots:
        """The figures, as plotly figures."""
        from butterfly.report.ranking_pages import TablePlots  # noqa: PLC0415 - slow to import

        return TablePlots(self)

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        return {"fits": self.plot.fits()}

    def fit_facts(self, column: str, label: str) -> list[Fact]:
        """Return median and worst of a column of FITs."""
        fits = {row["log"]: row[column] for row in self.rows() if math.isfinite(row[column] or 0)}
        if not fits:
            return []
        worst = min(fits, key=lambda name: fits[name])
        return [
            Fact(f"FIT {label}, median", f"{fit_text(float(np.median([*fits.values()])))} %"),
            Fact(f"FIT {label}, worst", f"{fit_text(fits[worst])} %", worst.rsplit("/", 1)[-1]),
        ]


class Validated(Tabulated):
    """FIT of an estimator on fitted and on held-out logs."""

    kind: ClassVar[str] = "validation"

    @classmethod
    def of(
        cls,
        data: DataSet,
        estimator: Estimator,
        held: CrossValidation,
        whole: Estimate,
        drawn: Bootstrap | None = None,
    ) -> Validated:
        """Tabulate held-out predictions, the estimate from all logs, and its bootstrap."""
        seen, horizon = data.simulations.fits(whole), data.simulations.horizon(whole)
        within, without = FitSummary.of(seen, horizon), held.summary
        unused, verdict = held_out_fits(data, whole), estimate_verdict(whole)
        fits = {"in sample": seen, held.division.left_out: held.fits}
        if unused:
            fits["held out by name"] = np.array(list(unused.values()))
        tables = [
            _fits_table(f"{data.name}: FIT in %{within.over}", fits, horizon),
            _estimates_table(data, {"nothing": whole, **held.estimates}),
        ]
        if drawn is not None:
            tables.append(_bootstrap_table(data, whole, drawn))
        return cls(
            title=f"{estimator.label} of {data.name!r}, {held.division.left_out} at a time",
            summary=(
                *verdict.lines,
                held.division.sentence,
                f"Held-out median FIT{without.over} {fit_text(without.median)} % (mean "
                f"{fit_text(without.mean)} %, worst {fit_text(without.worst)} %); in-sample median "
                f"FIT {fit_text(within.median)} %.",
                *held_out_sentences(unused),
            ),
            judged=verdict,
            content={
                **rests_on(data, whole, estimator),
                "left_out": [
                    part
                    for name, found in held.estimates.items()
                    for part in left_out_content(found.names, {name: found.values})
                ],
                "fit": {"seen": within.numbers(), "left_out": without.numbers()},
                "held_out": unused,
                "bootstrap": drawn
                and {
                    name: {"lower": float(drawn.lower[k]), "upper": float(drawn.upper[k])}
                    for k, name in enumerate(whole.names)
                },
                "rows": [
                    {**about_log(log), _SEEN: float(seen[k]), _HELD_OUT: float(held.fits[k])}
                    for k, log in enumerate(data.logs)
                ],
            },
            units={"fit": "%", "fit.horizon": "s", "fits": "%", "held_out": "%"},
            printed=tuple(tables),
        )

    def facts(self) -> list[Fact]:
        """Return the numbers that matter most."""
        chosen, (seen, *_) = self.content["chosen"], self.fit_facts(_SEEN, "in sample")
        parts = self.title.rpartition(", ")[2]
        return [
            *self.fit_facts(_HELD_OUT, "held out"),
            seen,
            Fact("held out at a time", re.split(" (?:held|left) out", parts)[0]),
            Fact("logs", str(len(self.rows()))),
            Fact("method", chosen["label"] or chosen["method"]),
        ]


def _fits_table(title: str, fits: Mapping[str, Samples], horizon: float) -> TextTable:
    rows = []
    for name, each in fits.items():
        fit, counted = FitSummary.of(each, horizon), each[~np.isnan(each)]
        numbers = (f"{value:.1f}" for value in (fit.median, fit.mean, fit.worst))
        rows.append((name, *numbers, f"{int(np.sum(counted > _WELL))} of {counted.size}"))
    return TextTable(title, ("", "median", "mean", "worst", f"above {_WELL} %"), rows)


def _estimates_table(data: DataSet, estimates: Mapping[str, Estimate]) -> TextTable:
    names = dict.fromkeys(name for each in estimates.values() for name in each.names)
    found = [each.named for each in estimates.values()]
    rows = [
        (
            name,
            *(f"{own[name]:#.4g}".rstrip(".") if name in own else "–" for own in found),
            unit_of(name, data.input_kind, data.joint),
        )
        for name in names
    ]
    return TextTable("Estimates by held-out part", ("", *estimates, "unit"), rows)


def _bootstrap_table(data: DataSet, whole: Estimate, drawn: Bootstrap) -> TextTable:
    lines = zip(whole.names, whole.values, drawn.lower, drawn.upper, strict=True)
    rows = [
        (name, *(f"{each:.4g}" for each in own), unit_of(name, data.input_kind, data.joint))
        for name, *own in lines
    ]
    headers = ("", "estimate", "lower", "upper", "unit")
    return TextTable("95 % intervals by bootstrap over logs", headers, rows)


class Designed(Tabulated):
    """Next experiments, the most informative first."""

    kind: ClassVar[str] = "design"

    @classmethod
    def of(
        cls,
        data: DataSet,
        estimator: Estimator | None,
        found: Estimate,
        ranked: Sequence[Candidate],
    ) -> Designed:
        """Tabulate candidates with their standard errors relative to the present ones."""
        verdict = estimate_verdict(found)
        rows = [
            {
                "added mass": str(each.added_mass),
                "input": each.what,
                f"swing in {data.joint.way}": each.swing,
                "mean": each.score,
                **dict(zip(found.names, map(float, each.errors), strict=True)),
                "warning": each.warning,
            }
            for each in ranked
        ]
        return cls(
            title=f"Next experiments for {data.name!r}: new standard errors over the present ones",
            summary=(*verdict.lines, best_experiment_text(ranked[0])),
            judged=verdict,
            content={**rests_on(data, found, estimator), "rows": rows},
            units={"rows.mean": "1"} | {f"rows.{name}": "1" for name in found.names},
        )

    def tables(self) -> list[TextTable]:
        """Return the candidates with their ranks, two decimals of each number."""
        rows = self.rows()
        cells = [[f"{v:.2f}" if isinstance(v, float) else v for v in row.values()] for row in rows]
        ranked = [(str(rank), *row) for rank, row in enumerate(cells, start=1)]
        return [TextTable(self.title, ("", *rows[0]), ranked, detail=not self._helps)]

    @property
    def _helps(self) -> bool:
        """Whether the first candidate shrinks the standard errors by what matters."""
        return bool(or_nan(self.rows()[0]["mean"]) <= HELPS)

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        return {"ranking": self.plot.ranking()}

    def facts(self) -> list[Fact]:
        """Return the numbers that matter most: of the first candidate."""
        best, *_ = rows = self.rows()
        (swing,) = (name for name in best if name.startswith("swing in "))
        return [
            Fact("best next experiment", best["input"], best["added mass"])
            if self._helps
            else Fact("best next experiment", "none helps", "standard errors stay as they are"),
            Fact("standard errors after it", f"{100 * best['mean']:.3g} %", "of those now, mean"),
            Fact("swing", f"{best[swing]:.2g} {swing.removeprefix('swing in ')}"),
            Fact("candidates", str(len(rows))),
        ]


class Selection(Tabulated):
    """Terms chosen by cross-validation."""

    kind: ClassVar[str] = "selection"

    @classmethod
    def of(
        cls,
        data: DataSet,
        estimator: Estimator,
        candidates: Sequence[str],
        passed: Sequence[Structure],
        *,
        found: Estimate,
        nested: CrossValidation | None = None,
    ) -> Selection:
        """Tabulate the sets of terms tried; the last one is chosen."""
        verdict = estimate_verdict(found)
        return cls(
            title=f"Terms chosen for {data.name!r} by {estimator.method}",
            summary=(*verdict.lines, *selection_texts(passed, nested)),
            judged=verdict,
            content={
                **rests_on(data, found, estimator),
                "candidates": list(candidates),
                "rows": [
                    {
                        "terms": list(each.terms),
                        "in_sample": each.in_sample.numbers(),
                        "left_out": {str(k): fit.numbers() for k, fit in each.held_out.items()},
                        "gain": None if each.gain is None else each.gain._asdict(),
                    }
                    for each in passed
                ],
                "nested": None if nested is None else nested.mean._asdict(),
            },
            units={"rows.in_sample": "%", "rows.left_out": "%", "rows.gain": "%", "nested": "%"},
        )

    def shown_rows(self) -> list[dict[str, str]]:
        """Return each set of terms with its median FIT, in sample and held out, and the gain."""
        return [
            {
                "terms": ", ".join(row["terms"]) or "none",
                **{f"FIT {name} in %": fit_text(fit) for name, fit in medians_of(row).items()},
                "gain in FIT": " ± ".join(map(fit_text, (row["gain"] or {}).values())),
            }
            for row in self.rows()
        ]

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name; none where nothing was added."""
        return {"fit": self.plot.choices()} if len(self.rows()) > 1 else {}

    def facts(self) -> list[Fact]:
        """Return the numbers that matter most: of the chosen terms."""
        chosen = self.rows()[-1]
        return [
            Fact("terms chosen", ", ".join(chosen["terms"]) or "none", "besides p1..p4, coulomb"),
            *(
                Fact(f"FIT {name}", f"{fit_text(fit)} %", "median")
                for name, fit in medians_of(chosen).items()
            ),
        ]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Residual(Answer):
    """Free-run errors of an estimate, compared with the sensor noise."""

    kind: ClassVar[str] = "residual"
    table: ClassVar[str] = "logs"

    data: DataSet
    estimate: Estimate
    residuals: Residuals
    chosen: tuple[int, ...]  # numbers of the logs to show

    @classmethod
    def of(
        cls, data: DataSet, estimator: Estimator | None, found: Estimate, chosen: Sequence[int]
    ) -> Residual:
        """Analyse the residuals of an estimate."""
        from butterfly.report.residual import residual_sentences  # noqa: PLC0415 - slow to import

        verdict, residuals = estimate_verdict(found), residuals_of(data, found)
        return cls(
            title=f"Residuals of {found.method} on {data.name!r}",
            summary=(*verdict.lines, *residual_sentences(residuals)),
            judged=verdict,
            content={**residual_numbers(residuals, found), **rests_on(data, found, estimator)},
            units=residual_units(data.joint, ""),
            data=data,
            estimate=found,
            residuals=residuals,
            chosen=tuple(chosen),
        )

    def shown_rows(self) -> list[dict[str, str]]:
        """Return the errors of the chosen logs, and whether sensor noise explains them."""
        from butterfly.report.residual import HEADERS, residual_table  # noqa: PLC0415 - slow to import

        rows = residual_table(self.residuals.logs[k] for k in self.chosen).rows
        return [dict(zip(HEADERS, map(str, row), strict=True)) for row in rows]

    def torque(self, number: int) -> ResidualTorque:
        """Return the residual torque of a log, by its number."""
        setting = self.data.simulations.setting(number, self.estimate)
        return ResidualTorque.of(self.data.logs[number], setting.parameters, setting.zero)

    @property
    def _worst(self) -> int:
        """Number of the chosen log with the largest error."""
        return max(self.chosen, key=lambda k: self.residuals.logs[k].relative)

    def figures(self) -> dict[str, Figure]:
        """Return residual torque and correlations of the log with the largest error."""
        from butterfly.report.residual import residual_figures  # noqa: PLC0415 - slow to import

        worst = self._worst
        return residual_figures(self.torque(worst), self.residuals.logs[worst], self.data.joint)

    def facts(self) -> list[Fact]:
        """Return the numbers that matter most: of the log with the largest error."""
        worst = self.residuals.logs[self._worst]
        return [
            Fact("largest error", f"{100 * worst.relative:.2g} %", f"of the motion, {worst.label}"),
            Fact("over sensor noise", f"{worst.times:.3g} ×", "encoder resolution and noise"),
            Fact("correlations", "outside" if worst.outside else "inside", "bands"),
        ]

    def page(self) -> Page:
        """Return the page of `report`."""
        from butterfly.report.residual import EXPLAINED  # noqa: PLC0415 - slow to import

        page = super().page()
        return replace(page, lead=page.lead and replace(page.lead, text=EXPLAINED))
