"""What was found, in plain English: of an identification as a whole, and of the next step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median

import numpy as np

from butterfly.errors import InputError, listed
from butterfly.identification.data import DataSet
from butterfly.identification.design import Candidate
from butterfly.identification.encoder_offset import OffsetKind, encoder_offsets
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identification import Identification
from butterfly.identification.validate import CrossValidation, Structure
from butterfly.logs.log import Log
from butterfly.logs.thinning import thinned
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import Prior
from butterfly.report.agreement_texts import agreement_table
from butterfly.report.finding_texts import REMEDY, estimate_notes, estimate_verdict
from butterfly.report.format import counted, fit_text
from butterfly.report.inspection import conditions_text
from butterfly.report.parameter_table import parameter_texts, physical_table
from butterfly.result import TextTable
from butterfly.signals.frequency_response import ResponsePoint, response_point
from butterfly.verdict import Level

_MEASURED = {
    ("angle",): "angle",
    ("velocity",): "velocity (no angle was recorded)",
    ("angle", "velocity"): "angle, or velocity where no angle was recorded,",
}


LOOP_HEADERS = ("FIT in %", "median", "mean", "worst", "mean error in mrad")
"""Of the table of `loop_rows`."""


def summary(identification: Identification) -> list[str]:
    """Say in plain words what was found: the verdict, what it rests on, then the numbers."""
    fit, data, estimate = identification.fit, identification.data, identification.estimate
    told = {"torque": "driven by torque command", "none": "swinging freely"}
    drive = told.get(data.input_kind, f"driven by {data.input_kind}")
    laws = dict.fromkeys(log.servo.law for log in data.logs if log.closed and log.servo)
    drive += f", in the loop of a servo ({', '.join(laws)})" if laws else ""
    how = "in its loop from the set-point" if laws else "with the recorded input"
    masses = data.masses
    carried = str(masses[0]) if len(masses) == 1 else f"{len(masses)} added masses"
    known = ", ".join(f"{name} = {value}" for name, value in estimate.told.values.items())
    measured = _MEASURED[tuple(sorted({log.measures for log in data.logs}))]
    also = f", and its velocity with {fit_text(identification.velocity_fit.median)} %"
    besides = also if measured == "angle" else ""
    worst = min(identification.fits, key=lambda name: identification.fits[name])
    return [
        *estimate_verdict(estimate).lines,
        f"{counted(len(data.logs), 'log')} with {carried}, {drive}, method: {estimate.method}.",
        f"Simulated {_stretch(fit, data)} {how} alone, the model follows "
        f"the measured {measured} with a median FIT of {fit_text(fit.median)} % (mean "
        f"{fit_text(fit.mean)} %, worst {fit_text(fit.worst)} %, of {worst}){besides}; 100 % is "
        "perfect, 0 % no better than a constant.",
        *_drive_alone(identification),
        *held_out_sentences(identification.held_out),
        *_thinned(data),
        *([f"Known beforehand: {known}."] if known else []),
        *estimate_notes(estimate),
        _health(data),
    ]


def tables(identification: Identification, truth: LumpedParameters | None) -> list[TextTable]:
    """Return parameters beside the true ones if known, physical ones, and FIT of others."""
    estimate, fit = identification.estimate, identification.fit
    columns = {
        "symbol": "",
        "true": "true",
        "deviation": "deviation",
        "value": "estimate",
        "error": "std error",
        "interval": "95 % interval",
        "unit": "unit",
        "left_out": "one mass left out",
    }
    texts = map(parameter_texts, estimate.table(truth))
    rows = [[row[column] for column in columns] for row in texts]
    title = f"{identification.origin['name']}: {estimate.method}"
    found = [TextTable(title, [*columns.values()], rows)]
    if estimate.agreement:
        found.append(agreement_table(estimate.agreement))
    if (derived := physical_table(identification.separated())).rows:
        found.append(derived)
    if estimate.resonances:
        resonances = [(str(mass), f"{w:.4f}") for mass, w in estimate.resonances.items()]
        found.append(TextTable("Resonance, as this method finds it", ("", "rad/s"), resonances))
    if servo := loop_rows(identification):
        found.append(TextTable("Servo", LOOP_HEADERS, servo))
    if identification.comparisons:
        fits = [(f"{estimate.method}, this identification", fit)]
        for other in identification.comparisons:
            gain = f" (best p4: {other.parameters.p4:.4g})" if other.gain_fitted else ""
            fits.append((other.name + gain, other.summary))
        lines = [(name, *map(fit_text, (f.median, f.mean, f.worst))) for name, f in fits]
        title = f"FIT in %{fit.over} on the same logs"
        found.append(TextTable(title, ("parameters", "median", "mean", "worst"), lines))
    return found


def loop_rows(identification: Identification) -> list[tuple[str, ...]]:
    """Tabulate how servos' logs are followed in the loop, and by the drive alone."""
    rows = []
    parts = {"": identification.fits, ", held out": identification.held_out}
    for which, fits in parts.items():
        names = [name for name in fits if name in identification.drive_fits]
        if not names:
            continue
        error = 1e3 * np.mean([identification.mean_errors[name] for name in names])
        ways = {"in the loop": fits, "by the drive alone": identification.drive_fits}
        for (way, own), off in zip(ways.items(), (f"{error:.1f}", "–"), strict=True):
            fit = FitSummary.of(np.array([own[name] for name in names]))
            rows.append((way + which, *map(fit_text, (fit.median, fit.mean, fit.worst)), off))
    return rows


