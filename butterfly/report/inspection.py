"""Logs in tables: what `butterfly inspect` finds on them, and the first cells of any row."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from operator import itemgetter
from pathlib import PurePath
from statistics import median
from typing import Any

import numpy as np

from butterfly.errors import InputError, listed
from butterfly.identification.residuals import LogResiduals
from butterfly.logs.health import Health, Remark, examine, thinned
from butterfly.logs.log import Log
from butterfly.logs.manifest import LogEntry, Manifest
from butterfly.logs.reading import piece_name, read_pieces
from butterfly.progress import Track, untracked
from butterfly.report.format import fit_text, label_of
from butterfly.report.page import Badge, Fact, Page, PageTable, Section
from butterfly.signals.frequency_response import (
    dominant_frequency,
    fit_basis,
    periodogram,
    resample,
    rms_amplitude,
    sine_basis,
    uniform_grid,
)
from butterfly.verdict import Level

Row = Mapping[str, Any]
"""What is known of a log, by column."""

_SAID_BY_LABEL = {"log", "added mass in kg", "frequency in rad/s"}

RESIDUAL_CAPTION = (
    "Error: rms of measured minus simulated motion, in % of the rms motion, averaged over steps of "
    "the simulation. Next: the part that no small change of the parameters removes, and the error "
    "that encoder resolution and noise explain. Bands: whether autocorrelation and "
    "cross-correlation with the input stay within 95 % bands of sensor noise; one good log in "
    "twenty does not. An error of up to 0.1 % of the motion is ignored: where the error is no "
    "larger, the bands are as wide as the curves can be, and nothing is tested."
)
"""What `residual_row` has."""

RESIDUAL_COLUMNS = (
    *("error in % of the motion", "after small changes in %", "sensor noise in %"),
    *("error over sensor noise", "outside its bands", "missing terms explain in %"),
)


def about_log(log: Log) -> dict[str, Any]:
    """Return the first cells of a log's row: name, added mass and frequency."""
    sine = log.excitation
    return {
        "log": log.name,
        "added mass in kg": log.added_mass.mass,
        "frequency in rad/s": sine.omega if sine else np.nan,
    }


def of_logs(title: str, rows: Sequence[Row], *names: str, **more: Any) -> PageTable:  # noqa: ANN401
    """Tabulate rows of logs, each by its short name; only ``names`` of their columns if given."""
    chosen = names or [name for name in rows[0] if name not in _SAID_BY_LABEL]
    columns: dict[str, Callable[[Row], object]] = {name: itemgetter(name) for name in chosen}
    return PageTable.of(title, rows, {"log": label_of, **columns}, **more)


def fit_facts(rows: Sequence[Row], column: str, label: str) -> list[Fact]:
    """Return median and worst of a column of FITs."""
    fits = {row["log"]: row[column] for row in rows if row[column] is not None}
    if not fits:
        return []
    worst = min(fits, key=lambda name: fits[name])
    return [
        Fact(f"FIT {label}, median", f"{fit_text(median(fits.values()))} %"),
        Fact(f"FIT {label}, worst", f"{fit_text(fits[worst])} %", worst.rsplit("/", 1)[-1]),
    ]


def residual_row(log: LogResiduals) -> dict[str, Any]:
    """Return the residuals of a log as cells of a result's row."""
    shares = (100 * x / (log.motion or np.nan) for x in (log.error, log.remaining, log.explained))
    cells = (*shares, log.times, bool(log.outside), 100 * log.share or np.nan)
    return dict(zip(RESIDUAL_COLUMNS, cells, strict=True))


STATES = {Level.GOOD: "ok", Level.NOTE: "note", Level.CARE: "care", Level.WARNING: "do not use"}
"""Condition of a log, in a word or two."""

FORECAST = "Expected precision"
"""Title of the table of forecasts."""


def log_columns(shared: Sequence[str]) -> dict[str, Callable[[Mapping[str, Any]], object]]:
    """Return the columns of the table of logs, each of a `log_row`, without ``shared`` findings."""

    def findings(row: Mapping[str, Any]) -> str:
        texts = (finding["text"] for finding in row["findings"])
        return "; ".join(text for text in texts if text not in shared)

    return {
        "log": lambda row: row["log"],
        "state": lambda row: row["condition"],
        "samples": lambda row: row.get("samples"),
        "s": lambda row: f"{row['duration']:.3f}" if "duration" in row else None,
        "ms": lambda row: f"{1e3 * row['step']:.3f}" if "step" in row else None,
        "findings": findings,
    }


