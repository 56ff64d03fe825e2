"""The report of an orbit's re-calibration."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from plotly.graph_objects import Figure

from butterfly.arrays import Samples
from butterfly.experiment.record import AlsoRecord, OrbitRecord
from butterfly.identification.parameter import Parameter, lumped_numbers
from butterfly.model.energy import Orbit, energy
from butterfly.model.parameters import LumpedParameters
from butterfly.orbit.loop import PERIODS, Calibration, OrbitStudy, Round
from butterfly.report.figures import PALETTE, panel
from butterfly.report.finding_texts import estimate_notes, estimate_verdict
from butterfly.report.forest import forest, forest_caption
from butterfly.report.format import interval
from butterfly.report.numbers import estimate_numbers
from butterfly.report.orbit_watch import watch_section, watch_sentences
from butterfly.report.page import Fact, Page, PageTable, Section
from butterfly.report.parameter_table import parameter_texts
from butterfly.result import document

_RATIOS = {name: f"{name}/p1" for name in ("p2", "p3", "p4", "coulomb")}
_EVERY = 0.01  # s between drawn points
_SMOOTH = 0.02  # s over which the drawn velocity is averaged


def orbit_page(study: OrbitStudy, truth: LumpedParameters | None = None) -> Page:
    """Put together the report of an orbit's re-calibration, beside the truth of the loaded hand."""
    rounds = study.calibration.rounds
    errors = [(name, degrees_said(error)) for name, error in study.errors.items()]
    sections = [
        Section(
            title=f"{_named(rounds[-1].orbit)[0].capitalize()} per round",
            text="Each round stabilises the orbit with the model from the previous round; the "
            "first uses the given model, or one identified from small swings.",
            tables=(_rounds_table(rounds),),
            figures={"amplitude": _amplitude_figure(rounds)},
        ),
        Section(
            title="Phase plane and invariant",
            text="From the first and the last round, the run that starts farthest from the orbit, "
            "and the target orbit. Dotted: the decay exp(−p₄γ∫θ̇² dt) of the invariant I = E − E*, "
            "which holds if the controller's model is right and no dither is added; of a hand that "
            "turns over from when it turns that way alone.",
            figures={"phase-plane": _phase_figure(study), "invariant": _invariant_figure(study)},
        ),
        Section(
            title="Parameters",
            tables=(_parameters_table(study, truth),),
            text="\n".join(estimate_notes(study.estimate)),
        ),
        Section(
            title="Free-run prediction near the orbit",
            text=f"Over {PERIODS} periods of a held-out run, simulated from its initial state with "
            "the recorded input.",
            tables=(PageTable(headers=("model", "rms error in °"), rows=errors),),
        ),
    ]
    compared = _compared(study)
    if compared is not None:
        sections.append(_also_section(study, *compared))
    if study.amplitudes:
        sections.append(
            Section(
                title="Calibrated at one orbit, used at another",
                text="Rms error of free runs in °: row, the orbit of the re-calibration; column, "
                "the orbit of the run.",
                figures={"cross-orbit": _cross_figure(study)},
            )
        )
    if study.watched is not None:
        sections.insert(0, watch_section(study.watched, study.zero))
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
        "ratios_to_p1": [name for name in fitted.estimate.names if fitted.is_ratio(name)],
        "carried": str(log.added_mass),
    }
    if study.also is not None:
        content["also"] |= estimate_numbers(study.also.rounds[-1].recalibration.estimate)
    if truth is not None:
        content["truth"] = lumped_numbers(truth, log.input_kind)
    return document(
        "orbit",
        f"{study.name!r} re-calibrated near its orbit",
        content,
        verdict=verdict,
        summary=(*verdict.lines, *_sentences(study)),
        units={
            **dict.fromkeys(("free_run_rms_rad", "amplitudes_rad", "target_rad"), "rad"),
            **dict.fromkeys(("speeds_rad_s", "target_rad_s"), "rad/s"),
        },
    )


