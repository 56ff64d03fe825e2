"""Faults of a log, how grave, and repairs, counted; means where it is sampled far too fast."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import reduce
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.logs.clock import LONGEST, SHORTEST, Regime, clock_cure, find_regimes
from butterfly.logs.contradictions import find_contradiction
from butterfly.logs.faults import (
    Wrapping,
    clipped,
    cut_by_thousand,
    find_wrapping,
    increasing,
    repeated,
    restarts,
    saturated,
    unwrapped,
)
from butterfly.logs.formats import joined
from butterfly.logs.log import MIN_SAMPLES, InputKind, Intersample, Lead, Log
from butterfly.logs.units import ASSUMED, ColumnReading
from butterfly.model.parameters import JointKind
from butterfly.verdict import Level

GAP_FACTOR = 3.0
"""A sampling interval longer than this many median intervals is a gap."""

SPLIT = "split: restarts in a manifest, or --restarts"
"""What splits a file of several recordings into logs."""

_MANY = 0.01  # share of the samples, or of the time, that may be missing without harm
_LARGEST = 1e30  # of any column, in its own unit: squares and ratios stay within doubles
_SMALLEST = 1e-30  # range of any column that is not constant, and step of the clock
_IF_DEGREES = (
    "If the joint cannot turn that far, the angle may be in degrees or counts: use "
    "--units angle=deg, or units: {angle: deg} in the manifest."
)
_IF_GROUPED = "Export the file without thousands separators, or with more or fewer decimals."
_IF_REGIMES = (
    "The delay may switch with the sampling interval: output-error can fit both, as delay and "
    "slow_delay."
)
_IF_HELD = (
    "A command that changes between two samples of the angle seems to act from the second on: the "
    "delay may be too short by up to one sampling interval."
)


class Repair(StrEnum):
    """A repair of a log: each drops samples, except ``unwrap``, which adds whole turns."""

    DUPLICATE = "duplicate"
    BACKWARD = "backward"
    NON_FINITE = "non_finite"
    UNWRAP = "unwrap"


DEFAULT_REPAIRS = frozenset({Repair.DUPLICATE})
"""Only repeated timestamps are dropped by default; other repairs must be allowed by name."""


class Remark(NamedTuple):
    """A finding, how grave it is, and what to do about it."""

    condition: Level
    text: str
    hint: str = ""


@dataclass(frozen=True, kw_only=True)
class Health:
    """Findings on one log, in samples unless a unit is given."""

    samples: int
    duration: float  # s, last minus first timestamp
    duplicate_stamps: int
    backward_stamps: int
    non_finite: int
    dropped: int  # by repairs
    gaps: int  # intervals above `GAP_FACTOR` medians, bridged by interpolation
    longest_gap: float  # s, the longest interval
    step: float  # s, median interval
    jitter: float  # s, rms deviation from it, without gaps
    saturated: int  # the input flat at its extreme value
    clipped: int  # the angle flat at an extreme that it reached at speed
    idle: int  # of a log with constant input, such as a free decay
    wraps: int = 0  # jumps of the angle by a turn, undone
    turns: float = 0.0  # span of the angle over 2 pi; 0 of a slide
    middle: float = 0.0  # rad, median angle
    cut_lines: int = 0  # incomplete at the end of the file, dropped
    columns: Mapping[str, ColumnReading] = field(default_factory=dict)  # what was read as what
    integrated: bool = False  # whether the angle is the integral of the recorded velocity
    regimes: tuple[Regime, ...] = ()  # of its clock, where the mean interval switches
    contradiction: tuple[str, str] | None = None  # of physics, and what to check
    topics: str = ""  # of a file with a row per topic: how its rows were joined
    unclear: str = ""  # what numbers of the file may mean instead
    driven: bool = True  # whether something drives the joint

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on the log, gravest first; none for a healthy one."""
        others = {name: reading for name, reading in self.columns.items() if reading.has_other_unit}
        lost = self.dropped > _MANY * self.samples
        gone = self.longest_gap > _MANY * self.duration
        counted = [
            (self.saturated, "sample", "with the input saturated", True),
            (self.clipped, "sample", "with the angle clipped", True),
            (self.gaps, "gap", f"bridged, longest {1e3 * self.longest_gap:.1f} ms", gone),
            (self.duplicate_stamps, "repeated timestamp", "dropped", lost),
            (self.backward_stamps, "backward timestamp", "dropped", lost),
            (self.non_finite, "sample", "not finite, dropped", lost),
            (self.wraps, "jump", "by a turn, undone", False),
            (self.cut_lines, "incomplete last line", "dropped", False),
            (self.idle, "sample", "with a constant input", False),
        ]
        remarks = [
            Remark(Level.CARE if care else Level.NOTE, f"{count} {thing}{'s' * (count > 1)} {what}")
            for count, thing, what, care in counted
            if count
        ]
        if self.contradiction:
            remarks.append(Remark(Level.CARE, *self.contradiction))
        if self.topics:
            remarks.append(Remark(Level.NOTE, self.topics, _IF_HELD))
        drive = self.columns.get("input")
        if drive is not None and drive.assumed and self.driven:
            level, cure = (Level.CARE, drive.unread.cure) if drive.unread else (Level.GOOD, "")
            remarks.append(Remark(level, drive.taken, cure))
        if self.unclear:
            remarks.append(Remark(Level.CARE, self.unclear, _IF_GROUPED))
        if self.integrated:
            remarks.append(Remark(Level.NOTE, "no angle recorded: the velocity is fitted instead"))
        for before, (begin, interval) in pairwise(self.regimes):
            text = f"mean sampling interval switches from {1e3 * before.interval:.4g} to "
            text += f"{1e3 * interval:.4g} ms at {begin:.4g} s"
            remarks.append(Remark(Level.NOTE, text, _IF_REGIMES))
        if self.turns > 1.0:
            text = f"the angle spans {self.turns:.1f} turns"
            meant = self.wraps or (
                "angle" in self.columns and self.columns["angle"].unit_source != ASSUMED
            )
            remarks.append(Remark(Level.NOTE, text, "" if meant else _IF_DEGREES))
        if not SHORTEST < self.step <= LONGEST:
            text = f"{'only ' * (self.step > SHORTEST)}one sample every {self.step:.3g} s"
            cure = clock_cure(self.columns.get("time"), self.step)
            remarks.append(Remark(Level.CARE, text, cure))
        if others:
            texts = "; ".join(f"{name}: {reading.text}" for name, reading in others.items())
            remarks.append(Remark(Level.NOTE, f"converted from the file's units: {texts}"))
        return sorted(remarks, key=lambda remark: remark.condition is not Level.CARE)

    @property
    def condition(self) -> Level:
        """Whether the log can be used: the level of its gravest remark."""
        return Level.worst(remark.condition for remark in self.remarks)

    @property
    def findings(self) -> list[str]:
        """The texts of the remarks."""
        return [remark.text for remark in self.remarks]


