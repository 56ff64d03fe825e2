"""Move it and watch: a page simulates its logs again, with parameters that its reader moves.

The page has the command and the measured motion on a uniform grid: the command as its mean over
each step, late by the estimated delay, and the motion at the steps' ends. Both are rounded to
1/20,000 of their range. FIT on this grid differs a little from the raw log's; the page shows both.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from markupsafe import Markup

from butterfly.arrays import Samples
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.identified import Identified
from butterfly.identification.parameter import Parameter, or_nan
from butterfly.identification.segments import needs_loop
from butterfly.model.terms import LOOP_TERMS, TERMS
from butterfly.report.format import counted
from butterfly.report.live_log import LiveLog
from butterfly.report.page import Section, environment
from butterfly.report.parameter_table import limited_text
from butterfly.twin.c import as_javascript
from butterfly.twin.twin import Twin

ROOM = 300_000
"""Characters for the logs of a page. If all need more, it has the worst and one for each mass."""

_TITLE = "Move it and watch"
_TEXT = (
    "Move a parameter: the page simulates the log again from the recorded input, and FIT follows."
)
_WORST = 6  # logs of the lowest FIT
_SHARE = 0.5  # of its value that a slider reaches, either way: the motion parts; or, if these
_INTERVALS = 3  # half-widths of the 95 % interval are more, or are chosen, so many of them
_WITHOUT = 0.1 / _INTERVALS  # of the value, in place of an interval that is not known
_LEAST = 0.25  # of a value that must stay positive:


@dataclass(frozen=True, kw_only=True)
class Slider:
    """A parameter of the table that can be moved: its value, half its interval, its least value."""

    name: str
    meaning: str
    unit: str
    value: float
    half: float
    least: float | None
    identified: str  # value and limit, as all tables have them

    @classmethod
    def of(cls, row: Parameter) -> Slider:
        """Make it of a row of the estimate's table, whose value is not open."""
        value = or_nan(row.value)
        least = _LEAST * value if TERMS[row.name].positive else TERMS[row.name].lower
        return cls(
            name=row.name,
            meaning=row.meaning,
            unit=row.unit,
            value=value,
            half=row.farther or _WITHOUT * abs(value) or _WITHOUT,
            least=None if least == -math.inf else min(least, value),
            identified=limited_text(row),
        )

    @property
    def reach(self) -> float:
        """How far it can be moved, either way."""
        return max(_INTERVALS * self.half, _SHARE * abs(self.value))


def live_section(identification: Identified) -> Section:
    """Return the section, or one that says in a line why the page cannot simulate."""
    data, estimate = identification.data, identification.estimate
    try:
        if reason := _not_here(data, estimate):
            return Section(title=_TITLE, text=f"No sliders: {reason}")
        sliders = [Slider.of(row) for row in estimate.table() if not row.known]
        twin = Twin.identified(identification)
        program = as_javascript(_every_term(twin, data, sliders))
    except NotImplementedError as error:
        reason = f"the page cannot simulate this model ({error})."
        return Section(title=_TITLE, text=f"No sliders: {reason}")
    logs, which = _carried(data, estimate, identification.fit_of_logs, sliders)
    if not logs:
        return Section(title=_TITLE, text="No sliders: the simulation follows none of the logs.")
    markup = _rendered(twin, program, sliders, logs, which)
    return Section(title=_TITLE, text=_TEXT, markup=markup)


def _not_here(data: DataSet, estimate: Estimate) -> str:
    """Say why a page cannot simulate a result; nothing if it can."""
    p = estimate.parameters
    if names := estimate.open:
        return f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} open."
    if any(finding.impossible for finding in estimate.findings):
        return "no joint has these values."
    if any(map(needs_loop, data.logs)):
        return "these logs are simulated in the servo's loop, which the page does not have."
    if p.slow_delay or not {"slow_delay", *LOOP_TERMS}.isdisjoint(estimate.names):
        return "the clock has two sampling regimes with a delay each; the page has one delay."
    return ""


def _every_term(twin: Twin, data: DataSet, sliders: Sequence[Slider]) -> Twin:
    """Return the loaded joint with no slider's value at 0: the program then has all terms."""
    heaviest = max(data.masses, key=lambda mass: mass.mass)
    moved = {slider.name: abs(slider.value) + slider.half for slider in sliders}
    return replace(twin, added=heaviest, parameters=replace(twin.parameters, **moved))


def _carried(
    data: DataSet, estimate: Estimate, fits: Samples, sliders: Sequence[Slider]
) -> tuple[list[LiveLog], str]:
    """Return the logs that the page has, and a text that says which they are."""
    delays = [slider.reach for slider in sliders if slider.name == "delay"]
    order = [int(k) for k in np.argsort(fits) if math.isfinite(fits[k])]
    logs: dict[int, LiveLog] = {}
    for k in order:
        setting = data.simulations.setting(k, estimate)
        simulation = data.simulations.simulation(k, setting)
        logs[k] = LiveLog.of(simulation, setting, float(fits[k]), max(delays, default=0.0))
    every = counted(len(fits), "log")
    if sum(log.size for log in logs.values()) <= ROOM:
        lost = f" ({len(fits) - len(logs)} diverge)" if len(logs) < len(fits) else ""
        return [logs[k] for k in sorted(logs)], f"all {every}{lost}"
    chosen = order[:_WORST]
    for mass in data.masses:
        numbers = [k for k in order if data.logs[k].added_mass == mass]
        chosen += numbers[len(numbers) // 2 :][:1]
    picks: list[LiveLog] = []
    room = ROOM
    for number in dict.fromkeys(chosen):
        room -= logs[number].size
        picks += [logs[number]] if room >= 0 or not picks else []
    which = f"{len(picks)} of {every}, the {_WORST} with the lowest FIT and the median one of each "
    return picks, f"{which}added mass: {'; '.join(log.label for log in picks)}"


def _rendered(
    twin: Twin, program: str, sliders: Sequence[Slider], logs: Sequence[LiveLog], which: str
) -> Markup:
    middling = sorted(logs, key=lambda log: log.raw)[len(logs) // 2]
    differences = [log.fit(log.setting.parameters) - log.raw for log in logs]
    content = {
        "sliders": [asdict(slider) for slider in sliders],
        "logs": [log.document() for log in logs],
        "intervals": _INTERVALS,
        "share": _SHARE,
        "shape": twin.shape.name.lower(),
    }
    return Markup(  # noqa: S704 - of our own templates
        environment()
        .get_template("live.html.j2")
        .render(
            sliders=sliders,
            logs=logs,
            program=program,
            content=json.dumps(content, separators=(",", ":")).replace("<", "\\u003c"),
            chosen=logs.index(middling),
            ranges={"wide": f"{100 * _SHARE:.0f} %", "near": f"{_INTERVALS} intervals"},
            note=_note(logs, which, differences),
        )
    )


def _note(logs: Sequence[LiveLog], which: str, differences: Sequence[float]) -> str:
    """Say what the page has of the logs, how far its FIT is from theirs, what sliders reach."""
    steps = sorted({f"{1e3 * log.step:.3g}" for log in logs}, key=float)
    grid = steps[0] if len(steps) == 1 else f"{steps[0]} to {steps[-1]}"
    return (
        f"On this page: {which}. Grid: {grid} ms; FIT on it differs from FIT of the raw log by at "
        f"most {max(map(abs, differences)):.2f} points. Each log starts from the state that its "
        f"free run starts from. Sliders reach {100 * _SHARE:.0f} % of the value, or {_INTERVALS} "
        "times the ± beside them, the half-width of the 95 % interval, if that is more or chosen."
    )
