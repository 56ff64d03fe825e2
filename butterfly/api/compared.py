"""Results of comparisons: simulators with logs, and estimators with each other."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from butterfly.api.results import Tabulated, about_log
from butterfly.comparison.leaderboard import Entry, equals
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.parameter import or_nan
from butterfly.identification.residuals import Residuals, residual_units
from butterfly.model.parameters import JointKind
from butterfly.model.terms import PARAMETERS
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import counted, fit_text
from butterfly.report.numbers import (
    RESIDUAL_CAPTION,
    RESIDUAL_COLUMNS,
    estimate_numbers,
    residual_numbers,
    residual_row,
    rests_on,
)
from butterfly.report.page import Fact, PageTable
from butterfly.verdict import Level, Verdict

if TYPE_CHECKING:
    from butterfly.comparison.three_way import ThreeWay  # with MuJoCo, which is slow


_STEPS = "MuJoCo is stepped as `run` steps it; `export` measures its file in its own steps."


class Compared(Tabulated):
    """MuJoCo, the grey-box model and the logs, given the same input."""

    kind: ClassVar[str] = "comparison"
    plots: ClassVar[Mapping[str, str]] = {"fits": "fits", "frequency": "frequencies"}

    @classmethod
    def of(
        cls,
        data: DataSet,
        estimator: Estimator | None,
        compared: Sequence[ThreeWay],
        residuals: Residuals,
        estimate: Estimate,
    ) -> Compared:
        """Tabulate logs, each simulated twice, and their residuals."""
        from butterfly.report.residual import residual_sentences  # noqa: PLC0415 - slow to import
        from butterfly.report.three_way_page import with_courses  # noqa: PLC0415 - slow to import

        verdict, way = estimate_verdict(estimate), data.joint.way
        judged = {log.name: log for log in residuals.logs}
        log_residuals = tuple(judged[comparison.log.name] for comparison in compared)
        return cls(
            title=f"MuJoCo, grey-box model and logs of {data.name!r}",
            summary=(
                *verdict.after(_comparison_sentence(compared)),
                _STEPS,
                *residual_sentences(replace(residuals, logs=log_residuals)),
            ),
            judged=verdict,
            content={
                **rests_on(data, estimate, estimator),
                "rows": [
                    {
                        **about_log(comparison.log),
                        **{f"FIT {name} in %": fit for name, fit in comparison.fits.items()},
                        f"simulators apart in {way}": comparison.difference,
                        **_responses(comparison),
                        **residual_row(log),
                    }
                    for comparison, log in zip(compared, log_residuals, strict=True)
                ],
                "residuals": residual_numbers(residuals, estimate),
            },
            units=residual_units(data.joint),
            live=partial(with_courses, compared, log_residuals),
        )

    def shown_rows(self) -> list[dict[str, str]]:
        """Return FITs of both simulators and their difference, formatted as text."""
        hidden = {*RESIDUAL_COLUMNS, *self._responses}
        return [
            {name: cell for name, cell in shown.items() if name not in hidden}
            for shown in super().shown_rows()
        ]

    def further(self) -> list[PageTable]:
        """Return the errors of both in amplitude and phase, and the residuals of the grey box."""
        shown, columns = super().shown_rows(), ("log", *RESIDUAL_COLUMNS)
        unexplained = [[row[name] for name in columns] for row in shown]
        errors = [
            (cells["log"], *(_signed(row[name]) for name in self._responses))
            for row, cells in zip(self.rows(), shown, strict=True)
        ]
        return [
            PageTable("Amplitude and phase", ("log", *self._responses), errors, detail=True),
            PageTable("Residuals", columns, unexplained, caption=RESIDUAL_CAPTION),
        ]

    @property
    def _responses(self) -> list[str]:
        """The columns of the errors in amplitude and phase."""
        return [name for name in self.rows()[0] if re.match("(amplitude|phase) error ", name)]

    def facts(self) -> list[Fact]:
        """Return the numbers that matter most."""
        rows, way = self.rows(), JointKind(self.content["data"]["joint"]).way
        difference = max(or_nan(row[f"simulators apart in {way}"]) for row in rows)
        return [
            *self.fit_facts("FIT MuJoCo in %", "of MuJoCo"),
            *self.fit_facts("FIT grey box in %", "of the grey box"),
            Fact("MuJoCo − grey box", f"{difference:.2g} {way}", "largest difference"),
            Fact("logs compared", str(len(rows)), f"of {self.content['data']['logs']}"),
        ]


def _responses(comparison: ThreeWay) -> dict[str, float]:
    """Return how the steady responses of the simulators differ from that of the log."""
    cells = {}
    for name in comparison.fits:
        gain = comparison.gains.get(name, complex(np.nan, np.nan))
        cells[f"amplitude error {name} in %"] = float(100 * (np.abs(gain) - 1))
        cells[f"phase error {name} in °"] = float(np.degrees(np.angle(gain)))
    return cells


def _signed(error: float | None) -> str:
    """Return an error with its sign; a dash for none."""
    return "–" if error is None or np.isnan(error) else f"{error:+.2g}"


def _comparison_sentence(compared: Sequence[ThreeWay]) -> str:
    """State how far the simulators are from each other, and the fit of both."""
    difference = max(comparison.difference for comparison in compared)
    way = compared[0].log.added_mass.joint.way
    fits = {
        key: np.array([comparison.fits[key] for comparison in compared]) for key in compared[0].fits
    }
    medians = ", ".join(
        f"{key} {np.median(fit):.2f} % (worst {fit.min():.2f} %)" for key, fit in fits.items()
    )
    return (
        f"MuJoCo and grey box differ by at most {difference:.2g} {way}, with the same parameters "
        f"and recorded input of {counted(len(compared), 'log')}. Median FIT: {medians}."
    )


class Leaderboard(Tabulated):
    """Ranking of methods on each data set."""

    kind: ClassVar[str] = "leaderboard"
    table: ClassVar[str] = "entries"
    plots: ClassVar[Mapping[str, str]] = {"fit": "leaderboard"}

    @classmethod
    def of(cls, entries: Sequence[Entry]) -> Leaderboard:
        """Tabulate the ranked estimators of each data set."""
        sets = {entry.data: [e for e in entries if e.data == entry.data] for entry in entries}
        verdict = Verdict.of_several(
            {
                f"{name}, {entry.method}": estimate_verdict(entry.estimate)
                if entry.estimate
                else Verdict(Level.WARNING, (entry.error,))
                for name, (entry, *_) in sets.items()
            }
        )
        winners = {
            name: [entry.method for entry in equals(ranked)] for name, ranked in sets.items()
        }
        return cls(
            title="Ranking of methods: " + ", ".join(sets),
            summary=verdict.after(*map(_best_sentence, sets.values())),
            judged=verdict,
            content={"entries": [_entry(entry) for entry in entries], "winners": winners},
            units={"entries.held_out": "%", "entries.in_sample": "%", "entries.seconds": "s"},
        )

    def shown_rows(self) -> list[dict[str, str]]:
        """Return a row for each method on each data set, the best of each first."""
        rows = []
        for row in self.rows():
            parameters = row.get("parameters") or {}
            fits = {
                f"FIT {name.replace('_', ' ')}, {which} in %": fit_text(row[name][which])
                if row[name]
                else "–"
                for name in ("held_out", "in_sample")
                for which in ("median", "worst")
            }
            values = {
                n: f"{parameters[n]['value']:#.4g}" if n in parameters else "–"
                for n in PARAMETERS[:5]
            }
            rows.append(
                {"estimator": row["method"], "data": row["data"], "verdict": row["verdict"] or "–"}
                | fits
                | {"time in s": f"{row['seconds']:.2f}", **values, "remark": row["error"]}
            )
        return rows

    def facts(self) -> list[Fact]:
        """Return the methods that predict best, and of how many."""
        facts, rows, winners = [], self.rows(), self.content["winners"]
        for name, methods in winners.items():
            best = next(row for row in rows if row["data"] == name)
            if best["held_out"]:
                label = "predict best, no clear winner" if len(methods) > 1 else "predicts best"
                fit = f"held out: median FIT {fit_text(best['held_out']['median'])} %, {name}"
                facts.append(Fact(label, ", ".join(methods), fit))
        count = str(len({row["method"] for row in rows}))
        return [*facts, Fact("methods", count), Fact("data sets", str(len(winners)))]


def _best_sentence(entries: Sequence[Entry]) -> str:
    """Name the methods with the best held-out FIT on a data set."""
    best, equal = entries[0], equals(entries)
    if best.held_out is None:
        return f"{best.data}: no method could predict the held-out logs."
    fit = f"median FIT{best.held_out.over} {best.held_out.median:.1f} %"
    how = f"{fit} ({best.left_out} at a time)"
    if len(equal) == 1:
        return f"{best.data}: {best.method} predicts held-out logs best, {how}."
    names = " and ".join(entry.method for entry in equal)
    return f"{best.data}: no clear winner; {names} do not differ significantly, {how}."


def _entry(entry: Entry) -> dict[str, Any]:
    numbers: dict[str, Any] = {"verdict": None, "reasons": []}
    if entry.estimate is not None:
        numbers = estimate_verdict(entry.estimate).numbers() | estimate_numbers(entry.estimate)
    return {
        **numbers,
        "data": entry.data,
        "method": entry.method,
        "left_out_together": entry.left_out or None,
        "seconds": entry.seconds,
        "error": entry.error,
        "held_out": entry.held_out and entry.held_out.numbers(),
        "in_sample": entry.in_sample and entry.in_sample.numbers(),
    }