def examine(log: Log, repairs: Collection[Repair] = DEFAULT_REPAIRS) -> tuple[Log, Health]:
    """Return a log repaired as far as allowed, and its health as recorded; refuse other faults."""
    log, topics = joined(log)
    finite = reduce(np.logical_and, map(np.isfinite, log.columns().values()))
    _refuse_few(log, finite)
    _refuse_unless_allowed(log, ~finite, Repair.NON_FINITE, repairs, "finite numbers")
    sound = _only(log, finite)
    if np.ptp(sound.time) == 0.0:
        raise InputError(log.source, "time", "a clock that never advances", "increasing timestamps")
    mask = increasing(sound.time)
    repeats = repeated(sound.time, mask)
    backward = ~(mask | repeats)
    refuse_separators(sound)
    ascending = "timestamps in ascending order"
    if Repair.BACKWARD not in repairs and backward.any() and restarts(sound.time):
        ascending += f" (or {SPLIT}, if the file holds several recordings)"
    _refuse_unless_allowed(log, backward, Repair.BACKWARD, repairs, ascending)
    _refuse_unless_allowed(log, repeats, Repair.DUPLICATE, repairs, "distinct timestamps")
    clean = _with_sound_lead(_only(sound, mask))
    _refuse_implausible(clean)
    regimes = clean.regimes or find_regimes(clean.time)
    clean = replace(clean, regimes=regimes) if len(regimes) > 1 else clean
    intervals = np.diff(clean.time)
    step = float(np.median(intervals))
    is_gap = intervals > GAP_FACTOR * step
    turning = clean.added_mass.joint is JointKind.HINGE and not clean.integrated
    wrapping = find_wrapping(clean.angle, is_gap) if turning else None
    if wrapping is not None:
        _refuse_wrapped(clean, wrapping, repairs)
        clean = replace(clean, angle=unwrapped(clean.angle, wrapping))
    driven = clean.input_kind is not InputKind.NONE
    regular = intervals[~is_gap] if is_gap.any() else intervals
    health = Health(
        samples=log.time.size,
        duration=float(clean.time[-1] - clean.time[0]),
        duplicate_stamps=int(repeats.sum()),
        backward_stamps=int(backward.sum()),
        non_finite=int((~finite).sum()),
        dropped=log.time.size - clean.time.size,
        gaps=int(is_gap.sum()),
        longest_gap=float(intervals.max()),
        step=step,
        jitter=float(np.sqrt(np.mean((regular - step) ** 2))),
        saturated=saturated(clean.input, clean.time),
        clipped=0 if clean.integrated else clipped(clean.angle),
        idle=clean.time.size if driven and np.ptp(clean.input) == 0 else 0,
        wraps=0 if wrapping is None else wrapping.rows.size,
        turns=float(np.ptp(clean.angle)) / (2 * math.pi) if turning else 0.0,
        middle=float(np.median(clean.angle)),
        cut_lines=log.reading.cut_lines,
        columns=log.reading.columns,
        integrated=log.integrated,
        regimes=clean.regimes,
        contradiction=find_contradiction(clean),
        topics=topics,
        unclear=log.reading.unclear,
        driven=driven,
    )
    return clean, health


