"""What comparisons return: simulators beside logs, estimators beside each other."""

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
        """Tabulate logs, each simulated twice with an estimate, and the residuals of all."""
        from butterfly.report.residual import residual_sentences  # noqa: PLC0415 - slow to import
        from butterfly.report.three_way_page import three_way_page  # noqa: PLC0415 - slow to import

        verdict, way = estimate_verdict(found), data.joint.way
        judged = {log.name: log for log in residuals.logs}
        own = tuple(judged[each.log.name] for each in compared)
        result = cls(
            title=f"MuJoCo and grey box beside {data.name!r}",
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
    """Say how well the simulators follow the logs, and each other."""
    apart = max(each.difference for each in compared)
    way = compared[0].log.added_mass.joint.way
    fits = {key: np.array([each.fits[key] for each in compared]) for key in compared[0].fits}
    return [
        f"{len(compared)} logs, each simulated in MuJoCo and by the grey-box equation with the "
        "same parameters and the recorded input.",
        *(
            f"{key[:1].upper()}{key[1:]} follows the logs with a median FIT of "
            f"{np.median(fit):.2f} % (worst {fit.min():.2f} %)."
            for key, fit in fits.items()
        ),
        f"The two simulators are nowhere more than {apart:.2g} {way} apart.",
    ]


class Leaderboard(Answer):
    """Methods over data sets, the best of each first."""

    kind: ClassVar[str] = "leaderboard"
    table: ClassVar[str] = "entries"

    @classmethod
    def of(cls, entries: Sequence[Entry]) -> Leaderboard:
        """Tabulate estimators over data sets, the best of each first."""
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
            title="Estimators over data sets: " + ", ".join(sets),
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
    """Say which estimators predict held-out logs of a data set best."""
    best, equal = entries[0], equals(entries)
    if best.held_out is None:
        return f"{best.data}: no estimator could predict what was held out."
    fit = f"median FIT{best.held_out.over} {best.held_out.median:.1f} %"
    how = f"({best.left_out} held out at a time)"
    if len(equal) == 1:
        return f"{best.data}: {best.method} predicts held-out logs best {how}, {fit}."
    names = " and ".join(each.method for each in equal)
    return f"{best.data}: no clear winner; {names} do not differ beyond chance {how}, {fit}."


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
