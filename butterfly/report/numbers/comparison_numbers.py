"""Simulators beside logs, and estimators beside each other, as numbers for programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from butterfly.comparison.leaderboard import Entry
from butterfly.comparison.three_way import ThreeWay
from butterfly.document import Told
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.misfit import Misfit
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.report.finding_texts import estimate_verdict, values_of
from butterfly.report.numbers.estimate_numbers import (
    estimate_numbers,
    left_over_numbers,
    misfit_numbers,
    misfit_units,
)
from butterfly.report.numbers.table_numbers import about, rests_on
from butterfly.report.residual import misfit_sentences
from butterfly.verdict import Level, Verdict


def told_comparison(
    data: DataSet,
    estimator: Estimator | None,
    compared: Sequence[ThreeWay],
    misfit: Misfit,
    found: Estimate,
) -> Told:
    """Tell logs, each simulated twice with an estimate, and the misfit of the data set."""
    verdict, way = estimate_verdict(found), data.joint.way
    judged = {log.name: log for log in misfit.logs}
    rows = [
        {
            **about(each.log),
            **{f"FIT {name} in %": fit for name, fit in each.fits.items()},
            f"simulators apart in {way}": each.difference,
            **{f"gain {name}": abs(gain) for name, gain in each.gains.items()},
            "error in % of the motion": 100 * judged[each.log.name].relative,
            "outside its bands": judged[each.log.name].outside,
            "left over looks like": judged[each.log.name].left_over.looks_like,
        }
        for each in compared
    ]
    return Told(
        kind="comparison",
        title=f"MuJoCo and grey box beside {data.name!r}",
        verdict=verdict,
        summary=(
            verdict.sentence,
            *_comparison_sentences(compared),
            *misfit_sentences(misfit),
        ),
        content={
            **rests_on(data, found, estimator),
            "rows": rows,
            "logs": [_of_log(each) for each in compared],
            "misfit": misfit_numbers(misfit, values_of(found)),
        },
        units={
            "logs.fit": "%",
            "logs.largest_difference": way,
            "logs.gain_ratio": "1, rad",
            **misfit_units(data.joint),
        },
    )


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


def _of_log(each: ThreeWay) -> dict[str, Any]:
    return {
        "log": each.log.name,
        "fit": each.fits,
        "largest_difference": each.difference,
        "gain_ratio": {k: [abs(g), float(np.angle(g))] for k, g in each.gains.items()},
        "residual_torque": left_over_numbers(each.residual.left_over),
    }


def told_leaderboard(entries: Sequence[Entry]) -> Told:
    """Tell estimators over data sets, the best of each first."""
    sets = list(dict.fromkeys(entry.data for entry in entries))
    verdict = _verdict(entries, sets)
    return Told(
        kind="leaderboard",
        title="Estimators over data sets: " + ", ".join(sets),
        verdict=verdict,
        summary=(verdict.sentence, *_leaderboard_sentences(entries)),
        content={"entries": [_entry(entry) for entry in entries]},
        units={"entries.held_out": "%", "entries.in_sample": "%", "entries.seconds": "s"},
    )


def _leaderboard_sentences(entries: Sequence[Entry]) -> list[str]:
    """Say which estimator predicts best what it has not seen, of each data set."""
    sentences = []
    for name in dict.fromkeys(entry.data for entry in entries):
        best = next(entry for entry in entries if entry.data == name)
        if best.held_out is None:
            sentences.append(f"{name}: no estimator could predict what was left out.")
            continue
        sentences.append(
            f"{name}: {best.method} predicts best what it has not seen ({best.left_out} at a "
            f"time), with a median FIT{best.held_out.over} of {best.held_out.median:.1f} %."
        )
    return sentences


def _verdict(entries: Sequence[Entry], sets: Sequence[str]) -> Verdict:
    """Say the worst verdict on the first of each data set, and all reasons, by their data set."""
    firsts = {name: next(entry for entry in entries if entry.data == name) for name in sets}
    levels, reasons = [], []
    for name, first in firsts.items():
        if first.estimate is None:
            levels.append(Level.WARNING)
            reasons.append(f"{name}: {first.error}")
            continue
        said = estimate_verdict(first.estimate)
        levels.append(said.level)
        reasons += [f"{name}, {first.method}: {reason}" for reason in said.reasons]
    return Verdict(Level.worst(levels) if levels else Level.WARNING, tuple(reasons))


def _entry(entry: Entry) -> dict[str, Any]:
    fits = {"held_out": entry.held_out, "in_sample": entry.in_sample}
    said: dict[str, Any] = {"verdict": None, "reasons": []}
    if entry.estimate is not None:
        known = estimate_numbers(entry.estimate)
        said = estimate_verdict(entry.estimate).numbers() | known
    return {
        **said,
        "data": entry.data,
        "method": entry.method,
        "left_out_together": entry.left_out or None,
        "seconds": entry.seconds,
        "error": entry.error,
    } | {name: None if fit is None else fit.numbers() for name, fit in fits.items()}
