"""The report of an orbit's re-calibration."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from plotly.graph_objects import Figure
from pydantic import TypeAdapter

from butterfly.arrays import Samples
from butterfly.experiment.record import AlsoRecord, OrbitRecord, RoundsRecord
from butterfly.identification.parameter import lumped_numbers, or_nan
from butterfly.model.energy import Orbit, energy
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import PARAMETERS
from butterfly.orbit.loop import PERIODS, Calibration, OrbitStudy
from butterfly.report.figures import PALETTE, panel
from butterfly.report.finding_texts import estimate_notes, estimate_verdict
from butterfly.report.forest import forest, forest_caption
from butterfly.report.format import counted, interval
from butterfly.report.numbers import estimate_numbers
from butterfly.report.orbit_watch import watch_section, watch_sentences
from butterfly.report.page import Badge, Fact, Page, PageTable, Section
from butterfly.report.parameter_table import parameter_table
from butterfly.result import document
from butterfly.verdict import Level

_RATIOS = PARAMETERS[1:5]
_EVERY = 0.01  # s between drawn points
_SMOOTH = 0.02  # s over which the drawn velocity is averaged
_MORE = "give it more rounds (control: rounds), or other terms (recalibration: candidates)"


def orbit_page(study: OrbitStudy, truth: LumpedParameters | None = None) -> Page:
    """Put together the report of an orbit's re-calibration, beside the truth of the loaded hand."""
    errors = [(name, degrees_said(error)) for name, error in study.errors.items()]
    sections = [
        _rounds_section(study.calibration),
        Section(
            title="Phase plane and invariant",
            text="From the first and the last round, the run that starts farthest from the orbit, "
            "and the target orbit. Dotted: the decay exp(−p₄γ∫θ̇² dt) of the invariant I = E − "
            "E*, which holds if the controller's model is right and no dither is added; for a "
            "hand that turns over, from when it only turns that way.",
            figures=_motion_figures(study),
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
    record = OrbitRecord.of(study).also
    if study.also is not None and record is not None:
        sections.append(_also_section(study, study.also, record))
    if study.amplitudes:
        labels = [f"{math.degrees(amplitude):.3g}°" for amplitude in study.amplitudes]
        how = {"texttemplate": "%{z:.3g}", "colorscale": "Cividis"}
        figure = panel("used at", "calibrated at", 380).add_heatmap(
            z=np.degrees(study.cross), x=labels, y=labels, colorbar={"title": {"text": "°"}}, **how
        )
        sections.append(
            Section(
                title="Calibrated at one orbit, used at another",
                text="Rms error of free runs in °: row, the orbit of the re-calibration; column, "
                "the orbit of the run.",
                figures={"cross-orbit": figure},
            )
        )
    if study.watched is not None:
        sections.insert(0, watch_section(study.watched, study.zero))
    last, ((_, before), (_, after)) = study.calibration.rounds[-1], errors
    name = _named(last.orbit)[0]
    verdict, headline = estimate_verdict(study.estimate), orbit_headline(OrbitRecord.of(study))
    held = Level.GOOD if study.calibration.reached else Level.CARE
    return Page(
        name=study.name,
        description=study.description,
        kind="orbit re-calibration",
        facts=[
            Fact(
                f"{name} reached",
                size_text(last.reached, last.orbit.direction),
                f"of {size_text(last.orbit.size, last.orbit.direction)}",
            ),
            Fact("rounds", str(len(study.calibration.rounds)), "numbered from 0"),
            Fact("error of a free run near it", f"{after}°", f"rms; before, {before}°"),
        ],
        summary=_sentences(study),
        sections=sections,
        numbers=orbit_document(study, truth),
        verdict=verdict,
        badge=Badge(
            Level.worst([held, verdict.level]),
            "Orbit held" if study.calibration.reached else "Orbit not held",
            [*headline, *verdict.lines],
        ),
    )


def orbit_document(study: OrbitStudy, truth: LumpedParameters | None) -> dict[str, Any]:
    """Return a study of an orbit for programs (see `orbit_page`)."""
    verdict, last = estimate_verdict(study.estimate), study.calibration.rounds[-1]
    fitted, log, record = last.recalibration, last.logs[0], OrbitRecord.of(study)
    about = {"name": study.name, "description": study.description}
    content = {
        **TypeAdapter(OrbitRecord).dump_python(record, mode="json", exclude={"verdict"}),
        "rounds_ending": study.calibration.ending,
        "data": about | {"input": str(log.input_kind)},
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
        summary=(*orbit_headline(record), *verdict.lines, *_sentences(study)),
        units=dict.fromkeys(("free_run_rms_rad", "amplitudes_rad", "target_rad"), "rad")
        | dict.fromkeys(("speeds_rad_s", "target_rad_s"), "rad/s"),
    )


def _sentences(study: OrbitStudy) -> list[str]:
    """Say in plain words what was found, but for the headline and the verdict."""
    generic, recalibrated = study.errors["generic"], study.errors["re-calibrated"]
    recalibration, begun = study.calibration.rounds[-1].recalibration, study.small_swings
    return [
        *([] if study.watched is None else watch_sentences(study.watched)),
        f"Near the orbit, the error of the free run is {degrees_said(recalibrated)}° rms with the "
        f"re-calibrated model and {degrees_said(generic)}° with the initial model: "
        f"{generic / max(recalibrated, 1e-12):.3g} times less.",
        f"Estimated by {recalibration.estimate.method}: {', '.join(recalibration.estimate.names)}; "
        f"terms that did not help on held-out data: {', '.join(recalibration.rejected) or 'none'}.",
        *estimate_notes(study.estimate),
        *([] if begun is None else [f"Initial model: {estimate_verdict(begun).lines[0]}"]),
    ]


def orbit_headline(record: OrbitRecord) -> tuple[str, ...]:
    """Say whether the orbit is held that was asked for, what to do if not, and so of another."""
    return _held_text(record), *(() if record.also is None else _also_texts(record.also))


def _held_text(record: RoundsRecord) -> str:
    """Say what was asked for and what was reached, and what to do if these differ."""
    turns = record.target_rad_s is not None
    target = record.target_rad_s if turns else record.target_rad
    sizes = record.speeds_rad_s if turns else record.amplitudes_rad
    *earlier, last = (size_text(or_nan(size), turns) for size in sizes)
    before = f"; before, {', '.join(earlier)}" if earlier else ""
    asked = size_text(or_nan(target), turns) + " mean speed" * turns
    text = (
        f"{'Held' if record.reached else 'Not held'}: an orbit of {asked}. Reached {last} in "
        f"{counted(len(sizes), 'round')}{before}."
    )
    return text if record.reached else f"{text} Ended as {record.ending}: {_MORE}."


def _also_texts(also: AlsoRecord) -> tuple[str, str]:
    """Say what the other orbit came to, and whether both say the same."""
    agreeing = [name for name in also.differences if name not in also.differing]
    sentence = (
        f"Both orbits agree within their 95 % intervals on {', '.join(agreeing) or 'nothing'}"
    )
    if also.differing:
        sentence += f", not on {', '.join(also.differing)}"
    return _held_text(also), f"{sentence}."


def _named(orbit: Orbit) -> tuple[str, str]:
    """Return the name of an orbit's size, and the unit that it is said in."""
    return ("mean speed", "rad/s") if orbit.direction else ("amplitude", "°")


def _size(size: float, turns: float) -> str:
    """Return a size without its unit: an amplitude in degrees, or a mean speed in rad/s."""
    if math.isnan(size):
        return "did not turn over" if turns else "turned over"
    return f"{size:.4g}" if turns else degrees_said(size)


def size_text(size: float, turns: float) -> str:
    """Return an amplitude or, of an orbit that ``turns``, a mean speed as it is said."""
    unit = "" if math.isnan(size) else " rad/s" if turns else "°"
    return f"{_size(size, turns)}{unit}"


def _also_section(study: OrbitStudy, also: Calibration, record: AlsoRecord) -> Section:
    """Put the estimates of both orbits beside each other."""
    rounds = (study.calibration.rounds[-1], also.rounds[-1])
    headers = [size_text(cycle.orbit.size, cycle.orbit.direction) for cycle in rounds]
    recalibration = rounds[0].recalibration
    values = [cycle.recalibration.estimate.named for cycle in rounds]
    rows = [
        (
            f"{name}/p1" if recalibration.is_ratio(name) else name,
            *(f"{estimate[name]:.6g}" for estimate in values),
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
        text="\n".join([text, *_also_texts(record)]),
        tables=(PageTable(headers=("", *headers, "difference", "agree"), rows=rows),),
    )


def degrees_said(angle: float) -> str:
    """Return an angle in degrees as it is said."""
    return f"{math.degrees(angle):.4g}"


def _rounds_section(calibration: Calibration) -> Section:
    """Say what each round believed, and came to."""
    rounds = calibration.rounds
    turns = rounds[-1].orbit.direction
    name, unit = _named(rounds[-1].orbit)
    table = PageTable(
        headers=(
            *("round", f"{name} in {unit}", f"error in {unit}", "controller gain γ"),
            *(f"{ratio}/p1" for ratio in _RATIOS),
        ),
        rows=[
            (
                str(number),
                *(_size(size, turns) for size in (cycle.reached, cycle.error)),
                f"{cycle.gamma:.4g}",
                *(f"{getattr(cycle.believed, ratio) / cycle.believed.p1:.5g}" for ratio in _RATIOS),
            )
            for number, cycle in enumerate(rounds)
        ],
        caption="The ratios are those of the controller in that round, including the added mass.",
    )
    figure = panel("round", f"{name} in {unit}", 320).update_xaxes(dtick=1)
    scale = 1.0 if turns else math.degrees(1.0)
    counts, reached = list(range(len(rounds))), [scale * cycle.reached for cycle in rounds]
    marker, line = {"color": PALETTE[0], "size": 9}, {"color": PALETTE[5], "dash": "dash"}
    figure.add_scatter(x=counts, y=reached, mode="lines+markers", marker=marker, name="reached")
    wanted = [scale * rounds[-1].orbit.size] * len(rounds)
    figure.add_scatter(x=counts, y=wanted, mode="lines", line=line, name="target")
    return Section(
        title=f"{name.capitalize()} per round",
        text="Each round stabilises the orbit with the model from the previous round; the first "
        "uses the given model, or one identified from small swings.",
        tables=(table,),
        figures={"amplitude": figure},
    )


def _parameters_table(study: OrbitStudy, truth: LumpedParameters | None) -> PageTable:
    rounds = study.calibration.rounds
    recalibration, generic = rounds[-1].recalibration, rounds[0].believed
    scales = {name: recalibration.is_ratio(name) for name in recalibration.estimate.names}
    true = truth and {
        name: getattr(truth, name) / (truth.p1 if ratio else 1.0) for name, ratio in scales.items()
    }
    rows, before = [], []
    for row in recalibration.estimate.table(true):
        name, ratio = row.name, scales[row.name]
        before.append(f"{getattr(generic, name) / generic.p1:.5g}" if ratio else "–")
        name = f"{name}/p1" if ratio else name
        rows.append(replace(row, name=name, least_left_out=None, largest_left_out=None))
    bars, intervals = forest(rows), ("95 % interval", "standard error")
    return parameter_table(
        "",
        rows,
        *("name", "value", bars[0].axis, *intervals, "at first", "true"),
        more={bars[0].axis: bars, "at first": before},
        caption=f"{forest_caption(bars)} SI units; ratios if the added mass was not changed. "
        "Intervals include the leave-one-run-out estimates and the simulator's own error.",
    )


def _motion_figures(study: OrbitStudy) -> dict[str, Figure]:
    """Draw a run of the first and of the last round, its invariant as a share of E*."""
    rounds, model = study.calibration.rounds, study.calibration.parameters
    orbit = rounds[-1].orbit
    held = orbit.of_same_size(model)
    model = held.conserving
    depth = held.energy - energy(model, 0.0, 0.0)
    plane = panel("angle in °", "velocity in °/s", 520)
    invariant = panel("time in s", "invariant I/E*", 360)
    for number, colour in {0: PALETTE[1], len(rounds) - 1: PALETTE[0]}.items():
        cycle = rounds[number]
        highest = math.pi if cycle.orbit.direction else cycle.orbit.size
        from_orbit = [
            abs(abs(float(log.angle[0]) - study.zero) - highest)
            for log in cycle.logs[: cycle.starts]
        ]
        log = cycle.logs[int(np.argmax(from_orbit))]
        width = max(1, round(_SMOOTH / log.mean_step))
        angle = np.convolve(log.angle - study.zero, np.ones(width) / width, mode="valid")
        time = np.convolve(log.time, np.ones(width) / width, mode="valid")
        velocity = np.gradient(angle, time)
        some = slice(None, None, max(1, round(_EVERY / float(np.mean(np.diff(time))))))
        x, y = np.degrees(_within_a_turn(orbit, angle[some], velocity[some])).astype(np.float32)
        line = {"color": colour, "width": 1}
        plane.add_scatter(x=x, y=y, mode="lines", line=line, name=f"round {number}")
        values = (energy(model, angle, velocity) - held.energy) / depth
        area = np.concatenate([[0.0], np.cumsum(velocity[:-1] ** 2 * np.diff(time))])
        begin = np.flatnonzero(np.append(-1, held.direction * velocity[:-1]) < 0)[-1]
        decay = np.exp(-cycle.believed.p4 * cycle.gamma * (area - area[begin]))
        predicted = np.where(np.arange(area.size) < begin, np.nan, values[begin] * decay)
        for y, dash, what in ((values, "solid", "measured"), (predicted, "dot", "predicted")):
            line = {"color": colour, "width": 1.2, "dash": dash}
            curve = {"x": time[some].astype(np.float32), "y": y[some].astype(np.float32)}
            invariant.add_scatter(**curve, mode="lines", line=line, name=f"round {number}, {what}")
    x, y = np.degrees(_within_a_turn(orbit, *orbit.solution(np.linspace(0, orbit.period, 200))))
    dashed = {"color": PALETTE[5], "width": 2, "dash": "dash"}
    plane.add_scatter(x=x, y=y, line=dashed, name="orbit")
    return {"phase-plane": plane, "invariant": invariant}


def _within_a_turn(orbit: Orbit, angle: Samples, velocity: Samples) -> tuple[Samples, Samples]:
    """Return (n,) angles and velocities as drawn, those of an orbit that turns over in one turn."""
    if not orbit.direction:
        return angle, velocity
    turns, within = np.divmod(angle - orbit.lower, 2 * math.pi)
    jumps = np.flatnonzero(np.diff(turns)) + 1
    return np.insert(within + orbit.lower, jumps, np.nan), np.insert(velocity, jumps, np.nan)