def refuse_separators(log: Log) -> None:
    """Raise InputError if timestamps have a thousands separator."""
    if (first := cut_by_thousand(log.time)) is not None:
        value = f"{log.time[first]:g} after {log.time[first - 1]:g} at sample {first}"
        expected = "timestamps without thousands separators (1000, not 1.000 or 1,000)"
        raise InputError(log.source, "time", value, expected)


def _only(log: Log, mask: NDArray[np.bool_]) -> Log:
    """Return the log of some samples; itself for all of them, since long copies cost."""
    return log if mask.all() else log.take(mask)


def _with_sound_lead(log: Log) -> Log:
    """Keep of the command before a piece what has finite values and increasing timestamps."""
    if log.lead is None:
        return log
    time, inputs = log.lead.time, log.lead.input
    sound = np.isfinite(time) & np.isfinite(inputs) & (time < log.time[0])
    sound[sound] = increasing(time[sound]) if sound.any() else False
    return replace(log, lead=Lead(time=time[sound], input=inputs[sound]))


def _refuse_few(log: Log, finite: NDArray[np.bool_]) -> None:
    """Refuse a log with too few rows that have a number in every column."""
    if finite.sum() >= MIN_SAMPLES or finite.all():
        return
    counts = {name: int(np.isfinite(column).sum()) for name, column in log.columns().items()}
    fewest = min(counts, key=counts.__getitem__)
    listing = ", ".join(f"{count} of {name}" for name, count in counts.items())
    value = f"{finite.sum()} rows with a number in every column ({listing})"
    raise InputError(log.source, fewest, value, f"at least {MIN_SAMPLES} such rows")


def _refuse_unless_allowed(
    log: Log, faulty: NDArray[np.bool_], repair: Repair, allowed: Collection[Repair], expected: str
) -> None:
    if repair in allowed or not faulty.any():
        return
    first = int(np.argmax(faulty))
    columns, field = log.columns(), "time"
    if repair is Repair.NON_FINITE:
        field = next(name for name, column in columns.items() if not np.isfinite(column[first]))
    value = f"{columns[field][first]} at sample {first} ({int(faulty.sum())} such samples)"
    try:
        examine(log, frozenset(Repair))
    except InputError as error:
        hint = f"{expected}; without these samples, {error.field} is {error.value}"
    else:
        hint = f"{expected} (to drop them: --repair {repair}, or the manifest's key repair)"
    raise InputError(log.source, field, value, hint)


def _refuse_wrapped(log: Log, wrapping: Wrapping, allowed: Collection[Repair]) -> None:
    if Repair.UNWRAP in allowed and wrapping.exact:
        return
    first = log.time[wrapping.rows[0]]
    value = f"{wrapping.rows.size} jumps by {wrapping.turn:.4g} rad, the first at {first:.6g} s"
    how = f"--repair {Repair.UNWRAP}, or the manifest's key repair"
    hint = f"a continuous angle (to unwrap it: {how})"
    if not wrapping.exact:
        hint = (
            "jumps by a whole turn of the joint, or by 1/N of one: give the angle's unit "
            "(--units angle=counts/N), or unwrap the angle first"
        )
    raise InputError(log.source, "angle", value, hint)