def _sentences(study: OrbitStudy) -> list[str]:
    """Say in plain words what was found, but for the verdict."""
    rounds, generic = study.calibration.rounds, study.errors["generic"]
    last = rounds[-1]
    better = generic / max(study.errors["re-calibrated"], 1e-12)
    recalibration = last.recalibration
    rejected = ", ".join(recalibration.rejected) or "none"
    begun, compared = study.small_swings, _compared(study)
    return [
        *([] if study.watched is None else watch_sentences(study.watched)),
        _reached_sentence(study.calibration),
        f"Near the orbit, the error of the free run is "
        f"{degrees_said(study.errors['re-calibrated'])}° rms with the re-calibrated model and "
        f"{degrees_said(generic)}° with the initial model: {better:.3g} times less.",
        f"Estimated by {recalibration.estimate.method}: {', '.join(recalibration.estimate.names)}; "
        f"terms that did not help on held-out data: {rejected}.",
        *estimate_notes(study.estimate),
        *([] if begun is None else [f"Initial model: {estimate_verdict(begun).lines[0]}"]),
        *([] if compared is None else _also_sentences(*compared)),
    ]


def _named(orbit: Orbit) -> tuple[str, str, str]:
    """Return what an orbit is named by, its unit, and what a hand did that has none of it."""
    if orbit.direction:
        return "mean speed", "°/s", "did not turn over"
    return "amplitude", "°", "turned over"


def _size_said(orbit: Orbit, size: float) -> str:
    return _named(orbit)[2] if math.isnan(size) else degrees_said(size)


def _reached_sentence(calibration: Calibration) -> str:
    rounds, orbit = calibration.rounds, calibration.rounds[-1].orbit
    name, unit, _ = _named(orbit)
    reached = ", ".join(_size_said(orbit, each.reached) for each in rounds)
    return (
        f"Target {name} {math.degrees(orbit.size):.2f}{unit}; reached {reached}{unit} in "
        f"{len(rounds)} rounds; {calibration.ending}."
    )


def _compared(study: OrbitStudy) -> tuple[Calibration, AlsoRecord] | None:
    """Return the other orbit of a study, if any, and what both say of the robot."""
    record = OrbitRecord.of(study).also
    return None if study.also is None or record is None else (study.also, record)


def _also_sentences(also: Calibration, record: AlsoRecord) -> list[str]:
    """Say what the other orbit came to, and whether both say the same."""
    agreeing = [name for name in record.differences if name not in record.differing]
    said = f"Both orbits agree within their 95 % intervals on {', '.join(agreeing) or 'nothing'}"
    if record.differing:
        said += f", not on {', '.join(record.differing)}"
    return [f"Another orbit: {_reached_sentence(also)}", f"{said}."]


def _also_section(study: OrbitStudy, also: Calibration, record: AlsoRecord) -> Section:
    """Put the estimates of both orbits beside each other."""
    rounds = (study.calibration.rounds[-1], also.rounds[-1])
    headers = [f"{degrees_said(each.wanted)}{_named(each.orbit)[1]}" for each in rounds]
    found = rounds[0].recalibration
    values = [each.recalibration.estimate.named for each in rounds]
    rows = [
        (
            f"{name}/p1" if found.is_ratio(name) else name,
            *(f"{each[name]:.6g}" for each in values),
            interval(*limits),
            "no" if name in record.differing else "yes",
        )
        for name, limits in record.differences.items()
    ]
    text = (
        "Each estimate is from its orbit alone. They agree if the 95 % interval of their "
        "difference contains 0, which by chance one parameter in twenty does not."
    )
    return Section(
        title="Two orbits, one robot",
        text="\n".join([text, *_also_sentences(also, record)]),
        tables=(PageTable(headers=("", *headers, "difference", "agree"), rows=rows),),
    )


