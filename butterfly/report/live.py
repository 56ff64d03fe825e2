"""Move it and watch: a page simulates its logs again, with parameters that its reader moves."""

from __future__ import annotations

import gzip
import json
import math
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import Setting, fit_of
from butterfly.identification.identified import Identified
from butterfly.identification.segments import needs_loop
from butterfly.identification.simulation import Simulation
from butterfly.identification.trust import Parameter, or_nan
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import LOOP_TERMS, TERMS
from butterfly.report.format import counted
from butterfly.report.page import Section, environment
from butterfly.report.parameter_table import limited_text
from butterfly.signals import hold
from butterfly.twin.c import added_numbers, as_javascript, held_motion
from butterfly.twin.twin import Twin

LONGEST = 0.01
"""Longest step of a grid in s; it is finer for a log that is simulated in finer steps."""

_MOST = 20_000  # samples of a log
_LEVELS = 20_000  # to which a column is rounded
_SPARE, _MOST_SPARE = 4, 100  # steps before and after a log, for a delay that moves
_PERIODS, _SECONDS = 5, 10.0  # shown first, of a sine and of any other log
_ROUNDING = 1e-9  # of a step


class Column(NamedTuple):
    """Numbers in levels: begin + level * quantum."""

    begin: float
    quantum: float
    levels: NDArray[np.int64]  # (n,)

    @classmethod
    def of(cls, values: Samples) -> Column:
        """Round (n,) numbers."""
        quantum = float(np.ptp(values)) / _LEVELS or 1.0
        levels = np.rint((values - values[0]) / quantum).astype(np.int64)
        return cls(float(values[0]), quantum, levels)

    @property
    def values(self) -> Samples:
        """(n,) numbers."""
        return np.asarray(self.begin + self.levels * self.quantum)

    @property
    def packed(self) -> dict[str, Any]:
        """For the page: differences of the order that packs best, in three planes of bytes."""
        differences, tried = self.levels, []
        for order in (1, 2, 3):
            differences = np.diff(differences, prepend=0)
            # d is 2 d there, and -2 d - 1 if it is negative
            folded = np.where(differences < 0, -2 * differences - 1, 2 * differences)
            planes = b"".join((folded >> k & 255).astype(np.uint8).tobytes() for k in (0, 8, 16))
            tried.append((b64encode(gzip.compress(planes, 9, mtime=0)).decode("ascii"), order))
        data, order = min(tried, key=lambda trial: len(trial[0]))
        return {"begin": self.begin, "quantum": self.quantum, "order": order, "data": data}


