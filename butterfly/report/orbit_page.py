"""The report of an orbit's re-calibration."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure, Heatmap, Scatter

from butterfly.experiment.record import OrbitRecord
from butterfly.identification.parameter import lumped_numbers
from butterfly.logs.log import Log
from butterfly.model.energy import Orbit, energy
from butterfly.model.parameters import LumpedParameters
from butterfly.orbit.loop import PERIODS, OrbitStudy, Round
from butterfly.report.figures import PALETTE
from butterfly.report.finding_texts import estimate_sentences, estimate_verdict
from butterfly.report.numbers import estimate_numbers
from butterfly.report.page import Fact, Page, PageTable, Section
from butterfly.report.parameter_table import Whisker, interval, with_error
from butterfly.result import document

_RATIOS = {"p2": "p₂/p₁", "p3": "p₃/p₁", "p4": "p₄/p₁", "coulomb": "T_c/p₁"}
_EVERY = 0.01  # s between drawn points
_SMOOTH = 0.02  # s over which the drawn velocity is averaged


def orbit_page(study: OrbitStudy, truth: LumpedParameters | None = None) -> Page:
    """Put together the report of an orbit's re-calibration.

    `truth` are parameters of the hand with what it carries, where they are known.
    """
    rounds = study.calibration.rounds
    sections = [
        Section(
            title="Amplitude per round",
            text="Each round holds the orbit with what the round before has found; the first goes "
            "by the model that was given or identified from small swings.",
            tables=(_rounds_table(rounds),),
            figures={"amplitude": _amplitude_figure(rounds)},
        ),
        Section(
            title="Phase plane and invariant",
            text="The run of the first and of the last round that starts farthest from the orbit, "
            "and the orbit that was to be held. The invariant I = E − E* by the re-calibrated "
            "model decays as exp(−p₄γ∫θ̇² dt) predicts where the controller's model is right and "
            "no dither is added; dotted.",
            figures={
                "phase-plane": _phase_figure(study),
                "invariant": _invariant_figure(study),
            },
        ),
        Section(
            title="Parameters",
            tables=(_parameters_table(study, truth),),
            text="\n".join(estimate_sentences(study.estimate)[1:]),
        ),
        Section(
            title="Free-run prediction next to the orbit",
            text=f"Over {PERIODS} periods of a run that was used for nothing else, simulated from "
            "its first sample with the recorded input.",
            tables=(
                PageTable(
                    headers=("model", "rms error in °"),
                    rows=[(name, degrees_said(error)) for name, error in study.errors.items()],
                ),
            ),
        ),
    ]
    if study.amplitudes:
        sections.append(
            Section(
                title="Calibrated at one orbit, used at another",
                text="Rms error of free runs in °: the model re-calibrated at the orbit of the "
                "row, on a run at the orbit of the column.",
                figures={"cross-orbit": _cross_figure(study)},
            )
        )
    return Page(
        name=study.name,
        description=study.description,
        kind="orbit re-calibration",
        facts=_facts(study),
        summary=_sentences(study),
        sections=sections,
        numbers=orbit_document(study, truth),
        verdict=estimate_verdict(study.estimate),
    )


def orbit_document(study: OrbitStudy, truth: LumpedParameters | None) -> dict[str, Any]:
    """Return a study of an orbit for programs (see `orbit_page`)."""
    verdict, last = estimate_verdict(study.estimate), study.calibration.rounds[-1]
    fitted, log = last.recalibration, last.logs[0]
    content = {
        **OrbitRecord.of(study).numbers(),
        "rounds_ending": study.calibration.ending,
        "data": {
            "name": study.name,
            "description": study.description,
            "input": str(log.input_kind),
        },
        **estimate_numbers(study.estimate),
        "ratios_to_p1": [name for name in fitted.names if fitted.is_ratio(name)],
        "carried": str(log.added_mass),
    }
    if truth is not None:
        content["truth"] = lumped_numbers(truth, log.input_kind)
    return document(
        "orbit",
        f"{study.name!r} re-calibrated next to its orbit",
        content,
        verdict=verdict,
        summary=(verdict.sentence, *_sentences(study)),
        units={"free_run_rms_rad": "rad", "amplitudes_rad": "rad", "target_rad": "rad"},
    )


def _sentences(study: OrbitStudy) -> list[str]:
    """Say in plain words what was found, but for the verdict."""
    rounds, generic = study.calibration.rounds, study.errors["generic"]
    last, wanted = rounds[-1], rounds[-1].wanted
    better = generic / max(study.errors["re-calibrated"], 1e-12)
    recalibration = last.recalibration
    rejected = ", ".join(recalibration.rejected) or "none"
    begun = study.small_swings
    return [
        f"The hand was to swing {math.degrees(wanted):.2f}° and swung "
        + ", ".join(degrees_said(each.amplitude) for each in rounds)
        + f"° in {len(rounds)} rounds; {study.calibration.ending}.",
        f"Next to the orbit the re-calibrated model's free run is off by "
        f"{degrees_said(study.errors['re-calibrated'])}° rms, the model it began with by "
        f"{degrees_said(generic)}°: {better:.3g} times less.",
        f"Estimated by {recalibration.estimate.method}: {', '.join(recalibration.names)}; "
        f"terms that did not help on held-out data: {rejected}.",
        *estimate_sentences(study.estimate)[1:],
        *([] if begun is None else [f"What it began with: {estimate_verdict(begun).sentence}"]),
    ]


def degrees_said(angle: float) -> str:
    """Return an angle in degrees as it is said."""
    return "turned over" if math.isnan(angle) else f"{math.degrees(angle):.4g}"


def _facts(study: OrbitStudy) -> list[Fact]:
    last = study.calibration.rounds[-1]
    before, after = (degrees_said(study.errors[name]) for name in ("generic", "re-calibrated"))
    wanted = f"of {math.degrees(last.wanted):.4g}°"
    return [
        Fact("amplitude reached", f"{degrees_said(last.amplitude)}°", wanted),
        Fact("rounds", str(len(study.calibration.rounds))),
        Fact("error of a free run next to it", f"{after}°", f"rms; before, {before}°"),
    ]


def _rounds_table(rounds: tuple[Round, ...]) -> PageTable:
    return PageTable(
        headers=("round", "amplitude in °", "error in °", "γ", "p₂/p₁", "p₃/p₁", "p₄/p₁", "T_c/p₁"),
        rows=[
            (
                str(number),
                degrees_said(each.amplitude),
                degrees_said(each.amplitude_error),
                f"{each.gamma:.4g}",
                *(
                    f"{getattr(each.believed, name) / each.believed.p1:.5g}"
                    for name in ("p2", "p3", "p4", "coulomb")
                ),
            )
            for number, each in enumerate(rounds)
        ],
        caption="The ratios are what the controller of that round believed, of the hand with what "
        "it carries.",
    )


def _parameters_table(study: OrbitStudy, truth: LumpedParameters | None) -> PageTable:
    last = study.calibration.rounds[-1]
    found, generic = last.recalibration, study.generic
    estimate, rows = found.estimate, []
    for k, name in enumerate(found.names):
        value, error = float(estimate.values[k]), float(estimate.standard_errors[k])
        ratio = found.is_ratio(name)
        scale = generic.p1 if ratio else 1.0
        symbol = _RATIOS.get(name, f"{name}/p₁") if ratio else name
        told = None if truth is None else float(getattr(truth, name)) / (truth.p1 if ratio else 1)
        true = "" if told is None else f"{told:.6g}"
        limits = interval(float(estimate.lower[k]), float(estimate.upper[k]))
        before = f"{getattr(generic, name) / scale:.5g}" if ratio else "–"
        ends = (float(estimate.lower[k]), float(estimate.upper[k]))
        whisker = Whisker(value=value, limits=ends, true=told)
        row = (symbol, with_error(value, error), whisker, limits, f"{error:#.2g}", before, true)
        rows.append(row)
    return PageTable(
        headers=("", "value", "", "95 % interval", "std error", "at first", "true"),
        rows=rows,
        caption="Blue: 95 % interval, the estimate its dark mark; orange: the truth, where it is "
        "known. SI units; ratios where no known mass was changed. Intervals are widened to hold "
        "the estimates that leave one run out.",
    )


def _amplitude_figure(rounds: tuple[Round, ...]) -> Figure:
    counts = list(range(len(rounds)))
    figure = Figure()
    style = {"color": PALETTE[0], "size": 9}
    reached = [math.degrees(each.amplitude) for each in rounds]
    figure.add_trace(
        Scatter(x=counts, y=reached, mode="lines+markers", marker=style, name="reached")
    )
    wanted = [math.degrees(rounds[-1].wanted)] * len(rounds)
    line = {"color": PALETTE[5], "dash": "dash"}
    figure.add_trace(Scatter(x=counts, y=wanted, mode="lines", line=line, name="wanted"))
    figure.update_xaxes(title="round", dtick=1)
    figure.update_yaxes(title="amplitude in °")
    figure.update_layout(height=320)
    return figure


def _motion(study: OrbitStudy, each: Round) -> tuple[NDArray[np.float64], ...]:
    """Time, angle and smoothed velocity of the run that starts farthest from the orbit."""

    def distance(log: Log) -> float:
        return abs(abs(float(log.angle[0]) - study.zero) - each.wanted)

    log = max(each.logs[: each.starts], key=distance)
    width = max(1, round(_SMOOTH / log.mean_step))
    angle = np.convolve(log.angle - study.zero, np.ones(width) / width, mode="valid")
    time = np.convolve(log.time, np.ones(width) / width, mode="valid")
    return time, angle, np.gradient(angle, time)


def _phase_figure(study: OrbitStudy) -> Figure:
    rounds = study.calibration.rounds
    figure = Figure()
    for number, colour in {0: PALETTE[1], len(rounds) - 1: PALETTE[0]}.items():
        time, angle, velocity = _motion(study, rounds[number])
        every = max(1, round(_EVERY / float(np.mean(np.diff(time)))))
        x, y = (np.degrees(part[::every]).astype(np.float32) for part in (angle, velocity))
        line = {"color": colour, "width": 1}
        figure.add_trace(Scatter(x=x, y=y, mode="lines", line=line, name=f"round {number}"))
    orbit = rounds[-1].orbit
    angle, velocity = orbit.solution(np.linspace(0, orbit.period, 200))
    dashed = {"color": PALETTE[5], "width": 2, "dash": "dash"}
    figure.add_trace(
        Scatter(x=np.degrees(angle), y=np.degrees(velocity), line=dashed, name="orbit")
    )
    figure.update_xaxes(title="angle in °")
    figure.update_yaxes(title="velocity in °/s")
    figure.update_layout(height=520)
    return figure


def _invariant_figure(study: OrbitStudy) -> Figure:
    """Invariant of the nominal runs, as a share of E*, and its predicted decay."""
    rounds, model = study.calibration.rounds, study.calibration.parameters
    figure = Figure()
    orbit = Orbit.of_amplitude(model, rounds[-1].orbit.upper)
    depth = orbit.energy - energy(model, 0.0, 0.0)
    for number, colour in {0: PALETTE[1], len(rounds) - 1: PALETTE[0]}.items():
        each = rounds[number]
        time, angle, velocity = _motion(study, each)
        values = (energy(model, angle, velocity) - orbit.energy) / depth
        area = np.concatenate([[0.0], np.cumsum(velocity[:-1] ** 2 * np.diff(time))])
        predicted = values[0] * np.exp(-each.believed.p4 * each.gamma * area)
        every = max(1, round(_EVERY / float(np.mean(np.diff(time)))))
        for y, dash, what in ((values, "solid", "measured"), (predicted, "dot", "predicted")):
            line = {"color": colour, "width": 1.2, "dash": dash}
            name = f"round {number}, {what}"
            x, y32 = time[::every].astype(np.float32), y[::every].astype(np.float32)
            figure.add_trace(Scatter(x=x, y=y32, mode="lines", line=line, name=name))
    figure.update_xaxes(title="time in s")
    figure.update_yaxes(title="I/E*")
    figure.update_layout(height=360)
    return figure


def _cross_figure(study: OrbitStudy) -> Figure:
    labels = [f"{math.degrees(each):.3g}°" for each in study.amplitudes]
    figure = Figure(
        Heatmap(
            z=np.degrees(study.cross),
            x=labels,
            y=labels,
            texttemplate="%{z:.3g}",
            colorscale="Cividis",
            colorbar={"title": {"text": "°"}},
        )
    )
    figure.update_xaxes(title="used at")
    figure.update_yaxes(title="calibrated at")
    figure.update_layout(height=380)
    return figure
