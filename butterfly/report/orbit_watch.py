"""The section of a report on an orbit that says whether and how the robot changed."""

from __future__ import annotations

import math

import numpy as np

from butterfly.orbit.change_detection import Alarm, Cause
from butterfly.orbit.loop import swing
from butterfly.orbit.online import Watched
from butterfly.report.figures import GREY, PALETTE, add, log_ticks, panels
from butterfly.report.page import PageTable, Section

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
