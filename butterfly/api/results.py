"""Results of validate, design, select and residual, and the physical parameters."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from functools import partial
from statistics import mean, median
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from butterfly.identification.data import DataSet
from butterfly.identification.design import Candidate, Plan
from butterfly.identification.estimate import Estimate, left_out_content
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identify import held_out_fits
from butterfly.identification.parameter import or_nan, unit_of
from butterfly.identification.physical import PhysicalParameters
from butterfly.identification.residuals import residual_units, residuals_of
from butterfly.identification.validate import Bootstrap, CrossValidation, Structure
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import JointKind
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import counted, fit_text, label_of, with_error
from butterfly.report.numbers import RESIDUAL_CAPTION, residual_numbers, residual_row, rests_on
from butterfly.report.page import Fact, PageTable
from butterfly.report.parameter_table import PHYSICAL_TITLE, physical_numbers, physical_sentences
from butterfly.report.summary import (
    held_out_sentences,
    medians_of,
    next_run_text,
    selection_texts,
)
from butterfly.result import Answer, cell_text
from butterfly.verdict import Verdict

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_ERROR = "error in % of the motion"  # column
_SAID_BY_LABEL = {"log", "added mass in kg", "frequency in rad/s"}
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

    plots: ClassVar[Mapping[str, str]] = {"fits": "fits"}
    """Its figures: by their names on the page, what draws them in `report.ranking_pages`."""

    def shown_rows(self) -> list[dict[str, str]]:
        """Return the rows formatted as text, a log by its short name."""
        return [
            ({"log": label_of(row)} if "log" in row else {})
            | {name: cell_text(value) for name, value in row.items() if name not in _SAID_BY_LABEL}
            for row in self.rows()
        ]

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        from butterfly.report import ranking_pages  # noqa: PLC0415 - slow to import

        made = {name: getattr(ranking_pages, draw)(self) for name, draw in self.plots.items()}
        return {name: figure for name, figure in made.items() if figure is not None}

    def fit_facts(self, column: str, label: str) -> list[Fact]:
        """Return median and worst of a column of FITs."""
        fits = {row["log"]: row[column] for row in self.rows() if row[column] is not None}
        if not fits:
            return []
        worst = min(fits, key=lambda name: fits[name])
        return [
            Fact(f"FIT {label}, median", f"{fit_text(median(fits.values()))} %"),
            Fact(f"FIT {label}, worst", f"{fit_text(fits[worst])} %", worst.rsplit("/", 1)[-1]),
        ]


class Validated(Tabulated):
    """FIT of an estimator on fitted and on held-out logs."""

    kind: ClassVar[str] = "validation"
    brief: ClassVar[bool] = True

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
        return cls(
            title=f"{estimator.label} of {data.name!r}, {held.division.left_out} at a time",
            summary=(
                *verdict.after(
                    f"Held-out median FIT{without.over} {fit_text(without.median)} % (mean "
                    f"{fit_text(without.mean)} %, worst {fit_text(without.worst)} %); in-sample "
                    f"median FIT {fit_text(within.median)} %."
                ),
                held.division.sentence,
                *held_out_sentences(unused),
            ),
            judged=verdict,
            content={
                **rests_on(data, whole, estimator),
                "left_out_together": held.division.left_out,
                "left_out": [
                    part
                    for name, estimate in held.estimates.items()
                    for part in left_out_content(estimate.names, {name: estimate.values})
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
        )

    def further(self) -> list[PageTable]:
        """Return the FITs, the estimates without each part, and intervals by bootstrap."""
        content, rows, about = self.content, self.rows(), self.content["data"]
        fits = {
            "in sample": [row[_SEEN] for row in rows],
            content["left_out_together"]: [row[_HELD_OUT] for row in rows],
            "held out by name": [*content["held_out"].values()],
        }
        lines = [(name, *_fit_cells(column)) for name, column in fits.items() if column]
        values = {name: row["value"] for name, row in content["parameters"].items()}
        values |= content["unestimated"]
        whole = {name: values[name] for name in content["covariance"]["names"]}
        left_out = {part["without"]: part["values"] for part in content["left_out"]}
        parts = {"nothing": whole, **left_out}
        kind, joint = InputKind(about["input"]), JointKind(about["joint"])
        units = {
            name: unit_of(name, kind, joint) for estimate in parts.values() for name in estimate
        }
        estimates = [
            (name, *(cell_text(estimate.get(name)) for estimate in parts.values()), unit)
            for name, unit in units.items()
        ]
        title = f"{about['name']}: FIT in %{FitSummary(**content['fit']['seen']).over}"
        headers = ("", "median", "mean", "worst", f"above {_WELL} %")
        tables = [
            PageTable(title, headers, lines),
            PageTable("Estimates by held-out part", ("", *parts, "unit"), estimates),
        ]
        if content["bootstrap"]:
            drawn = [
                (name, *_in_interval(whole[name], bounds["lower"], bounds["upper"]), units[name])
                for name, bounds in content["bootstrap"].items()
            ]
            headers = ("", "estimate", "lower", "upper", "unit")
            tables.append(PageTable("95 % intervals by bootstrap over logs", headers, drawn))
        return tables

    def facts(self) -> list[Fact]:
        """Return the numbers that matter most."""
        chosen = self.content["chosen"]
        parts = re.split(" (?:held|left) out", self.content["left_out_together"])
        return [
            *self.fit_facts(_HELD_OUT, "held out"),
            *self.fit_facts(_SEEN, "in sample")[:1],
            Fact("held out at a time", parts[0]),
            Fact("logs", str(len(self.rows()))),
            Fact("method", chosen["label"] or chosen["method"]),
        ]


def _fit_cells(fits: Sequence[float | None]) -> tuple[str, ...]:
    """Return median, mean and worst FIT in %, and how many logs are predicted well."""
    known = [fit for fit in fits if fit is not None]
    numbers = [of(known) for of in (median, mean, min)] if known else [None] * 3
    return (*map(fit_text, numbers), f"{sum(fit > _WELL for fit in known)} of {len(known)}")


def _in_interval(*numbers: float | None) -> list[str]:
    """Return a value, and the limits of its interval, to the digits that tell them apart."""
    value, lower, upper = map(or_nan, numbers)
    return [with_error(number, (upper - lower) / 4) for number in (value, lower, upper)]


class Designed(Tabulated):
    """Next experiments, the cheapest way to a goal first."""

    kind: ClassVar[str] = "design"
    plots: ClassVar[Mapping[str, str]] = {"ranking": "ranking"}

    @classmethod
    def of(
        cls,
        data: DataSet,
        estimator: Estimator | None,
        estimate: Estimate,
        ranked: Sequence[Plan[Candidate]],
        *,
        goal: float,
        now: float,
    ) -> Designed:
        """Tabulate candidates; ``goal``: share asked for, ``now``: the largest half-width's."""
        verdict = estimate_verdict(estimate)
        rows = [
            {
                "added mass": str(plan.recipe.log.added_mass),
                "input": plan.recipe.what,
                f"swing in {data.joint.way}": plan.recipe.swing,
                "runs": plan.runs,
                "robot time in s": round(plan.seconds),
                "reached in %": 100 * goal * plan.expected[1],
                **dict(zip(estimate.names, map(float, plan.errors), strict=True)),
                "warning": plan.recipe.warning,
            }
            for plan in ranked
        ]
        return cls(
            title=f"Next runs for {data.name!r}: standard errors after one over the present ones",
            summary=verdict.after(next_run_text(ranked[0], estimate.names, goal, now)),
            judged=verdict,
            content={
                **rests_on(data, estimate, estimator),
                "goal": goal,
                "half_width": now,
                "rows": rows,
            },
            units={f"rows.{name}": "1" for name in estimate.names},
        )

    def shown_rows(self) -> list[dict[str, str]]:
        """Return the candidates with their ranks, two decimals of each number."""
        return [
            {"": str(rank)}
            | {k: f"{v:.2f}" if isinstance(v, float) else cell_text(v) for k, v in row.items()}
            for rank, row in enumerate(self.rows(), start=1)
        ]

    def facts(self) -> list[Fact]:
        """Return the numbers that matter most: of the first candidate."""
        best, *_ = rows = self.rows()
        now, goal = (cell_text(100 * or_nan(self.content[k])) for k in ("half_width", "goal"))
        reached = cell_text(best["reached in %"])
        return [
            Fact("next run", best["input"], best["added mass"]),
            Fact("robot time", f"{best['robot time in s']} s", counted(best["runs"], "run")),
            Fact("largest half-width after", f"{reached} %", f"now {now} %, goal {goal} %"),
            Fact("candidates", str(len(rows))),
        ]


