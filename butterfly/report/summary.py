"""The summary of an identification, and its tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np

from butterfly.errors import InputError, listed
from butterfly.identification.data import DataSet
from butterfly.identification.design import MOST_RUNS, OF_GOAL, Candidate, Plan
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identified import Identified
from butterfly.identification.trust import Trust, unit_of
from butterfly.identification.validate import CrossValidation, Structure
from butterfly.identification.weak_regression import EncoderOffset, OffsetKind, encoder_offsets
from butterfly.logs.health import thinned
from butterfly.logs.log import InputKind, Log
from butterfly.logs.motors import described_origin
from butterfly.model.prior import PHYSICAL, Prior
from butterfly.model.terms import TERMS
from butterfly.report.finding_texts import REMEDY, estimate_verdict, grave_notes, minor_notes
from butterfly.report.format import counted, fit_text, times_text, upwards
from butterfly.report.inspection import conditions_text
from butterfly.report.page import Fact, PageTable
from butterfly.report.parameter_table import (
    agreement_table,
    model_sentences,
    model_table,
    parameter_table,
    physical_table,
    values_table,
)
from butterfly.signals.frequency_response import ResponsePoint, response_point
from butterfly.verdict import Level

_MEASURED = {
    ("angle",): "angle",
    ("velocity",): "velocity (no angle was recorded)",
    ("angle", "velocity"): "angle, or velocity where no angle was recorded,",
}

_ERRORS = ("name", "std error", "95 % interval", "leave-one-mass-out")


def summary(identification: Identified) -> list[str]:
    """Return the verdict, then all that was found, gravest first."""
    data, estimate = identification.data, identification.estimate
    conditions = [health.condition for health in data.health]
    worst = Level.worst(conditions)
    where = "" if worst is Level.GOOD else " `butterfly inspect` says which, and why."
    health = f"Health of the {conditions_text(conditions)}{where}"
    unsound = worst in {Level.CARE, Level.WARNING}
    used = sum(log.time.size for log in data.logs)
    sound = sum(health.samples - health.dropped for health in data.health)
    means = f"Fitted to {used:,} means of neighbouring samples, of {sound:,} recorded samples."
    return [
        *estimate_verdict(estimate).lines,
        *_of_motors(data, estimate),
        *grave_notes(estimate),
        *([health] if unsound else []),
        _fit(identification),
        *_drive_alone(identification),
        *held_out_sentences(identification.held_out),
        _basis(identification),
        *([means] if used != sound else []),
        *model_sentences(identification),
        *_known(data, estimate),
        *minor_notes(estimate),
        *([] if unsound else [health]),
    ]


def _of_motors(data: DataSet, estimate: Estimate) -> list[str]:
    """Say whose values were used that are not the user's own."""
    by_origin: dict[str, list[str]] = {}
    for name, value in data.given.values.items():
        if value.origin:
            unit = unit_of(name, estimate.input_kind) if name in TERMS else PHYSICAL[name]
            by_origin.setdefault(value.origin, []).append(f"{name} = {value} {unit.strip('–')}")
    return [
        f"Known from {described_origin(origin)}: {', '.join(map(str.strip, texts))}."
        for origin, texts in by_origin.items()
    ]


def _known(data: DataSet, estimate: Estimate) -> list[str]:
    """Say which values were given, which follow from these, and which are assumed and why."""
    given, assumed = data.given.values, data.assumed
    known = estimate.given.values
    texts = {
        "Given": [f"{name} = {value}" for name, value in given.items() if not value.origin],
        "Follows from what was given": [
            f"{name} = {value}" for name, value in known.items() if name not in {*given, *assumed}
        ],
        "Assumed": [f"{name} = 0 ({why})" for name, why in assumed.items() if name in known],
    }
    return [f"{what}: {', '.join(values)}." for what, values in texts.items() if values]


def _basis(identification: Identified) -> str:
    """Say which logs and which method the values come from."""
    data = identification.data
    inputs = {"torque": "torque input", "none": "no input, free swing"}
    drive = inputs.get(data.input_kind, f"{data.input_kind} input")
    laws = dict.fromkeys(log.servo.law for log in data.logs if log.closed and log.servo)
    drive += f", servo loop ({', '.join(laws)})" if laws else ""
    masses = data.masses
    several = "poses of the others" if masses[0].label else "added masses"
    added = str(masses[0]) if len(masses) == 1 else f"{len(masses)} {several}"
    method = identification.estimate.method
    return f"{counted(len(data.logs), 'log')}, {added}, {drive}, method {method}."