def degrees_said(angle: float) -> str:
    """Return an angle in degrees as it is said."""
    return f"{math.degrees(angle):.4g}"


def _facts(study: OrbitStudy) -> list[Fact]:
    last = study.calibration.rounds[-1]
    before, after = (degrees_said(study.errors[name]) for name in ("generic", "re-calibrated"))
    name, unit, _ = _named(last.orbit)
    reached = f"{_size_said(last.orbit, last.reached)}{unit}"
    return [
        Fact(f"{name} reached", reached, f"of {math.degrees(last.wanted):.4g}{unit}"),
        Fact("rounds", str(len(study.calibration.rounds)), "numbered from 0"),
        Fact("error of a free run near it", f"{after}°", f"rms; before, {before}°"),
    ]


def _rounds_table(rounds: tuple[Round, ...]) -> PageTable:
    name, unit, _ = _named(rounds[-1].orbit)
    named = (f"{name} in {unit}", f"error in {unit}")
    return PageTable(
        headers=("round", *named, "controller gain γ", *_RATIOS.values()),
        rows=[
            (
                str(number),
                *(_size_said(each.orbit, size) for size in (each.reached, each.error)),
                f"{each.gamma:.4g}",
                *(f"{getattr(each.believed, name) / each.believed.p1:.5g}" for name in _RATIOS),
            )
            for number, each in enumerate(rounds)
        ],
        caption="The ratios are those of the controller in that round, including the added mass.",
    )


def _parameters_table(study: OrbitStudy, truth: LumpedParameters | None) -> PageTable:
    rounds = study.calibration.rounds
    found, generic = rounds[-1].recalibration, rounds[0].believed
    estimate, rows, before = found.estimate, [], []
    columns = (estimate.values, estimate.standard_errors, estimate.lower, estimate.upper)
    for name, line in zip(estimate.names, np.column_stack(columns).tolist(), strict=True):
        ratio = found.is_ratio(name)
        shown = _RATIOS.get(name, f"{name}/p1") if ratio else name
        true = None if truth is None else getattr(truth, name) / (truth.p1 if ratio else 1.0)
        before.append(f"{getattr(generic, name) / generic.p1:.5g}" if ratio else "–")
        numbers = dict(zip(("value", "standard_error", "lower", "upper"), line, strict=True))
        rows.append(Parameter(name=shown, meaning="", unit="", true=true, **numbers))
    bars, texts = forest(rows), [*map(parameter_texts, rows)]
    return PageTable(
        headers=("", "value", bars[0].axis, "95 % interval", "standard error", "at first", "true"),
        rows=[
            (row["name"], row["value"], bar, row["interval"], row["error"], first, row["true"])
            for row, bar, first in zip(texts, bars, before, strict=True)
        ],
        caption=f"{forest_caption(bars)} SI units; ratios if the added mass was not changed. "
        "Intervals include the leave-one-run-out estimates and the simulator's own error.",
    )


def _amplitude_figure(rounds: tuple[Round, ...]) -> Figure:
    counts = list(range(len(rounds)))
    reached = [math.degrees(each.reached) for each in rounds]
    marker = {"color": PALETTE[0], "size": 9}
    wanted = [math.degrees(rounds[-1].wanted)] * len(rounds)
    line = {"color": PALETTE[5], "dash": "dash"}
    name, unit, _ = _named(rounds[-1].orbit)
    figure = panel("round", f"{name} in {unit}", 320).update_xaxes(dtick=1)
    figure.add_scatter(x=counts, y=reached, mode="lines+markers", marker=marker, name="reached")
    return figure.add_scatter(x=counts, y=wanted, mode="lines", line=line, name="target")


