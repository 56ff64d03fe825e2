"""Texts, tables and page of `butterfly inspect`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.errors import InputError, listed
from butterfly.logs.health import Health, Remark, examine
from butterfly.logs.log import Log
from butterfly.logs.manifest import LogEntry, Manifest
from butterfly.logs.reading import piece_name, read_pieces
from butterfly.logs.thinning import thinned
from butterfly.progress import Track, untracked
from butterfly.report.page import Badge, Page, PageTable, Section
from butterfly.signals.spectrum import periodogram, resample, rms_amplitude, uniform_grid
from butterfly.verdict import Level

STATES = {Level.GOOD: "ok", Level.NOTE: "note", Level.CARE: "care", Level.WARNING: "do not use"}
"""Condition of a log, in a word or two."""

_TOLD = {
    Level.GOOD: "ok",
    Level.NOTE: "with a note",
    Level.CARE: "to check",
    Level.WARNING: "unusable",
}
_ADVICE = {
    Level.GOOD: "No check found a problem with this log.",
    Level.NOTE: "Nothing needs to be done.",
    Level.CARE: "Check the findings before you use this log.",
}
_ENOUGH = 1_000_000  # samples that a periodogram is taken of


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

    @property
    def findings(self) -> str:
        """The remarks in words."""
        return "; ".join(remark.text for remark in self.remarks)


def inspect_logs(manifest: Manifest, track: Track = untracked) -> list[Inspected]:
    """Look at every log of a data set; the worst come first."""
    seen = _turned(
        [_inspected(manifest, entry) for entry in track(manifest.logs, "Inspecting logs")]
    )
    return sorted(seen, key=lambda each: -list(Level).index(each.condition))


def conditions_text(conditions: Sequence[Level]) -> str:
    """Say how many logs are in which condition."""
    logs = f"{len(conditions)} log{'s' * (len(conditions) != 1)}"
    counts = {each: conditions.count(each) for each in Level}
    if counts[Level.GOOD] == len(conditions):
        return f"{logs}: {'all ' * (len(conditions) > 1)}ok."
    if Level.worst(conditions) is Level.NOTE:
        return f"{logs}, all usable ({counts[Level.NOTE]} {_TOLD[Level.NOTE]})."
    told = [f"{count} {_TOLD[each]}" for each, count in counts.items() if count]
    return f"{logs}: {', '.join(told)}."


def hints(seen: Iterable[Inspected]) -> list[str]:
    """Return what to do about the remarks on logs, each hint once, after the logs' names."""
    names: dict[str, list[str]] = {}
    for each in seen:
        for remark in each.remarks:
            if remark.hint and each.name not in names.setdefault(remark.hint, []):
                names[remark.hint].append(each.name)
    return [f"{listed(logs, 3)}: {hint}" for hint, logs in names.items()]


def _inspected(manifest: Manifest, entry: LogEntry) -> Inspected:
    try:
        ((_, recorded),) = read_pieces(manifest, entry)
        log, health = examine(recorded, manifest.repair)
    except InputError as error:
        why = f"{error.field}: {error.value}"
        hint = f"{error.field}: expected {error.expected}"
        return Inspected(name=piece_name(entry), remarks=(Remark(Level.WARNING, why, hint),))
    return Inspected(name=piece_name(entry), log=log, health=health, remarks=tuple(health.remarks))


def _turned(seen: list[Inspected]) -> list[Inspected]:
    """Remark logs that swing whole turns away from where the others do."""
    middles = {
        number: each.health.middle
        for number, each in enumerate(seen)
        if each.health is not None and 0.0 < each.health.turns <= 1.0  # on a slide there is none
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
    """Tabulate a log's clock, range, dominant frequency and findings, as names and texts."""
    few = thinned(log, _ENOUGH)
    grid = uniform_grid(few.time)
    swing = resample(few.time, few.measured, grid)
    swing = swing - swing.mean()
    omega, power = periodogram(swing, grid[1] - grid[0])
    bin_width, way, measured = omega[0], log.unit, log.measured
    return [
        ("state", STATES[health.condition]),
        ("findings", "; ".join(health.findings) or "none"),
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
        *((f"{name} from", each.text) for name, each in health.columns.items()),
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


def inspection_page(log: Log, health: Health, numbers: dict[str, Any]) -> Page:
    """Put together the page of a log that can be used."""
    from butterfly.report.log_figures import recorded_figure  # noqa: PLC0415 - slow to import

    remarks, state = health.remarks, health.condition
    found = [f"{remark.text}." for remark in remarks]
    rows = [row for row in health_rows(log, health) if row[0] not in {"state", "findings"}]
    table = PageTable(headers=(), rows=rows, words=(1,))
    return Page(
        name=Path(log.source).name or log.label,
        description="",
        kind="inspection",
        badge=Badge(state, STATES[state].capitalize(), [_ADVICE[state], *found]),
        summary=hints([Inspected(name=log.label, remarks=tuple(remarks))]),
        lead=Section(title="In numbers", tables=(table,)),
        sections=[Section(title="The log", figures={"log": recorded_figure(log)})],
        numbers=numbers,
    )