def _fit(identification: Identified) -> str:
    """Say how well free runs reproduce the logs."""
    fit, data = identification.fit, identification.data
    measured = _MEASURED[tuple(sorted({log.measures for log in data.logs}))]
    worst = min(identification.fits, key=lambda name: identification.fits[name])
    looped = any(log.closed and log.servo for log in data.logs)
    driven = data.input_kind is not InputKind.NONE
    known = ["the set-point" if looped else "the recorded input"] if driven else []
    source = " and ".join([*known, *_start(fit, data)]) or "the start"
    velocity = ""
    if measured == "angle" and math.isfinite(identification.velocity_fit.median):
        velocity = f"; velocity {fit_text(identification.velocity_fit.median)} %"
    return (
        f"From {source} alone, the model reproduces the measured {measured} "
        f"with a median FIT of {fit_text(fit.median)} % (mean {fit_text(fit.mean)} %, worst "
        f"{fit_text(fit.worst)} %, {worst}){velocity}. {fit.holds}"
    ).rstrip()


def tables(identification: Identified) -> list[PageTable]:
    """Return parameters beside the true ones if known, physical ones, and FIT of others."""
    estimate, fit = identification.estimate, identification.fit
    rows = estimate.table(identification.truth)
    parts = [
        values_table(f"{identification.origin['name']}: {estimate.method}", rows),
        parameter_table("Errors and intervals", rows, *_ERRORS, detail=True),
    ]
    if (of_model := model_table(identification)).rows:
        parts.insert(1, of_model)
    if estimate.agreement:
        parts.append(agreement_table(estimate.agreement))
    if (derived := physical_table(identification.separated(), identification.zeros)).rows:
        parts.append(derived)
    if estimate.resonances:
        resonances = [(str(mass), f"{w:.4f}") for mass, w in estimate.resonances.items()]
        parts.append(PageTable("Resonance, as this method finds it", ("", "rad/s"), resonances))
    if (servo := loop_table(identification)).rows:
        parts.append(servo)
    if identification.comparisons:
        fits = [(f"{estimate.method}, this identification", fit)]
        for other in identification.comparisons:
            gain = f" (best p4: {other.parameters.p4:.4g})" if other.gain_fitted else ""
            fits.append((other.name + gain, other.fit))
        lines = [(name, *map(fit_text, (f.median, f.mean, f.worst))) for name, f in fits]
        title = f"FIT in %{fit.over} on the same logs"
        parts.append(PageTable(title, ("parameters", "median", "mean", "worst"), lines))
    return parts


def facts(identification: Identified, numbers: Mapping[str, Any]) -> list[Fact]:
    """Return the numbers that matter most, of an identification and its document."""
    fit, fits = identification.fit, identification.fits
    worst = min(fits, key=lambda name: fits[name])
    masses = numbers["data"].get("added_masses", [])
    return [
        Fact("FIT, median of all logs", f"{fit_text(fit.median)} %", f"100 % is perfect{fit.over}"),
        Fact("FIT, worst log", f"{fit_text(fit.worst)} %", worst.rsplit("/", maxsplit=1)[-1]),
        *([] if fit.whole is None else [Fact("FIT, whole runs", f"{fit_text(fit.whole)} %")]),
        *_of_logs(identification, numbers.get("residuals") or {}),
        Fact(
            "logs",
            str(len(fits)),
            f"{len(masses)} added masses" if len(masses) > 1 else "".join(masses),
        ),
        Fact("method", identification.estimate.method),
    ]


def _of_logs(identification: Identified, residuals: Mapping[str, Any]) -> list[Fact]:
    """Say how large the error is."""
    servo = []
    if rows := loop_table(identification).rows:
        (*_, error), (_, opened, *_), *_ = rows
        off = f"in the loop {error} m{identification.estimate.joint.way} error"
        servo = [Fact("FIT, by the drive alone", f"{opened} %", off)]
    if residuals.get("times_sensors") is None:
        return servo
    noise = f"of the motion; {times_text(residuals['times_sensors'])} times the sensor noise"
    error = f"{100 * residuals['after_small_changes']:.2g} %"
    return [*servo, Fact("model error", error, noise)]


def loop_table(identification: Identified) -> PageTable:
    """Tabulate how servos' logs are followed in the loop, and by the drive alone."""
    headers = ("FIT in %", "median", "mean", "worst", "mean error in mrad")
    rows: list[tuple[str, ...]] = []
    for which, fits in {"": identification.fits, ", held out": identification.held_out}.items():
        names = [name for name in fits if name in identification.open_loop_fits]
        if not names:
            continue
        error = 1e3 * np.mean([identification.mean_errors[name] for name in names])
        ways = {"in the loop": fits, "by the drive alone": identification.open_loop_fits}
        for (way, values), off in zip(ways.items(), (f"{error:.1f}", "–"), strict=True):
            fit = FitSummary.of(np.array([values[name] for name in names]))
            rows.append((way + which, *map(fit_text, (fit.median, fit.mean, fit.worst)), off))
    return PageTable("Servo", headers, rows, name="loop")


def _drive_alone(identification: Identified) -> list[str]:
    """Say what servos' logs are off by in the loop, and how they are followed without it."""
    rows = [row for row in loop_table(identification).rows if "held out" not in str(row[0])]
    if not rows:
        return []
    (_, closed, *_, error), (_, opened, *_) = rows
    return [
        f"FIT in the loop {closed} % (median), mean error {error} "
        f"m{identification.data.joint.way}; by the drive alone {opened} %."
    ]