def _motions(study: OrbitStudy) -> Iterator[tuple[int, str, list[Samples], slice]]:
    """Of the first and the last round: its number, colour, motion, and what is drawn of that."""
    rounds = study.calibration.rounds
    for number, colour in {0: PALETTE[1], len(rounds) - 1: PALETTE[0]}.items():
        each = rounds[number]
        orbit = each.orbit
        highest = math.pi if orbit.direction else orbit.size
        from_orbit = [
            abs(abs(float(log.angle[0]) - study.zero) - highest) for log in each.logs[: each.starts]
        ]
        log = each.logs[int(np.argmax(from_orbit))]
        width = max(1, round(_SMOOTH / log.mean_step))
        angle = np.convolve(log.angle - study.zero, np.ones(width) / width, mode="valid")
        time = np.convolve(log.time, np.ones(width) / width, mode="valid")
        every = max(1, round(_EVERY / float(np.mean(np.diff(time)))))
        yield number, colour, [time, angle, np.gradient(angle, time)], slice(None, None, every)


def _phase_figure(study: OrbitStudy) -> Figure:
    figure = panel("angle in °", "velocity in °/s", 520)
    orbit = study.calibration.rounds[-1].orbit
    for number, colour, (_, angle, velocity), some in _motions(study):
        shown = np.array(_within_a_turn(orbit, angle[some], velocity[some]))
        x, y = np.degrees(shown).astype(np.float32)
        line = {"color": colour, "width": 1}
        figure.add_scatter(x=x, y=y, mode="lines", line=line, name=f"round {number}")
    x, y = np.degrees(_within_a_turn(orbit, *orbit.solution(np.linspace(0, orbit.period, 200))))
    dashed = {"color": PALETTE[5], "width": 2, "dash": "dash"}
    return figure.add_scatter(x=x, y=y, line=dashed, name="orbit")


def _within_a_turn(orbit: Orbit, angle: Samples, velocity: Samples) -> tuple[Samples, Samples]:
    """Return (n,) angles and velocities as drawn, those of an orbit that turns over in one turn."""
    if not orbit.direction:
        return angle, velocity
    turns, within = np.divmod(angle - orbit.lower, 2 * math.pi)
    jumps = np.flatnonzero(np.diff(turns)) + 1
    return np.insert(within + orbit.lower, jumps, np.nan), np.insert(velocity, jumps, np.nan)


def _invariant_figure(study: OrbitStudy) -> Figure:
    """Invariant of the nominal runs, as a share of E*, and its predicted decay."""
    rounds, model = study.calibration.rounds, study.calibration.parameters
    orbit = rounds[-1].orbit.of_same_size(model)
    model = orbit.conserving
    depth = orbit.energy - energy(model, 0.0, 0.0)
    figure = panel("time in s", "invariant I/E*", 360)
    for number, colour, (time, angle, velocity), some in _motions(study):
        values = (energy(model, angle, velocity) - orbit.energy) / depth
        area = np.concatenate([[0.0], np.cumsum(velocity[:-1] ** 2 * np.diff(time))])
        each = rounds[number]
        begin = np.flatnonzero(np.append(-1, orbit.direction * velocity[:-1]) < 0)[-1]
        decay = np.exp(-each.believed.p4 * each.gamma * (area - area[begin]))
        predicted = np.where(np.arange(area.size) < begin, np.nan, values[begin] * decay)
        for y, dash, what in ((values, "solid", "measured"), (predicted, "dot", "predicted")):
            line = {"color": colour, "width": 1.2, "dash": dash}
            curve = {"x": time[some].astype(np.float32), "y": y[some].astype(np.float32)}
            figure.add_scatter(**curve, mode="lines", line=line, name=f"round {number}, {what}")
    return figure


def _cross_figure(study: OrbitStudy) -> Figure:
    labels = [f"{math.degrees(each):.3g}°" for each in study.amplitudes]
    return panel("used at", "calibrated at", 380).add_heatmap(
        z=np.degrees(study.cross),
        x=labels,
        y=labels,
        texttemplate="%{z:.3g}",
        colorscale="Cividis",
        colorbar={"title": {"text": "°"}},
    )