@dataclass(frozen=True, kw_only=True, eq=False)
class LiveLog:
    """One log on its grid, and what it is simulated with."""

    simulation: Simulation
    setting: Setting
    raw: float
    """FIT in per cent of the free run."""
    step: float
    """Of the grid in s."""
    commands: Column
    """Means over steps, late by the estimated delay, some before and after the log."""
    spare: int
    """Number of those."""
    measured: Column
    """(n,) at the ends of steps."""

    @classmethod
    def of(cls, simulation: Simulation, setting: Setting, raw: float, reach: float) -> LiveLog:
        """Put a log on a grid; its delay can move by a ``reach`` in s either way."""
        log = simulation.log
        span = float(log.time[-1] - log.time[0])
        step = max(min(LONGEST, simulation.step), span / _MOST)
        count = max(int(span / step + _ROUNDING), 1) + 1
        spare = min(math.ceil(reach / step), _MOST_SPARE) + _SPARE
        edges = log.time[0] + step * np.arange(-spare, count + spare)
        means = hold.mean(*log.command, edges - setting.parameters.delay, log.between_samples)
        instants = log.time[0] + step * np.arange(count)
        return cls(
            simulation=simulation,
            setting=setting,
            raw=raw,
            step=step,
            commands=Column.of(means),
            spare=spare,
            measured=Column.of(np.interp(instants, log.time, log.measured)),
        )

    @property
    def label(self) -> str:
        """Its name on the page."""
        return self.simulation.log.label

    @cached_property
    def packed(self) -> dict[str, Any]:
        """Its columns for the page."""
        return {"commands": self.commands.packed, "measured": self.measured.packed}

    @property
    def size(self) -> int:
        """Characters that it needs."""
        return sum(len(column["data"]) for column in self.packed.values())

    @cached_property
    def starts(self) -> tuple[tuple[int, float, float], ...]:
        """Numbers of samples, and angle and velocity from which the free run goes on there."""
        log, setting = self.simulation.log, self.setting
        motion = self.simulation.run(setting.parameters, setting.zero, setting.velocity)
        starts = []
        for grid, angle, velocity in motion.pieces:
            number = math.ceil((grid[0] - log.time[0]) / self.step - _ROUNDING)
            at = np.array([log.time[0] + number * self.step])
            x, v = (hold.interpolate(grid, angle, velocity, at, k) for k in (False, True))
            starts.append((number, float(x[0]) - setting.zero, float(v[0])))
        return tuple(start for start in starts if start[0] < self.measured.levels.size - 1)

    def simulated(self, moved: LumpedParameters) -> Samples:
        """(n,) what is measured at the ends of steps, with parameters of the bare joint."""
        log, setting = self.simulation.log, self.setting
        late = (moved.delay - setting.parameters.delay) / self.step
        whole = math.floor(late + _ROUNDING)
        loaded = replace(moved, delay=(late - whole) * self.step).with_added_mass(log.added_mass)
        delivered = np.asarray(moved.drive.delivered(self.commands.values))
        result = np.empty(self.measured.levels.size)
        ends = [*(number for number, *_ in self.starts[1:]), result.size]
        for (begin, x, v), end in zip(self.starts, ends, strict=True):
            steps = np.arange(begin - 2, end - 1) + self.spare - whole
            commands = delivered[np.clip(steps, 0, delivered.size - 1)]
            motion = held_motion(loaded, commands[:2], commands[2:], (x, v), self.step)
            result[begin:end] = motion[log.integrated]
        return result if log.integrated else result + setting.zero

    def fit(self, moved: LumpedParameters) -> float:
        """FIT in per cent on the grid, with parameters of the bare joint."""
        measured = self.measured.values
        with np.errstate(over="ignore", invalid="ignore"):
            error = self.simulated(moved) - measured
            return fit_of(float(np.sqrt(np.mean(error**2))), float(np.std(measured)))

    def document(self) -> dict[str, Any]:
        """Return it for the page."""
        log, setting = self.simulation.log, self.setting
        sine = log.excitation
        span = self.step * (self.measured.levels.size - 1)
        return self.packed | {
            "label": self.label,
            "step": self.step,
            "spare": self.spare,
            "shown": min(2 * math.pi * _PERIODS / sine.omega if sine else _SECONDS, span),
            "periods": _PERIODS if sine else 0,
            "starts": self.starts,
            "zero": 0.0 if log.integrated else setting.zero,
            "integrated": log.integrated,
            "unit": log.unit,
            "parameters": asdict(setting.parameters),
            "added": added_numbers(log.added_mass),
            "raw": self.raw,
        }


ROOM = 300_000
"""Characters for the logs of a page. If all need more, it has the worst and one for each mass."""

_TITLE = "Move it and watch"
_TEXT = (
    "Move a slider to change a parameter. The page simulates the log again from its recorded "
    "input, and the FIT says how well the simulation still follows the measurement."
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
        return Section(title=_TITLE, text="No sliders: the simulation of every log diverges.")
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
        return "these logs need the servo's control loop, which the page cannot simulate."
    if p.slow_delay or not {"slow_delay", *LOOP_TERMS}.isdisjoint(estimate.names):
        return "the clock has two sampling regimes with a delay each; the page can only use one."
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
        lost = f" but {len(fits) - len(logs)}, which diverge" if len(logs) < len(fits) else ""
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
    which = f"{len(picks)} of {every}, those {_WORST} with the lowest FIT and, of each added mass, "
    return picks, f"{which}the one with the median FIT: {'; '.join(log.label for log in picks)}"


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
        f"On this page: {which}. It simulates in steps of {grid} ms; its FIT differs from that of "
        f"the recorded samples by at most {max(map(abs, differences)):.2f} points. Each simulation "
        "starts with the angle and velocity with which the identification starts it. A slider "
        f"moves a value by up to {100 * _SHARE:.0f} %, or by {_INTERVALS} times the ± below it "
        "(the half-width of its 95 % interval) if that is more or is chosen as the range."
    )