def _refuse_implausible(log: Log) -> None:
    """Refuse a joint at rest, a sine without input, and numbers far out of range."""
    meanings = {log.measures: "a moving joint (exclude this log if the joint rests)"}
    if log.excitation is not None:
        meanings["input"] = "an input that excites the joint"
    for name, meaning in meanings.items():
        column = log.columns()[name]
        if np.ptp(column) == 0.0:
            raise InputError(log.source, name, f"a constant {column[0] + 0.0:g}", meaning)
    for name in ("time", "input", log.measures):
        column = getattr(log, name)
        least, most = float(column.min()), float(column.max())
        largest, span = max(most, -least), most - least
        if largest > _LARGEST:
            expected = f"numbers below {_LARGEST:g}"
            raise InputError(log.source, name, f"numbers up to {largest:.3g}", expected)
        if 0 < span < _SMALLEST:
            value = f"numbers that differ by {span:.3g} at most"
            raise InputError(log.source, name, value, f"a range above {_SMALLEST:g}")
    shortest = float(np.diff(log.time).min())
    if shortest < _SMALLEST:
        expected = f"timestamps more than {_SMALLEST:g} s apart"
        raise InputError(log.source, "time", f"timestamps {shortest:.3g} s apart", expected)


ENOUGH = 4_000_000
"""Samples of a log above which it is averaged: an hour at 1.1 kHz."""

GLANCE = 10_000
"""Samples of a log that a first look needs."""

_SLOW = 0.1  # rad of phase of a motion from one mean to the next
_ROWS = 100_000  # samples that show how fast it is


def thinned(log: Log, enough: int = ENOUGH) -> Log:
    """Return a log of means; itself if it has at most ``enough`` samples or moves fast."""
    block = _block(log.angle, -(-log.time.size // enough))
    if block == 1:
        return log
    share = np.full(block, 1 / block)
    columns = {name: _blocks(values, block) @ share for name, values in log.columns().items()}
    if log.between_samples is Intersample.ZERO_ORDER_HOLD:
        columns["input"] = _held(log, block)
    mask = _without_gap(log.time, block)  # without an incomplete stretch at the end
    means: dict[str, Any] = {name: values[mask] for name, values in columns.items()}
    return replace(log, **means)


def _blocks(values: Samples, block: int) -> Samples:
    count = values.size // block
    return values[: count * block].reshape(count, block)


def _held(log: Log, block: int) -> Samples:
    """Return the held input from one mean to the next that has the same effect.

    It is averaged like the angle, then from mean to mean, with weights that rise over one stretch
    and fall over the next. Input before the first mean acts after it. A sample holds from its
    timestamp: around it, the input is the mean of itself and the one before (0 if none).
    """
    first = 0.0 if log.lead is None or not log.lead.input.size else log.lead.input[-1]
    about = log.input.copy()
    about[1:] += log.input[:-1]
    about[0] += first
    about *= 0.5
    rise = (np.arange(block) + 0.5) / block**2
    stretches = _blocks(about, block)
    rising, falling = stretches @ rise, stretches @ rise[::-1]
    if log.lead is None:
        rising[0] += falling[0]
    return np.asarray(rising + np.append(falling[1:], falling[-1]))


def _without_gap(time: Samples, block: int) -> NDArray[np.bool_]:
    """(n,) whether each stretch is free of gaps (see `butterfly.logs.health`)."""
    intervals = np.diff(time)
    gaps = np.flatnonzero(intervals > GAP_FACTOR * np.median(intervals))
    within = gaps[(gaps + 1) % block > 0] // block
    mask = np.ones(time.size // block, dtype=np.bool_)
    mask[within[within < mask.size]] = False
    return mask


def _block(angle: Samples, wanted: int) -> int:
    """Return how many samples may be averaged into one, at most the wanted number."""
    spread = _SLOW**2 * float(np.var(angle[:: max(1, angle.size // _ROWS)]))
    block = 1
    while block < wanted:
        lag = min(2 * block, wanted)
        rows = slice(0, angle.size - 2 * lag, max(1, angle.size // _ROWS))
        near, far = (np.mean((angle[k * lag :][rows] - angle[rows]) ** 2) for k in (1, 2))
        if far - near > 3 * spread:  # three times the square of a motion's change, 0 of noise
            break
        block = lag
    return block
