"""Results of comparisons: simulators with logs, and estimators with each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from butterfly.api.results import Tabulated, about_log
from butterfly.comparison.leaderboard import Entry, equals
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.residuals import Residuals, residual_units
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import counted
from butterfly.report.numbers import estimate_numbers, residual_numbers, rests_on
from butterfly.result import Answer
from butterfly.verdict import Level, Verdict

if TYPE_CHECKING:
    from butterfly.comparison.three_way import ThreeWay  # with MuJoCo, which is slow


class Compared(Tabulated):
    """MuJoCo, the grey-box model and the logs, given the same input."""

    kind: ClassVar[str] = "comparison"

    @classmethod
    def of(
        cls,
        data: DataSet,
        estimator: Estimator | None,
        compared: Sequence[ThreeWay],
        residuals: Residuals,
        found: Estimate,
    ) -> Compared:
        """Tabulate logs, each simulated twice, and their residuals."""
        from butterfly.report.residual import residual_sentences  # noqa: PLC0415 - slow to import
        from butterfly.report.three_way_page import three_way_page  # noqa: PLC0415 - slow to import

        verdict, way = estimate_verdict(found), data.joint.way
        judged = {log.name: log for log in residuals.logs}
        own = tuple(judged[each.log.name] for each in compared)
        result = cls(
            title=f"MuJoCo, grey-box model and logs of {data.name!r}",
            summary=(
                *verdict.lines,
                *_comparison_sentences(compared),
                *residual_sentences(replace(residuals, logs=own)),
            ),
            judged=verdict,
            content={
                **rests_on(data, found, estimator),
                "rows": [
                    {
                        **about_log(each.log),
                        **{f"FIT {name} in %": fit for name, fit in each.fits.items()},
                        f"simulators apart in {way}": each.difference,
                        **{f"gain {name}": abs(gain) for name, gain in each.gains.items()},
                        "error in % of the motion": 100 * judged[each.log.name].relative,
                        "outside its bands": judged[each.log.name].outside,
                        "residual over sensors": judged[each.log.name].times,
                        "missing terms explain in %": 100 * judged[each.log.name].share,
                    }
                    for each in compared
                ],
                "logs": [
                    {
                        "log": each.log.name,
                        "fit": each.fits,
                        "largest_difference": each.difference,
                        "gain_ratio": {
                            name: [abs(gain), float(np.angle(gain))]
                            for name, gain in each.gains.items()
                        },
                    }
                    for each in compared
                ],
                "residuals": residual_numbers(residuals, found),
            },
            units={
                "logs.fit": "%",
                "logs.largest_difference": way,
                "logs.gain_ratio": "1, rad",
                **residual_units(data.joint),
            },
        )
        return result.drawn_as(three_way_page(data, compared, residuals, result))


def _comparison_sentences(compared: Sequence[ThreeWay]) -> list[str]:
    """State the fit of both simulators, and the difference between them."""
    apart = max(each.difference for each in compared)
    way = compared[0].log.added_mass.joint.way
    fits = {key: np.array([each.fits[key] for each in compared]) for key in compared[0].fits}
    said = ", ".join(
        f"{key} {np.median(fit):.2f} % (worst {fit.min():.2f} %)" for key, fit in fits.items()
    )
    return [
        f"{counted(len(compared), 'log')}, same parameters and recorded input. Median FIT: {said}.",
        f"Largest difference between the simulators: {apart:.2g} {way}.",
    ]


class Leaderboard(Answer):
    """Ranking of methods on each data set."""

    kind: ClassVar[str] = "leaderboard"
    table: ClassVar[str] = "entries"

    @classmethod
    def of(cls, entries: Sequence[Entry]) -> Leaderboard:
        """Tabulate the ranked estimators of each data set."""
        from butterfly.report.ranking_pages import leaderboard_page  # noqa: PLC0415 - slow to import

        sets = list(dict.fromkeys(entry.data for entry in entries))
        firsts = [next(entry for entry in entries if entry.data == name) for name in sets]
        verdict = Verdict.of_several(
            {
                f"{each.data}, {each.method}": estimate_verdict(each.estimate)
                if each.estimate
                else Verdict(Level.WARNING, (each.error,))
                for each in firsts
            }
        )
        result = cls(
            title="Ranking of methods: " + ", ".join(sets),
            summary=(
                *verdict.lines,
                *(_best_sentence([each for each in entries if each.data == name]) for name in sets),
            ),
            judged=verdict,
            content={"entries": [_entry(entry) for entry in entries]},
            units={"entries.held_out": "%", "entries.in_sample": "%", "entries.seconds": "s"},
        )
        return result.drawn_as(leaderboard_page(entries, result))


def _best_sentence(entries: Sequence[Entry]) -> str:
    """Name the methods with the best held-out FIT on a data set."""
    best, equal = entries[0], equals(entries)
    if best.held_out is None:
        return f"{best.data}: no method could predict the held-out logs."
    fit = f"median FIT{best.held_out.over} {best.held_out.median:.1f} %"
    how = f"{fit} ({best.left_out} at a time)"
    if len(equal) == 1:
        return f"{best.data}: {best.method} predicts held-out logs best, {how}."
    names = " and ".join(each.method for each in equal)
    return f"{best.data}: no clear winner; {names} do not differ significantly, {how}."


def _entry(entry: Entry) -> dict[str, Any]:
    found: dict[str, Any] = {"verdict": None, "reasons": []}
    if entry.estimate is not None:
        found = estimate_verdict(entry.estimate).numbers() | estimate_numbers(entry.estimate)
    return {
        **found,
        "data": entry.data,
        "method": entry.method,
        "left_out_together": entry.left_out or None,
        "seconds": entry.seconds,
        "error": entry.error,
        "held_out": entry.held_out and entry.held_out.numbers(),
        "in_sample": entry.in_sample and entry.in_sample.numbers(),
    }