def _drive_alone(identification: Identification) -> list[str]:
    """Say what servos' logs are off by in the loop, and how they are followed without it."""
    rows = [row for row in loop_rows(identification) if "held out" not in row[0]]
    if not rows:
        return []
    (_, closed, *_, error), (_, opened, *_) = rows
    return [
        f"FIT in the loop {closed} % (median), {error} m{identification.data.joint.way} off on "
        f"average; by the drive alone {opened} %."
    ]


def _health(data: DataSet) -> str:
    """Say in which condition the logs are, and where that is told of each."""
    conditions = [health.condition for health in data.health]
    sound = Level.worst(conditions) is Level.GOOD
    where = "" if sound else " `butterfly inspect` tells which, and why."
    return f"Health of the {conditions_text(conditions)}{where}"


def _stretch(fit: FitSummary, data: DataSet) -> str:
    if fit.horizon is None:
        moving = any(log.initial_state.velocity for log in data.logs)
        fitted = " (where a log begins in motion, from a start that was fitted to it)"
        return f"from the first sample on{fitted if moving else ''}"
    return f"over segments of {fit.horizon:g} s, each from a start that was fitted to it,"


def held_out_sentences(fits: Mapping[str, float]) -> list[str]:
    """Say how well logs are followed that were not used, by FIT in per cent and name."""
    if not fits:
        return []
    values = sorted(fits.values())
    if len(fits) == 1:
        return [
            f"Held out: {next(iter(fits))}, not used for the fit, has a FIT of "
            f"{fit_text(values[0])} %."
        ]
    return [
        f"Held out: {len(fits)} logs, not used for the fit, have a median FIT of "
        f"{fit_text(median(values))} % (worst {fit_text(values[0])} %): {listed(list(fits))}."
    ]


def _thinned(data: DataSet) -> list[str]:
    """Say how many samples were averaged, where logs have more than their motion needs."""
    used = sum(log.time.size for log in data.logs)
    sound = sum(health.samples - health.dropped for health in data.health)
    if used == sound:
        return []
    return [f"{used:,} means of neighbouring samples stand for the {sound:,} that were recorded."]


def zero_sentences(logs: Sequence[Log], known: Prior) -> list[str]:
    """Say where the hand hangs in logs, how that was found, and in which of them it is a guess."""
    if not logs or known.weightless(log.added_mass for log in logs):
        return []
    logs = [thinned(log) for log in logs]
    zeros = encoder_offsets(logs, [_response(log) for log in logs])
    sentences = []
    for zero in dict.fromkeys(zeros):
        own = [log for log, each in zip(logs, zeros, strict=True) if each == zero]
        where = "" if len(own) == len(logs) else f" {_named(own, logs)}"
        if zero.kind is OffsetKind.GUESS:
            sentences.append(f"Where the hand hangs{where} is a guess: {REMEDY}.")
        else:
            sentences.append(f"The hand hangs at {zero}{where}.")
    return sentences


def _named(own: Sequence[Log], logs: Sequence[Log]) -> str:
    """Name some of the logs, by what they carry if all with the same are among them."""
    masses = {log.added_mass for log in own}
    if len(own) == sum(log.added_mass in masses for log in logs):
        return f"with {' and '.join(str(mass) for mass in sorted(masses))}"
    return f"in {listed([log.name for log in own])}"


def _response(log: Log) -> ResponsePoint | None:
    """Return the steady response to a sine; None for another input, or where there is none."""
    try:
        return response_point(log) if log.excitation else None
    except InputError:
        return None


def best_experiment_text(best: Candidate) -> str:
    """Say which experiment comes first, and what it would leave of the standard errors."""
    warning = f"; but: {best.warning}." if best.warning else "."
    return (
        f"Most telling next: {best.what} with {best.added_mass}, which leaves "
        f"{100 * best.score:.0f} % of the standard errors on average{warning}"
    )


def selection_texts(passed: Sequence[Structure], nested: CrossValidation | None) -> list[str]:
    """Say which terms were chosen, as an option of other commands, and what choosing predicts."""
    terms = ",".join(passed[-1].terms)
    texts = [f"Chosen: --terms {terms}" if terms else "Chosen: --terms '' (none of them helps)"]
    if nested is not None:
        mean, error = nested.mean
        texts.append(
            f"Chosen anew, {nested.division.left_out} in turn, the terms predict what was left out "
            f"with a mean FIT of {mean:.1f} \N{PLUS-MINUS SIGN} {error:.1f} %."
        )
    return texts