_ADVICE = {
    Level.GOOD: "No check found a problem with this log.",
    Level.NOTE: "Nothing needs to be done.",
    Level.CARE: "Check the findings before you use this log.",
}
_TOLD = dict(zip(Level, ("ok", "with a note", "to check", "unusable"), strict=True))
_ENOUGH = 1_000_000  # samples that a periodogram is taken of
_MOSTLY = 0.5  # share of the input's variance that its sine explains
_ALIKE, _NEAR = 0.01, 0.1  # by which omega and amplitude may differ from those declared
_IF_UNLIKE = "Correct omega and amplitude of this log in the manifest, or leave both out."


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


def log_row(seen: Inspected) -> dict[str, Any]:
    """Return what is known of a log, and the findings on it, for programs."""
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
    seen = [*seen]
    names: dict[str, list[str]] = {}
    for inspected in seen:
        for remark in inspected.remarks:
            if remark.hint and inspected.name not in names.setdefault(remark.hint, []):
                names[remark.hint].append(inspected.name)
    every = f"All {len(seen)} logs" if len(seen) > 1 else ""
    whose = {hint: len(logs) == len(seen) and every for hint, logs in names.items()}
    return [f"{whose[hint] or listed(logs, 3)}: {hint}" for hint, logs in names.items()]


def taken_sentences(seen: Iterable[Inspected]) -> list[str]:
    """Say which units of inputs are assumed because no file states them."""
    assumed = [r.text for inspected in seen for r in inspected.remarks if r.condition is Level.GOOD]
    return [f"{text[:1].upper()}{text[1:]}." for text in dict.fromkeys(assumed)]


def shared_texts(seen: Sequence[Inspected]) -> list[str]:
    """Return the remarks that all of several logs have, which are said once."""
    texts = [[remark.text for remark in inspected.remarks] for inspected in seen]
    return in_all(texts) * (len(seen) > 1)


def in_all(texts: Sequence[Sequence[str]]) -> list[str]:
    """Return the texts of the first list that all the lists have."""
    return [text for text in texts[0] if all(text in others for others in texts)]


def shared_sentences(seen: Sequence[Inspected], shared: Sequence[str]) -> list[str]:
    """Say what is ``shared`` by several logs, but for what `taken_sentences` and `hints` say."""
    remarks = [remark for inspected in seen for remark in inspected.remarks]
    others = {r.text for r in remarks if r.condition is Level.GOOD or r.hint.startswith(r.text)}
    return [f"All {len(seen)} logs: {text}." for text in shared if text not in others]


def _inspected(manifest: Manifest, entry: LogEntry) -> Inspected:
    try:
        ((_, recorded),) = read_pieces(manifest, entry)
        log, health = examine(recorded, manifest.repair)
    except InputError as error:
        why = f"{error.field}: got {error.value}"
        hint = f"{why}; expected {error.expected}"
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


def inspection_page(plain: Page) -> Page:
    """Return the page of an inspection: forecasts, then all logs, or all of a single one."""
    numbers, tables = (
        plain.numbers,
        [PageTable.of_plain(table) for table in plain.numbers["tables"]],
    )
    sections = [
        Section(title=FORECAST, tables=(table._replace(words=(1, 2, 4)),))
        for table in tables
        if table.title == FORECAST
    ]
    if not numbers["single"]:
        first, *others = (table for table in tables if table.title != FORECAST)
        rows = [*first.rows, *(row for table in others for row in table.rows)]
        logs = Section(title="In numbers", tables=(first._replace(rows=rows).on_page(),))
        return replace(plain, sections=[*sections, logs])
    (row,) = numbers["logs"]
    state = next(level for level, word in STATES.items() if word == row["condition"])
    findings = [f"{finding['text']}." for finding in row["findings"]]
    log = Section(title="In numbers", tables=(PageTable(rows=numbers["single"], words=(1,)),))
    lead, *sections = [*sections, log]
    return replace(
        plain,
        name=PurePath(numbers["source"]).name,
        badge=Badge(state, row["condition"].capitalize(), [_ADVICE[state], *findings]),
        lead=lead,
        sections=sections,
    )
