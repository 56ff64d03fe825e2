"""What `butterfly inspect` finds on logs: result, texts, tables and page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import TypeAdapter

from butterfly.errors import InputError, listed
from butterfly.identification.forecast import Forecast
from butterfly.logs.health import Health, Remark, examine
from butterfly.logs.log import Log
from butterfly.logs.manifest import LogEntry, Manifest
from butterfly.logs.reading import piece_name, read_pieces
from butterfly.logs.thinning import thinned
from butterfly.progress import Track, untracked
from butterfly.report.page import Badge, Page, PageTable, Section, tabulated
from butterfly.report.parameter_table import FORECAST_HEADERS, forecast_rows, forecast_sentences
from butterfly.result import Answer, cell_text, text
from butterfly.signals.sine_fit import fit_basis, sine_basis
from butterfly.signals.spectrum import (
    dominant_frequency,
    periodogram,
    resample,
    rms_amplitude,
    uniform_grid,
)
from butterfly.verdict import Level

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

STATES = {Level.GOOD: "ok", Level.NOTE: "note", Level.CARE: "care", Level.WARNING: "do not use"}
"""Condition of a log, in a word or two."""

_TOLD = dict(zip(Level, ("ok", "with a note", "to check", "unusable"), strict=True))
_ADVICE = {
    Level.GOOD: "No check found a problem with this log.",
    Level.NOTE: "Nothing needs to be done.",
    Level.CARE: "Check the findings before you use this log.",
}
_ENOUGH = 1_000_000  # samples that a periodogram is taken of
_MOSTLY = 0.5  # share of the input's variance that its sine explains
_ALIKE, _NEAR = 0.01, 0.1  # by which omega and amplitude may differ from those declared
_IF_UNLIKE = "Correct omega and amplitude of this log in the manifest, or leave both out."
_FORECAST = "What these logs can tell"
_FORECASTS = TypeAdapter(tuple[Forecast, ...])


@dataclass(frozen=True, kw_only=True)
class Inspected:
    """A log of a data set, with the findings on it."""

    name: str  # Of the log
    log: Log | None = None  # The log, repaired; None if it cannot be used
    health: Health | None = None  # Its record; None if it cannot be used
    remarks: tuple[Remark, ...]  # What is to be said of it, worst first

    @property
    def condition(self) -> Level:
        """The worst condition of the remarks."""
        return Level.worst(remark.condition for remark in self.remarks)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Inspection(Answer):
    """The condition of logs, worst first, and which parameters they can tell."""

    kind: ClassVar[str] = "inspection"
    table: ClassVar[str] = "logs"

    logs: tuple[Inspected, ...] = ()
    """The findings of each log; none if loaded."""

    @classmethod
    def of(
        cls,
        part: Manifest,
        seen: Sequence[Inspected],
        forecasts: Sequence[Forecast],
        more: Sequence[str],
    ) -> Inspection:
        """Tabulate findings on logs of a manifest, and forecasts; ``more`` ends the summary."""
        way = part.joint.way
        single = len(seen) == 1
        return cls(
            title=f"Logs of {part.name!r}",
            summary=(
                conditions_text([inspected.condition for inspected in seen]),
                *forecast_sentences(forecasts),
                *hints(seen),
                *_taken(seen),
                *more,
            ),
            content={
                "data": {
                    "name": part.name,
                    "description": part.description,
                    "input": str(part.input),
                    "logs": len(seen),
                    "joint": str(part.joint),
                },
                "logs": [_looked_at(inspected) for inspected in seen],
                "before_fit": [
                    {**asdict(forecast), "word": str(forecast.word)} for forecast in forecasts
                ],
                "source": seen[0].name if single else part.name,
                "single": [
                    pair
                    for inspected in seen[: int(single)]
                    if inspected.log is not None and inspected.health is not None
                    for pair in health_rows(inspected.log, inspected.health)
                ],
            },
            units={
                **{f"logs.{name}": "s" for name in ("duration", "step", "jitter", "longest_gap")},
                "logs.angle": way,
                "logs.velocity": f"{way}/s",
                "logs.turns": "turns",
                "logs.middle": way,
                "before_fit.half_width": "the row's unit",
                "before_fit.expected": "1",
            },
            logs=tuple(seen),
        )

    @property
    def before_fit(self) -> tuple[Forecast, ...]:
        """What can be expected of each parameter's identification."""
        return _FORECASTS.validate_python(self.content["before_fit"])

    @property
    def source(self) -> str:
        """Name of the data, or of a single log."""
        return text(self.content["source"])

    @property
    def unusable(self) -> int:
        """Number of unusable logs."""
        return sum(row["condition"] == STATES[Level.WARNING] for row in self.rows())

    @property
    def _single(self) -> list[tuple[str, str]]:
        """All that is known of a single log; nothing if there are others."""
        return [(name, value) for name, value in self.content["single"]]

    def require_usable(self) -> None:
        """Raise InputError if some logs are unusable."""
        if self.unusable:
            expected = "usable logs; repair or exclude these (see the findings)"
            raise InputError(self.source, "logs", f"{self.unusable} unusable", expected)

    def shown_rows(self) -> list[dict[str, str]]:
        """Return a row for each log, formatted for reading."""
        return [
            {
                "log": text(row["log"]),
                "state": text(row["condition"]),
                "samples": cell_text(row.get("samples")),
                "s": f"{row['duration']:.3f}" if "duration" in row else "–",
                "ms": f"{1e3 * row['step']:.3f}" if "step" in row else "–",
                "findings": "; ".join(finding["text"] for finding in row["findings"]),
            }
            for row in self.rows()
        ]

    def tables(self) -> list[PageTable]:
        """Return logs with findings, all of a single one, the forecasts, and the other logs."""
        rows, forecasts = self.shown_rows(), forecast_rows(self.before_fit)
        lines, ok = [tuple(row.values()) for row in rows], STATES[Level.GOOD]
        findings, others = (
            [line for line in lines if (line[1] == ok) is fine] for fine in (False, True)
        )
        tables = [
            PageTable(self.source, (*rows[0],), findings),
            PageTable(_FORECAST, FORECAST_HEADERS, forecasts),
            PageTable("Without findings", (*rows[0],), others, detail=True),
        ]
        if self._single:
            state = ("state", rows[0]["state"]), ("findings", rows[0]["findings"] or "none")
            tables = [PageTable(self.source, (), [*state, *self._single]), tables[1]]
        return [table for table in tables if table.rows]

    def figures(self) -> dict[str, Figure]:
        """Return the recording of the first, and worst, log that can be read."""
        from butterfly.report.log_figures import recorded_figure  # noqa: PLC0415 - slow to import

        drawn = [inspected.log for inspected in self.logs if inspected.log is not None]
        return {"log": recorded_figure(drawn[0])} if drawn else {}

    def page(self) -> Page:
        """Return the page of `report`: of a single log all that is known of it."""
        page, forecasts = super().page(), forecast_rows(self.before_fit)
        table = PageTable(headers=FORECAST_HEADERS, rows=forecasts, words=(1, 2, 4))
        forecast = tabulated(_FORECAST, table)
        if not self._single:
            return replace(page, sections=[*forecast, *page.sections])
        lead, *sections = [*forecast, *self._of_single(page).parts]
        return replace(self._of_single(page), lead=lead, sections=sections)

    def _of_single(self, page: Page) -> Page:
        """Return the page with the condition of a single log on top, and its numbers."""
        (row,) = self.rows()
        state = next(level for level, word in STATES.items() if word == row["condition"])
        findings = [f"{finding['text']}." for finding in row["findings"]]
        table = PageTable(headers=(), rows=self._single, words=(1,))
        return replace(
            page,
            name=PurePath(self.source).name,
            badge=Badge(state, row["condition"].capitalize(), [_ADVICE[state], *findings]),
            lead=Section(title="In numbers", tables=(table,)),
            sections=[] if page.lead is None else [replace(page.lead, title="The log")],
        )


