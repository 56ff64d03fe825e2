"""The identification report: the answer first, then what it rests on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from butterfly.identification.data import DataSet
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identification import Identification
from butterfly.identification.parameter import Parameter
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.report.figures import middle
from butterfly.report.format import counted, fit_text, times_text
from butterfly.report.inspection import STATES, conditions_text
from butterfly.report.log_figures import (
    correlation_figure,
    correlation_series,
    spectrum_figure,
    spectrum_series,
    time_series,
)
from butterfly.report.page import Fact, Marked, Page, PageTable, Section, Whisker, tabulated
from butterfly.report.parameter_table import parameter_texts, physical_sentences, physical_table
from butterfly.report.residual import residual_sentences, residual_table
from butterfly.report.summary import LOOP_HEADERS, loop_rows

_RESPONSE = (
    "Points: measured, with two standard errors. Lines: the model at the swing that was measured, "
    "by its describing functions. Below, what is left between the two."
)
_RESPONSE_UNASKED = (
    "Lines: the model, by its describing functions, at the median rms swing of the logs. No log is "
    "of a sine, so there is nothing measured to set beside them."
)
_GOAL = " A servo is told its set-point (dotted), which it follows by its own loop."
_LOOP = (
    "In the loop the model is told the set-point, and the loop corrects it as it does the servo. "
    "By the drive alone nothing does: what the loop hides is seen there."
)
_COMPARED = ("p1", "p2", "p3", "p4", "coulomb")


def identification_page(
    identification: Identification, truth: LumpedParameters | None = None
) -> Page:
    """Put together the report of an identification, beside the truth where it is known."""
    data, residuals, plots = identification.data, identification.residuals, identification.plot
    table = identification.estimate.table(truth)
    runs = identification.free_runs
    chosen = middle(identification.fit_of_logs)
    states = [health.condition for health in data.health]
    lost = int(np.sum(~np.isfinite(identification.fit_of_logs)))  # they have no FIT
    sections = [
        Section(
            title="Frequency response",
            text=_RESPONSE if data.sines else _RESPONSE_UNASKED,
            figures={"frequency-response": plots.frequency_response()},
        ),
        Section(
            title="Measured against simulated",
            text="The model runs free: it is told the input, and of the motion the start alone."
            + _GOAL * bool(identification.drive_fits),
            series={"time": time_series(runs, [log.band for log in residuals.logs])},
        ),
        Section(
            title="Residuals",
            text="Measured less simulated motion of the chosen log, after small changes of the "
            "parameters: how like itself it is a while later, and how like the input before it. "
            "Where encoder and noise explain it, both curves stay inside the bands; a curve that "
            "leaves them is something that the model misses. Below, at which frequencies.",
            series={
                "left-over": correlation_series(residuals.logs),
                "spectrum": spectrum_series(runs, residuals.logs),
            },
            tables=(residual_table(residuals.logs, picks=range(len(runs))),),
        ),
        *_correlations(identification),
        Section(
            title="FIT log by log",
            text=f"Health of the {conditions_text(states)} A click on a point chooses its log."
            + (f" Not drawn: {counted(lost, 'log')} from which the model runs away." * (lost > 0)),
            figures={"fit": plots.fits()},
            tables=(_logs_table(identification),),
        ),
        *_physical(identification),
        *tabulated(
            "In the servo's loop, and by its drive alone",
            PageTable(name="loop", headers=LOOP_HEADERS, rows=loop_rows(identification)),
            _LOOP,
        ),
        *tabulated("Resonances", _resonances_table(identification)),
        *tabulated("Against other parameters", _against_table(identification)),
        *tabulated("Held out", _held_out_table(identification)),
    ]
    return Page(
        name=data.name,
        description=data.description,
        kind="identification",
        verdict=identification.judged,
        facts=_facts(identification),
        lead=_lead(table, data, with_truth=truth is not None),
        summary=[*identification.notes, *residual_sentences(residuals)],
        sections=sections,
        numbers=identification.to_dict(truth),
        logs=[f"{run.log.label} – FIT {fit_text(run.fit)} %" for run in runs],
        chosen=chosen,
        pictures={
            "parameters": partial(plots.parameters, truth),
            "time": plots.time,
            "left-over": partial(correlation_figure, residuals.logs[chosen]),
            "spectrum": partial(spectrum_figure, runs[chosen], residuals.logs[chosen]),
        },
    )


def _facts(identification: Identification) -> list[Fact]:
    fit, data = identification.fit, identification.data
    masses = {mass for mass in data.masses if mass.mass}
    added = f"{len(data.masses)} added masses" if len(data.masses) > 1 else str(data.masses[0])
    times = identification.residuals.times
    servo = []
    if rows := loop_rows(identification):
        (*_, error), (_, opened, *_), *_ = rows
        servo = [Fact("FIT, by the drive alone", f"{opened} %", f"{error} mrad off in the loop")]
    residuals = [Fact("residuals", f"{times_text(times)} ×", "what the sensors explain")]
    return [
        Fact("FIT, median of all logs", f"{fit_text(fit.median)} %", f"100 % is perfect{fit.over}"),
        Fact("FIT, worst log", f"{fit_text(fit.worst)} %"),
        *servo,
        *(residuals if math.isfinite(times) else []),
        Fact("logs", str(len(data.logs)), added if masses else ""),
        Fact("method", identification.estimate.method),
    ]


def _lead(parameters: Sequence[Parameter], data: DataSet, *, with_truth: bool) -> Section:
    """Return the forest plot: each parameter a row, its interval drawn and in numbers."""
    texts, whiskers = map(parameter_texts, parameters), [Whisker.of(each) for each in parameters]
    checked = any(whisker.left_out for whisker in whiskers)
    headers = {"interval": "95 % interval", "width": "half of it"}
    headers |= {"true": "true", "deviation": "deviation"} if with_truth else {}
    headers["error"] = "std error"
    if checked and not with_truth:  # in numbers too, where there is room
        headers["left_out"] = "one mass left out"
    rows: list[tuple[str | Marked | Whisker, ...]] = []
    for row, whisker in zip(texts, whiskers, strict=True):
        symbol = Marked(row["name"], meaning=row["meaning"])
        rows.append((symbol, row["value"], row["unit"], whisker, *(row[key] for key in headers)))
    caption = ""
    if any(whisker.drawn for whisker in whiskers):
        orange = "; orange: the truth" if with_truth else ""
        caption = (
            "Each row has a scale of its own. Blue: 95 % interval, the estimate its dark mark"
            f"{orange}; dashed: zero."
        )
    if checked:
        caption += (
            " Grey, below: the estimates without the logs of one added mass, which the interval is "
            "widened to hold: where it is wide, the model misses something that depends on the "
            "mass."
        )
    table = PageTable(
        name="parameters",
        words=(2,),
        headers=("", "value", "unit", "", *headers.values()),
        rows=rows,
        caption=caption,
    )
    further = ", with the further terms below" if len(rows) > len(_COMPARED) + 1 else ""
    weight = " + p₃ sin θ" if data.hangs else ""
    bare = "the bare hand" if data.joint is JointKind.HINGE else "the bare slide, θ its way"
    text = f"p₁ θ̈ + p₂ θ̇{weight} + T_c sgn θ̇ = p₄ u(t − delay), for {bare}{further}."
    return Section(title="Parameters", text=text, tables=(table,))


def _correlations(identification: Identification) -> list[Section]:
    drawn = identification.plot.correlations()
    if drawn is None:
        return []
    text = (
        "How the errors of the parameters go together. Near +1 or −1 these logs tell hardly more "
        "than a combination of the two: add a run that tells them apart."
    )
    return [Section(title="Which parameters hang together", text=text, figures={"map": drawn})]


def _logs_table(identification: Identification) -> PageTable:
    """Tabulate the logs, those that the model follows worst first, and their health."""
    data, rows = identification.data, []
    order = np.argsort(identification.fit_of_logs).tolist()
    for number in order:
        point, health = data.points[number], data.health[number]
        run, state = identification.free_runs[number], health.condition
        steady = ("–", "–", "–")
        if point is not None:
            shares = f"{100 * point.drift:+z.1f}", f"{100 * point.angle.distortion:.1f}"
            steady = (f"{point.amplitude:.3f}", *shares)
        rows.append(
            (
                *(run.log.label, f"{fit_text(run.fit)}", Marked(STATES[state], level=state)),
                "; ".join(health.findings) or "–",
                *steady,
                *(f"{health.samples}", f"{1e3 * health.step:.2f}", f"{1e3 * health.jitter:.2f}"),
                run.log.name.rsplit("/", maxsplit=1)[-1],
            )
        )
    headers = (
        *("log", "FIT in %", "health", "what was found"),
        *(f"swing in {data.joint.way}", "drift in %", "harmonics in %"),
        *("samples", "step in ms", "jitter in ms", "file"),
    )
    caption = (
        "Health: ok; note, which needs nothing done; care. Swing: amplitude of the fundamental in "
        "the steady window. Drift: its change from the window's first to its second half."
    )
    return PageTable(
        name="logs", headers=headers, rows=rows, words=(3, 10), caption=caption, picks=order
    )


def _physical(identification: Identification) -> list[Section]:
    found = identification.separated()
    title, headers, rows = physical_table(found)
    text = "\n".join(physical_sentences(found))
    caption = (
        "What follows from the parameters, and what they are made of as far as what is known of "
        "motor and hand tells it."
    )
    table = PageTable(
        name="physical",
        headers=tuple(headers),
        rows=[tuple(map(str, row)) for row in rows],
        words=(0,),
        caption=caption,
    )
    if not (text or rows):
        return []
    return [Section(title=title, text=text, tables=(table,) if rows else ())]


def _resonances_table(identification: Identification) -> PageTable:
    """Tabulate where each added mass swings by itself; without gravity none does."""
    estimate, data = identification.estimate, identification.data
    headers = ["added mass", "resonance in rad/s, of small swings"]
    headers += ["resonance in rad/s, by the thesis"] if estimate.resonances else []
    rows = []
    for mass, angle in data.equilibria.items() if data.hangs else ():
        loaded = estimate.parameters.with_added_mass(mass)
        row = [str(mass), f"{resonance_frequency(loaded):#.4g}"]
        if estimate.resonances:
            row.append(f"{estimate.resonances.get(mass, np.nan):#.4g}")
        rows.append((*row, f"{angle:z.4f}"))
    return PageTable(headers=(*headers, "rest angle in rad"), rows=rows)


def _against_table(identification: Identification) -> PageTable:
    """Tabulate what the identification was compared with, below itself."""
    found = [each for each in identification.estimate.table() if not each.known]
    own = {each.name: parameter_texts(each)["value"] for each in found}
    values = [own.get(key, "–") for key in _COMPARED]
    rows = [("this identification", *values, *_fits(identification.fit))]
    for other in identification.comparisons:
        values = [f"{getattr(other.parameters, key):.5g}" for key in _COMPARED]
        values[3] += " (fitted)" if other.gain_fitted else ""
        rows.append((other.name, *values, *_fits(other.summary)))
    headers = ("parameters", "p₁", "p₂", "p₃", "p₄", "T_c", "median FIT in %", "mean", "worst")
    return PageTable(name="against", headers=headers, rows=rows if len(rows) > 1 else ())


def _fits(fit: FitSummary) -> list[str]:
    return [fit_text(each) for each in (fit.median, fit.mean, fit.worst)]


def _held_out_table(identification: Identification) -> PageTable:
    rows = [(name, fit_text(value)) for name, value in identification.held_out.items()]
    caption = "Logs that were not used for the fit, simulated with its values."
    return PageTable(name="held-out", headers=("log", "FIT in %"), rows=rows, caption=caption)
