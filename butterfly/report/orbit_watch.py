"""The section of a report on an orbit that says whether and how the robot changed."""

from __future__ import annotations

import math

import numpy as np
from plotly.graph_objects import Figure

from butterfly.orbit.change_detection import Alarm, Cause
from butterfly.orbit.loop import swing
from butterfly.orbit.watch import Watched
from butterfly.report.figures import GREY, PALETTE, add, panels
from butterfly.report.page import PageTable, Section

_SWINGS = 5  # periods over which an amplitude is measured


def watch_sentences(watched: Watched) -> list[str]:
    """Say what was noticed, a sentence for each alarm."""
    minutes = float(np.ptp(watched.log.time)) / 60
    if not watched.alarms:
        return [f"Watched for {minutes:.3g} min: the robot did not change."]
    return [_alarm_said(watched, alarm) for alarm in watched.alarms]


def watch_section(watched: Watched, zero: float) -> Section:
    """Return the timeline of the statistic and the amplitude, and what changed by how much."""
    change = watched.change
    told = "The simulated robot did not change."
    if change is not None:
        factors = ", ".join(f"{name} times {each:g}" for name, each in change.factors.items())
        told = f"The simulated robot changed at {change.at:g} s: {factors}."
    tables = [_causes_table(alarm) for alarm in watched.alarms if alarm.causes]
    return Section(
        title="Watched for changes",
        text=f"{told}\nStatistic: the largest change of a parameter since any instant in standard "
        "errors, about a reference period in which there is none; vertical lines: alarms. "
        "Amplitude: mean of five periods, the controller retuned all the time.",
        tables=tuple(tables),
        figures={"watched": _figure(watched, zero)},
    )


def _alarm_said(watched: Watched, alarm: Alarm) -> str:
    since, until = alarm.since
    late = watched.delay(alarm)
    noticed = f"noticed at {alarm.time:.1f} s"
    if math.isfinite(late):
        noticed += f", {late:.2g} periods after it"
    when = f"between {since:.1f} and {until:.1f} s, {noticed}."
    if not alarm.causes:
        return f"The robot changed {when} What changed needs more motion to be told."
    if alarm.possible:
        what = " or ".join(f"{each.name} by {_change_said(each)}" for each in alarm.possible)
    else:
        moved = [each for each in alarm.ratios if not each.lower <= each.before <= each.upper]
        all_said = ", ".join(f"{each.name}/p1 by {_change_said(each)}" for each in moved)
        what = f"several parameters: {all_said}"
    return f"The robot changed {when} What changed: {what}."


def _change_said(cause: Cause) -> str:
    if not cause.before > 0:
        return f"{cause.after - cause.before:.3g}"
    ends = (100 * (value / cause.before - 1) for value in (cause.after, cause.lower, cause.upper))
    change, low, high = ends
    return f"{change:+.3g} % ({low:+.3g} to {high:+.3g} %)"


def _causes_table(alarm: Alarm) -> PageTable:
    rows = []
    for each in (*alarm.causes, *alarm.ratios):
        alone = each in alarm.causes
        said = ("yes" if each.possible else "no") if alone else "together"
        name = each.name if each.name == "p1" else f"{each.name}/p1"
        values = (f"{value:.5g}" for value in (each.before, each.after))
        rows.append(
            (name, said, *values, f"{each.lower:.5g} to {each.upper:.5g}", _change_said(each))
        )
    return PageTable(
        headers=("", "alone?", "before", "after", "95 % interval", "change"),
        rows=rows,
        caption=f"Alarm at {alarm.time:.1f} s. Whether each parameter alone explains the change, "
        "and by how much it then changed (p1 in units of p1 before); below, all ratios together.",
    )


def _figure(watched: Watched, zero: float) -> Figure:
    """Statistic with threshold and alarms; amplitude with the target."""
    figure = panels("time in s", ("statistic", "amplitude in °"), 520)
    time, statistic = np.array(watched.history).reshape(-1, 2).T
    ends = [float(watched.log.time[0]), float(watched.log.time[-1])]
    dashed = {"color": GREY, "dash": "dash"}
    add(figure, 1, time, statistic, name="statistic", line={"color": PALETTE[0]})
    add(figure, 1, ends, [watched.threshold] * 2, name="threshold", line=dashed)
    figure.update_yaxes(type="log", row=1)
    step = _SWINGS * watched.orbit.period
    begins = np.arange(ends[0], ends[1] - step, step)
    parts = [
        watched.log.take((watched.log.time >= a) & (watched.log.time < a + step)) for a in begins
    ]
    reached = [math.degrees(swing(part, zero, part.time[0])) for part in parts]
    add(figure, 2, begins + step / 2, reached, name="amplitude", line={"color": PALETTE[0]})
    wanted = math.degrees(0.5 * (watched.orbit.upper - watched.orbit.lower))
    add(figure, 2, ends, [wanted] * 2, name="target", line=dashed)
    for alarm in watched.alarms:
        figure.add_vline(x=alarm.time, line={"color": PALETTE[5], "width": 1})
    return figure