class Selection(Tabulated):
    """Terms chosen by cross-validation."""

    kind: ClassVar[str] = "selection"
    plots: ClassVar[Mapping[str, str]] = {"fit": "choices"}

    @classmethod
    def of(
        cls,
        data: DataSet,
        estimator: Estimator,
        candidates: Sequence[str],
        passed: Sequence[Structure],
        *,
        estimate: Estimate,
        nested: CrossValidation | None = None,
    ) -> Selection:
        """Tabulate the sets of terms tried; the last one is chosen."""
        verdict = estimate_verdict(estimate)
        answer, *others = selection_texts(passed, nested)
        return cls(
            title=f"Terms chosen for {data.name!r} by {estimator.method}",
            summary=(*verdict.after(answer), *others),
            judged=verdict,
            content={
                **rests_on(data, estimate, estimator),
                "candidates": list(candidates),
                "rows": [
                    {
                        "terms": list(structure.terms),
                        "in_sample": structure.in_sample.numbers(),
                        "left_out": {
                            str(k): fit.numbers() for k, fit in structure.held_out.items()
                        },
                        "gain": None if structure.gain is None else structure.gain._asdict(),
                    }
                    for structure in passed
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


class Residual(Tabulated):
    """Free-run errors of an estimate, compared with the sensor noise."""

    kind: ClassVar[str] = "residual"
    caption: ClassVar[str] = RESIDUAL_CAPTION
    plots: ClassVar[Mapping[str, str]] = {}  # all of them need the logs

    @classmethod
    def of(
        cls, data: DataSet, estimator: Estimator | None, estimate: Estimate, chosen: Sequence[int]
    ) -> Residual:
        """Analyse the residuals of an estimate, and tabulate those of the chosen logs."""
        from butterfly.report.residual import residual_sentences, with_residual_figures  # noqa: PLC0415 - slow to import

        verdict, residuals = estimate_verdict(estimate), residuals_of(data, estimate)
        worst = max(chosen, key=lambda k: residuals.logs[k].relative)
        return cls(
            title=f"Residuals of {estimate.method} on {data.name!r}",
            summary=(*verdict.lines, *residual_sentences(residuals)),
            judged=verdict,
            content={
                **rests_on(data, estimate, estimator),
                "rows": [about_log(data.logs[k]) | residual_row(residuals.logs[k]) for k in chosen],
                "residuals": residual_numbers(residuals, estimate),
            },
            units=residual_units(data.joint),
            live=partial(with_residual_figures, data, estimate, worst, residuals.logs[worst]),
        )

    def facts(self) -> list[Fact]:
        """Return the numbers that matter most: of the log with the largest error."""
        worst = max(self.rows(), key=lambda row: math.inf if row[_ERROR] is None else row[_ERROR])
        error, times = (cell_text(worst[key]) for key in (_ERROR, "error over sensor noise"))
        return [
            Fact("largest error", f"{error} %", f"of the motion, {label_of(worst)}"),
            Fact("over sensor noise", f"{times} ×", "encoder resolution and noise"),
            Fact("correlations", "outside" if worst["outside its bands"] else "inside", "bands"),
        ]


class Separated(Answer):
    """Physical parameters, and what is left open of them."""

    kind: ClassVar[str] = "physical"
    short: ClassVar[bool] = True

    @classmethod
    def of(cls, parameters: PhysicalParameters, name: str, judged: Verdict) -> Separated:
        """Tabulate what is known of the robot of some data."""
        numbers = physical_numbers(parameters)
        return cls(
            title=f"{PHYSICAL_TITLE} of {name!r}",
            summary=(*judged.lines, *physical_sentences(parameters)),
            content={
                "rows": [{"parameter": parameter} | row for parameter, row in numbers.items()]
            },
            judged=judged,
        )