def _looked_at(seen: Inspected) -> dict[str, Any]:
    known: dict[str, Any] = {"log": seen.name, "condition": STATES[seen.condition]}
    if seen.health is not None and seen.log is not None:
        log, health = seen.log, asdict(seen.health)
        first = {name: health.pop(name) for name in ("samples", "duration", "step")}
        health["regimes"] = [regime._asdict() for regime in seen.health.regimes]
        known |= {
            **first,
            "added_mass": {"mass": log.added_mass.mass, "arm": log.added_mass.arm},
            "input": [float(log.input.min()), float(log.input.max())],
            log.measures: [float(log.measured.min()), float(log.measured.max())],
            **health,
        }
    findings = [
        {**remark._asdict(), "condition": STATES[remark.condition]} for remark in seen.remarks
    ]
    return {**known, "findings": findings}


def inspect_logs(manifest: Manifest, track: Track = untracked) -> list[Inspected]:
    """Look at every log of a data set; the worst come first."""
    seen = _turned(
        [_inspected(manifest, entry) for entry in track(manifest.logs, "Inspecting logs")]
    )
    return sorted(seen, key=lambda inspected: -list(Level).index(inspected.condition))


def conditions_text(conditions: Sequence[Level]) -> str:
    """Say how many logs are in which condition."""
    logs = f"{len(conditions)} log{'s' * (len(conditions) != 1)}"
    counts = {level: conditions.count(level) for level in Level}
    if counts[Level.GOOD] == len(conditions):
        return f"{logs}: {'all ' * (len(conditions) > 1)}ok."
    if Level.worst(conditions) is Level.NOTE:
        return f"{logs}, all usable ({counts[Level.NOTE]} {_TOLD[Level.NOTE]})."
    parts = [f"{count} {_TOLD[level]}" for level, count in counts.items() if count]
    return f"{logs}: {', '.join(parts)}."


def hints(seen: Iterable[Inspected]) -> list[str]:
    """Return what to do about the remarks on logs, each hint once, after the logs' names."""
    names: dict[str, list[str]] = {}
    for inspected in seen:
        for remark in inspected.remarks:
            if remark.hint and inspected.name not in names.setdefault(remark.hint, []):
                names[remark.hint].append(inspected.name)
    return [f"{listed(logs, 3)}: {hint}" for hint, logs in names.items()]