def _start(fit: FitSummary, data: DataSet) -> list[str]:
    """Say which starts are fitted, if any."""
    if fit.horizon is not None:
        return [f"a fitted initial state every {fit.horizon:g} s"]
    moving = any(log.initial_state.velocity for log in data.logs)
    return ["a fitted initial state"] if moving else []


def held_out_sentences(fits: Mapping[str, float]) -> list[str]:
    """Say how well logs are followed that were not used, by FIT in per cent and name."""
    if not fits:
        return []
    values = sorted(fits.values())
    if len(fits) == 1:
        (name,), fit = fits, fit_text(values[0])
        return [f"Held out: {name}, not used for the fit, has a FIT of {fit} %."]
    return [
        f"Held out: {len(fits)} logs, not used for the fit, have a median FIT of "
        f"{fit_text(median(values))} % (worst {fit_text(values[0])} %): {listed(list(fits))}."
    ]


def zero_sentences(logs: Sequence[Log], known: Prior) -> list[str]:
    """Give the encoder zeros of logs and their sources, then those that are a guess."""
    if not logs or known.weightless(log.added_mass for log in logs):
        return []
    logs = [thinned(log) for log in logs]
    zeros = encoder_offsets(logs, [_response(log) for log in logs])
    texts, guessed = [], []
    for text in dict.fromkeys(map(_zero_text, zeros)):
        group = [log for log, zero in zip(logs, zeros, strict=True) if _zero_text(zero) == text]
        where = "" if len(group) == len(logs) else f" {_named(group, logs)}"
        if text:
            texts.append(f"{text}{where}")
        else:
            guessed.append(f"The encoder zero{where} is a guess: {REMEDY}.")
    return [*([f"Encoder zero: {'; '.join(texts)}."] if texts else []), *guessed]


def _zero_text(zero: EncoderOffset) -> str:
    """Return an encoder zero as it is printed; "" of a guess."""
    return "" if zero.kind is OffsetKind.GUESS else str(zero)


def _named(group: Sequence[Log], logs: Sequence[Log]) -> str:
    """Name some of the logs, by what they carry if all with the same are among them."""
    masses = {log.added_mass for log in group}
    if len(group) == sum(log.added_mass in masses for log in logs):
        return f"with {' and '.join(str(mass) for mass in sorted(masses))}"
    return f"in {listed([log.name for log in group])}"


def _response(log: Log) -> ResponsePoint | None:
    """Return the steady response to a sine; None for another input, or where there is none."""
    try:
        return response_point(log) if log.excitation else None
    except InputError:
        return None


def next_run_text(best: Plan[Candidate], estimate: Estimate, goal: float, now: float) -> str:
    """Say what to run next, what it costs, and what half-widths it gives; ``now``: the largest.

    It names no value that is not significant.
    """
    names = [name for name in estimate.names if name in OF_GOAL]
    claimed = [name for name in names if estimate.trust[name] is not Trust.ZERO]
    concerned, aim = ", ".join(claimed or names), f"{100 * goal:.3g} %"
    if now <= goal:
        return f"No run is needed: {concerned} are within {aim}."
    run, short = best.recipe, best.expected[1] > 1
    change = ", a change of mass included" if best.change else ""
    text = (
        f"Run next: {run.what}, with {run.log.added_mass}, {counted(best.runs, 'run')} of "
        f"{best.duration:.3g} s ({best.seconds:.0f} s of robot time{change}): {concerned} within "
        f"{upwards(goal * best.expected[1]) if short else aim}"
    )
    text += f" (now {upwards(now)})" if math.isfinite(now) else ""
    text += f"; {aim} is not reached in {MOST_RUNS} runs" if short else ""
    return f"{text}; but: {run.warning}." if run.warning else f"{text}."


def selection_texts(passed: Sequence[Structure], nested: CrossValidation | None) -> list[str]:
    """Say which terms were chosen, as an option of other commands, and what choosing predicts."""
    terms = ",".join(passed[-1].terms)
    texts = [
        f"Chosen: --terms {terms}" if terms else "Chosen: --terms '' (none of the terms helps)"
    ]
    if nested is not None:
        mean, error = nested.mean
        texts.append(
            f"With terms chosen again without it, {nested.division.left_out} in turn, what was "
            f"left out is predicted with a mean FIT of {mean:.1f} \N{PLUS-MINUS SIGN} {error:.1f} "
            "%."
        )
    return texts


def medians_of(row: Mapping[str, Any]) -> dict[str, float]:
    """Return the median FITs in % of a set of terms, in sample and by what was held out."""
    held = {f"held out, by {split}": fit["median"] for split, fit in row["left_out"].items()}
    return {"in sample": row["in_sample"]["median"], **held}
