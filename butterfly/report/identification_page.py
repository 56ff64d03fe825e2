"""The identification report: the answer first, then what it rests on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from butterfly.identification.free_run import FitSummary
from butterfly.identification.identified import Identified
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import JointKind
from butterfly.model.terms import PARAMETERS
from butterfly.report.corner import (
    corner_caption,
    corner_figure,
    corner_of,
    corner_sentences,
)
from butterfly.report.figures import middle
from butterfly.report.finding_texts import estimate_verdict, grave_notes
from butterfly.report.format import counted, fit_text
from butterfly.report.identification_figures import IdentificationPlots
from butterfly.report.inspection import STATES, conditions_text, in_all
from butterfly.report.live import live_section
from butterfly.report.log_figures import (
    correlation_figure,
    correlation_series,
    residual_sentences,
    residual_table,
    spectrum_figure,
    spectrum_series,
    time_series,
)
from butterfly.report.page import (
    Badge,
    Fact,
    Marked,
    Page,
    PageTable,
    Section,
    forest,
    forest_caption,
    tabulated,
)
from butterfly.report.parameter_table import (
    parameter_table,
    physical_sentences,
    physical_table,
    value_text,
)
from butterfly.report.summary import loop_table
from butterfly.verdict import Level

_RESPONSE = (
    "Points: measured, with two standard errors. Lines: through the simulated logs, treated as the "
    "measured ones are. Below: the difference between the two."
)
_RESPONSE_UNASKED = (
    "Lines: the model at the median rms swing of the logs (describing functions). No log "
    "has an omega in the manifest, so there are no measured points."
)
_RUN = (
    "Free run: the model gets the input and the initial angle only. Thick: simulated; thin, above "
    "it: measured. Below: the error."
)
_BAND = (
    " Grey: the 95 % band of parameter errors and sensor noise, over the part of the log that the "
    "fit uses."
)
_GOAL = " Dotted: the set-point, which the servo follows by its own loop."
_LOOP = (
    "In the loop the model gets the set-point, and the loop corrects the model as it corrects the "
    "servo. By the drive alone nothing corrects it, which shows what the loop hides."
)
_RESIDUALS = (
    "Autocorrelation of the selected log's residual, and its cross-correlation with past input, "
    "after small changes of the parameters. Sensor noise alone stays inside the bands. Last: the "
    "residual's spectrum."
)
_COMPARED = PARAMETERS[:5]
_CAUSES = 2  # sentences on the cause of a verdict and its cure, on the first screen


def identification_page(
    identification: Identified, notes: Sequence[str], facts: Sequence[Fact], numbers: dict[str, Any]
) -> Page:
    """Put together the report of an identification, beside the truth where it is known."""
    data, residuals = identification.data, identification.residuals
    plots = IdentificationPlots(identification)
    runs, fits = identification.free_runs, identification.fit_of_logs
    chosen = middle(fits)
    states = [health.condition for health in data.health]
    lost = int(np.sum(~np.isfinite(fits)))  # they have no FIT
    bands = [log.band for log in residuals.logs]
    held_out = [(name, fit_text(fit)) for name, fit in identification.held_out.items()]
    sections = [
        Section(
            title="Frequency response",
            text=_RESPONSE if data.sines else _RESPONSE_UNASKED,
            figures={"frequency-response": plots.frequency_response()},
        ),
        Section(
            title="Measured against simulated",
            text=_RUN + _BAND * any(bands) + _GOAL * bool(identification.open_loop_fits),
            series={"time": time_series(runs, bands)},
        ),
        live_section(identification),
        Section(
            title="Residuals",
            text="\n".join([*residual_sentences(residuals), _RESIDUALS]),
            series={
                "left-over": correlation_series(residuals.logs),
                "spectrum": spectrum_series(runs, residuals.logs),
            },
            tables=(residual_table(residuals.logs, picks=range(len(runs))),),
        ),
        *corner_sections(identification),
        Section(
            title="FIT log by log",
            text=f"Health of the {conditions_text(states)} A click on a point selects its log."
            + (f" Not drawn: {counted(lost, 'log')} from which the model diverges." * (lost > 0)),
            figures={"fit": plots.fits()},
            tables=(_logs_table(identification),),
        ),
        *_physical(identification),
        *tabulated("In the servo's loop and by its drive alone", loop_table(identification), _LOOP),
        *tabulated("Resonances", _resonances_table(identification)),
        *tabulated("Against other parameters", _against_table(identification)),
        *tabulated(
            "Held out",
            PageTable(name="held-out", headers=("log", "FIT in %"), rows=held_out),
            "Logs that were not used for the fit, simulated with its values.",
        ),
    ]
    return replace(
        first_screen(identification, facts),
        summary=notes,
        sections=sections,
        numbers=numbers,
        place=str((identification.origin["manifest"] or {}).get("root") or ""),
        logs=[f"{run.log.label} – FIT {fit_text(run.fit)} %" for run in runs],
        chosen=chosen,
        pictures={
            "parameters": plots.parameters,
            "time": plots.time,
            "left-over": partial(correlation_figure, residuals.logs[chosen]),
            "spectrum": partial(spectrum_figure, runs[chosen], residuals.logs[chosen]),
        },
    )


def first_screen(identification: Identified, facts: Sequence[Fact]) -> Page:
    """Put together what is seen first: verdict, its cause and cure, tiles and parameters."""
    origin, estimate = identification.origin, identification.estimate
    verdict = estimate_verdict(estimate)
    doubted = verdict.level is not Level.GOOD
    causes = grave_notes(estimate)[: _CAUSES * doubted]
    reasons = [*causes, *verdict.reasons]
    return Page(
        name=origin["name"],
        description=origin.get("description", ""),
        kind="identification",
        verdict=verdict,
        badge=Badge(verdict.level, verdict.level.verdict.capitalize(), reasons),
        facts=facts,
        lead=_lead(identification),
    )


def _lead(identification: Identified) -> Section:
    """Return the forest plot: each parameter a row, its interval drawn and in numbers."""
    joint, truth = identification.estimate.joint, identification.truth
    parameters = identification.estimate.table(truth)
    bars, proof = forest(parameters), ("true", "deviation") if truth else ()
    first = ("name, with its meaning", "value", "unit", "badge", bars[0].axis, "±")
    table = parameter_table(
        "",
        parameters,
        *(*first, *proof, "95 % interval", "standard error"),
        more={bars[0].axis: bars},
        name="parameters",
        words=(2,),
        caption=forest_caption(bars),
    )
    further = ", with the further terms below" if len(parameters) > len(_COMPARED) + 1 else ""
    heavy = any(
        parameter.name == "p3" and (parameter.value or not parameter.known)
        for parameter in parameters
    )
    weight = " + p₃ sin θ" if heavy else ""
    bare = "the bare joint" if joint is JointKind.HINGE else "the bare slide, θ its position"
    text = f"p₁ θ̈ + p₂ θ̇{weight} + T_c sgn θ̇ = p₄ u(t − delay), for {bare}{further}."
    return Section(title="Parameters", text=text, tables=(table,))


def corner_sections(identification: Identified) -> list[Section]:
    """Say and draw which parameters move together; nothing without a covariance."""
    corner = corner_of(identification)
    if corner is None:
        return []
    text = "\n".join([*corner_sentences(corner), corner_caption(corner)])
    figures = {"corner": corner_figure(corner)}
    return [Section(title="Which parameters move together", text=text, figures=figures)]


def _logs_table(identification: Identified) -> PageTable:
    """Tabulate the logs, those that the model follows worst first, and their health."""
    data, rows = identification.data, []
    shared = in_all([health.findings for health in data.health])
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
                "; ".join(text for text in health.findings if text not in shared) or "–",
                *steady,
                *(f"{health.samples}", f"{1e3 * health.step:.2f}", f"{1e3 * health.jitter:.2f}"),
                run.log.name.rsplit("/", maxsplit=1)[-1],
            )
        )
    headers = (
        *("log", "FIT in %", "health", "findings"),
        *(f"swing in {data.joint.way}", "drift in %", "harmonics in %"),
        *("samples", "step in ms", "jitter in ms", "file"),
    )
    caption = (
        "Health: ok; note, which needs no action; care. Swing: amplitude of the fundamental in the "
        "steady window. Drift: its change from the window's first to its second half."
    )
    caption += f" All logs: {'; '.join(shared)}." if shared else ""
    return PageTable(
        name="logs", headers=headers, rows=rows, words=(3, 10), caption=caption, picks=order
    )


def _physical(identification: Identified) -> list[Section]:
    parameters = identification.separated()
    text, table = (
        "\n".join(physical_sentences(parameters)),
        physical_table(parameters, identification.zeros),
    )
    tables = (table.on_page(),) if table.rows else ()
    return [Section(title=table.title, text=text, tables=tables)] if text or tables else []


def _resonances_table(identification: Identified) -> PageTable:
    """Tabulate the resonance of each added mass; without gravity there is none."""
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


def _against_table(identification: Identified) -> PageTable:
    """Tabulate what the identification was compared with, below itself."""
    fitted = [row for row in identification.estimate.table() if not row.known]
    texts = {row.name: value_text(row) for row in fitted}
    values = [texts.get(key, "–") for key in _COMPARED]
    rows = [("this identification", *values, *_fits(identification.fit))]
    for other in identification.comparisons:
        values = [f"{getattr(other.parameters, key):.5g}" for key in _COMPARED]
        values[3] += " (fitted)" if other.gain_fitted else ""
        rows.append((other.name, *values, *_fits(other.fit)))
    headers = ("parameters", *_COMPARED, "median FIT in %", "mean", "worst")
    return PageTable(name="against", headers=headers, rows=rows if len(rows) > 1 else ())


def _fits(fit: FitSummary) -> list[str]:
    return [fit_text(value) for value in (fit.median, fit.mean, fit.worst)]