def _taken(seen: Iterable[Inspected]) -> list[str]:
    """Say what inputs were taken in whose files do not say it."""
    assumed = [r.text for inspected in seen for r in inspected.remarks if r.condition is Level.GOOD]
    return [f"{text[:1].upper()}{text[1:]}." for text in dict.fromkeys(assumed)]


def _inspected(manifest: Manifest, entry: LogEntry) -> Inspected:
    try:
        ((_, recorded),) = read_pieces(manifest, entry)
        log, health = examine(recorded, manifest.repair)
    except InputError as error:
        why = f"{error.field}: {error.value}"
        hint = f"{error.field}: expected {error.expected}"
        return Inspected(name=piece_name(entry), remarks=(Remark(Level.WARNING, why, hint),))
    remarks = sorted(
        [*_unlike(log), *health.remarks], key=lambda remark: remark.condition is not Level.CARE
    )
    return Inspected(name=piece_name(entry), log=log, health=health, remarks=tuple(remarks))


def _unlike(log: Log) -> list[Remark]:
    """Remark that the input is not the sine that the manifest declares."""
    if log.excitation is None or not np.ptp(log.input):
        return []
    declared, unit = log.excitation, log.input_kind.unit
    omega, share = dominant_frequency(log.time, log.input)
    resolved = max(math.tau / (log.time[-1] - log.time[0]), _ALIKE * declared.omega)
    if share < _MOSTLY:
        text = f"a sine of {declared.omega:g} rad/s declared, the log's input is no sine"
    elif abs(omega - declared.omega) > resolved:
        text = f"omega {declared.omega:g} rad/s declared, the log's input has {omega:.4g} rad/s"
    else:
        amplitude = fit_basis(sine_basis(log.time, omega, 1), log.input, omega).amplitude
        if abs(amplitude - declared.amplitude) <= _NEAR * declared.amplitude:
            return []
        text = f"amplitude {declared.amplitude:g} {unit} declared, the log's input has "
        text += f"{amplitude:.4g} {unit}"
    return [Remark(Level.CARE, text, _IF_UNLIKE)]


def _turned(seen: list[Inspected]) -> list[Inspected]:
    """Remark logs that swing whole turns away from where the others do."""
    middles = {
        number: inspected.health.middle
        for number, inspected in enumerate(seen)
        if inspected.health is not None
        and 0.0 < inspected.health.turns <= 1.0  # on a slide there is none
    }
    home, where = 0.0, "the encoder's zero"
    if len(middles) > 1:
        home, where = sorted(middles.values(), key=abs)[(len(middles) - 1) // 2], "the others"
    result = list(seen)
    for number, middle in middles.items():
        turns = round((middle - home) / math.tau)
        if turns:
            text = f"swings {turns:+d} turn{'s' * (abs(turns) > 1)} from {where}"
            remarks = (*seen[number].remarks, Remark(Level.NOTE, text))
            result[number] = replace(seen[number], remarks=remarks)
    return result


def health_rows(log: Log, health: Health) -> list[tuple[str, str]]:
    """Tabulate a log's clock, range and dominant frequency, as names and texts."""
    few = thinned(log, _ENOUGH)
    grid = uniform_grid(few.time)
    swing = resample(few.time, few.measured, grid)
    swing = swing - swing.mean()
    omega, power = periodogram(swing, grid[1] - grid[0])
    bin_width, way, measured = omega[0], log.unit, log.measured
    return [
        ("samples", f"{health.samples}"),
        ("duration", f"{health.duration:.3f} s"),
        (
            "sampling interval",
            f"{1e3 * health.step:.3f} ms, jitter {1e3 * health.jitter:.3f} ms rms",
        ),
        ("longest interval", f"{1e3 * health.longest_gap:.2f} ms"),
        ("input", f"{log.input.min():.5g} … {log.input.max():.5g} {log.input_kind.unit}"),
        *_servo_rows(log),
        (log.measures, f"{measured.min():.5g} … {measured.max():.5g} {way}"),
        (
            "amplitude",
            f"{rms_amplitude(swing):.4g} {way} (√2 rms), mean {measured.mean():.4g} {way}",
        ),
        ("dominant frequency", f"{omega[np.argmax(power)]:.3f} ± {bin_width / 2:.3f} rad/s"),
        ("file", ", ".join(log.reading.layout) or "default layout"),
        *((f"{name} from", column.text) for name, column in health.columns.items()),
    ]


def _servo_rows(log: Log) -> list[tuple[str, str]]:
    """Tabulate the loop of a servo, its supply, and for how long it was off."""
    rows = [] if log.servo is None else [("servo", f"{log.servo}")]
    if log.supply is not None:
        rows.append(("supply", f"{log.supply.min():.5g} … {log.supply.max():.5g} V"))
    if log.enabled is not None:
        off = 100 * float(np.mean(np.rint(log.enabled) == 0))
        rows.append(("drive off", f"{off:.3g} % of the samples"))
    return rows
