"""The report of an orbit: its re-calibration, and whether and how the robot changed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from plotly.graph_objects import Figure
from pydantic import TypeAdapter

from butterfly.arrays import Samples
from butterfly.experiment.record import AlsoRecord, OrbitRecord, RoundsRecord
from butterfly.identification.trust import lumped_numbers, or_nan
from butterfly.model.energy import Orbit, energy
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import PARAMETERS
from butterfly.orbit.loop import PERIODS, Calibration, OrbitStudy, swing
from butterfly.orbit.online import Alarm, Cause, Watched
from butterfly.report.figures import GREY, PALETTE, add, log_ticks, panel, panels
from butterfly.report.finding_texts import estimate_notes, estimate_verdict
from butterfly.report.format import counted, interval
from butterfly.report.numbers import estimate_numbers
from butterfly.report.page import Badge, Fact, Page, PageTable, Section, forest, forest_caption
from butterfly.report.parameter_table import parameter_table
from butterfly.result import document
from butterfly.verdict import Level

_SWINGS = 5  # periods over which an amplitude is measured


def watch_sentences(watched: Watched) -> list[str]:
    """Say for each alarm when the robot changed, which parameters it may have been, by how much."""
    change, sentences = watched.change, []
    for alarm in watched.detector.alarms:
        noticed = f"noticed at {alarm.time:.1f} s"
        if change is not None and alarm.time >= change.at:
            noticed += f", {(alarm.time - change.at) / watched.orbit.period:.2g} periods after it"
        what = " or ".join(f"{cause.name} by {_change_said(cause)}" for cause in alarm.possible)
        explanation = f": {what}, if only one parameter changed."
        if not alarm.causes:
            explanation = "; more motion is needed to see which parameter changed."
        elif not what:
            moved = [
                ratio for ratio in alarm.ratios if not ratio.lower <= ratio.before <= ratio.upper
            ]
            changes = ", ".join(f"{ratio.name}/p1 by {_change_said(ratio)}" for ratio in moved)
            explanation = f": several parameters, {changes}."
        since = "The robot changed between {:.1f} and {:.1f} s".format(*alarm.since)
        sentences.append(f"{since}, {noticed}{explanation}")
    minutes = float(np.ptp(watched.log.time)) / 60
    return sentences or [f"Watched for {minutes:.3g} min: the robot did not change."]


def watch_section(watched: Watched, zero: float) -> Section:
    """Return the timeline of the statistic and the amplitude, and what changed by how much."""
    change, lead = watched.change, "The simulated robot did not change."
    if change is not None:
        factors = ", ".join(f"{name} times {factor:g}" for name, factor in change.factors.items())
        lead = f"The simulated robot changed at {change.at:g} s: {factors}."
    figure = panels("time in s", ("statistic", "amplitude in °"), 520)
    orbit, log, detector = watched.orbit, watched.log, watched.detector
    blue, dashed = {"color": PALETTE[0]}, {"color": GREY, "dash": "dash"}
    time, statistic = np.array(detector.history).reshape(-1, 2).T
    step, ends = _SWINGS * orbit.period, [float(log.time[0]), float(log.time[-1])]
    begins = np.arange(ends[0], ends[1] - step, step)
    parts = [log.take((log.time >= begin) & (log.time < begin + step)) for begin in begins]
    reached = [math.degrees(swing(part, zero, part.time[0])) for part in parts]
    wanted, threshold = math.degrees(orbit.upper - orbit.lower) / 2, detector.threshold
    add(figure, 1, time, statistic, name="statistic", mode="markers", marker=blue)
    add(figure, 1, ends, [threshold] * 2, name="threshold", line=dashed)
    add(figure, 2, begins + step / 2, reached, name="amplitude", line=blue)
    add(figure, 2, ends, [wanted] * 2, name="target", line=dashed)
    for alarm in detector.alarms:
        figure.add_vline(x=alarm.time, line={"color": PALETTE[5], "width": 1})
    figure.update_yaxes(log_ticks(1, 2, 5), row=1)
    return Section(
        title="Watched for changes",
        text=f"{lead}\nStatistic: the largest change of a parameter since any instant, in standard "
        "errors, relative to a reference period; none at the start and after an alarm, while the "
        f"reference is recorded. Vertical lines: alarms. Amplitude: over {_SWINGS} periods, with "
        "the dither; the controller is retuned continuously.",
        tables=tuple(map(_causes_table, detector.alarms)),
        figures={"watched": figure},
    )


def _change_said(cause: Cause) -> str:
    values = np.array([cause.after, cause.lower, cause.upper])
    if not cause.before > 0:
        return f"{cause.after - cause.before:.3g}"
    change, low, high = 100 * (values / cause.before - 1)
    return f"{change:+.3g} % ({low:+.4g} to {high:+.4g} %)"


def _causes_table(alarm: Alarm) -> PageTable:
    """Before and after of each parameter, if it changed alone, and of all ratios together."""
    causes = [("yes" if cause.possible else "no", cause) for cause in alarm.causes]
    causes += [("together", cause) for cause in alarm.ratios]
    return PageTable(
        headers=("", "alone?", "before", "after", "change, 95 % interval"),
        rows=[
            (cause.name + "/p1" * (cause.name != "p1"), alone, *numbers, _change_said(cause))
            for alone, cause in causes
            if (numbers := (f"{cause.before:.5g}", f"{cause.after:.5g}"))
        ],
        caption=f"Alarm at {alarm.time:.1f} s. Whether one parameter alone explains the change, "
        "and its value then (p1 in units of p1 before); below, all ratios together.",
    )


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
