"""What is wrong with a log, and the repairs that were made to it, counted."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError
from butterfly.logs.clipping import clipped, saturated
from butterfly.logs.log import Lead, Log
from butterfly.logs.plausible import refuse_implausible
from butterfly.logs.remarks import Remark, remarks_on
from butterfly.logs.stamps import increasing, repeated, restarts
from butterfly.logs.turns import Wrapping, find_wrapping, unwrapped
from butterfly.model.parameters import JointKind
from butterfly.verdict import Level

GAP_FACTOR = 3.0
"""A sampling interval longer than this many median intervals is a gap."""


class Repair(StrEnum):
    """A repair that may be made to a log, and is counted: each drops the samples concerned.

    But for ``unwrap``, which adds the turns by which an angle falls back where the joint goes on.
    """

    DUPLICATE = "duplicate"
    BACKWARD = "backward"
    NON_FINITE = "non_finite"
    UNWRAP = "unwrap"


SPLIT = "split: restarts in a manifest, or --restarts"
"""What makes a log of each of several recordings."""

DEFAULT_REPAIRS = frozenset({Repair.DUPLICATE})
"""Only repeated stamps are dropped unasked; anything else must be allowed by name."""


@dataclass(frozen=True, kw_only=True)
class Health:
    """Findings on one log, counted in samples unless said otherwise.

    Parameters
    ----------
    samples, duration
        Recorded samples, and last minus first stamp in s.
    duplicate_stamps, backward_stamps, non_finite
        Samples whose stamp repeats, or precedes, an earlier one; samples with a value that is not
        a number.
    dropped
        Samples removed by repairs.
    gaps, longest_gap
        Intervals above `GAP_FACTOR` medians (bridged by interpolation), and the longest interval
        in s.
    step, jitter
        Median sampling interval, and rms deviation from it (gaps left out), in s.
    saturated
        Samples that the input spends flat on its own extreme value.
    clipped
        Samples that the angle spends on a flat top it ran into at speed.
    idle
        Samples of a log whose input never changes, as in a free decay.
    wraps
        Jumps of the angle by a turn, which were undone.
    turns
        How many times the joint turns round: the span of the angle over 2 pi; 0 of a slide.
    middle
        Median angle in rad.
    cut_lines
        Lines at the end of the file that were cut off, and dropped.
    units
        Units, other than the project's, that the file itself gives to its columns.
    """

    samples: int
    duration: float
    duplicate_stamps: int
    backward_stamps: int
    non_finite: int
    dropped: int
    gaps: int
    longest_gap: float
    step: float
    jitter: float
    saturated: int
    clipped: int
    idle: int
    wraps: int = 0
    turns: float = 0.0
    middle: float = 0.0
    cut_lines: int = 0
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def remarks(self) -> list[Remark]:
        """What is to be said of the log, worst first; nothing of a healthy one."""
        return remarks_on(self)

    @property
    def condition(self) -> Level:
        """What may be done with the log."""
        return Level.worst(remark.condition for remark in self.remarks)

    @property
    def findings(self) -> list[str]:
        """The same in words alone."""
        return [remark.text for remark in self.remarks]


def examine(log: Log, repairs: Collection[Repair] = DEFAULT_REPAIRS) -> tuple[Log, Health]:
    """Check a log, make the allowed ``repairs`` and count them.

    Returns
    -------
    Log, Health
        The log with strictly increasing stamps and finite values, and the record of what was
        found in the log as recorded.

    Raises
    ------
    InputError
        If the log has a fault that ``repairs`` does not allow to be repaired, if its time does
        not advance, if its angle never changes, or its sine's input.
    """
    finite = reduce(np.logical_and, map(np.isfinite, log.columns().values()))
    _refuse_unless_allowed(log, ~finite, Repair.NON_FINITE, repairs, "finite numbers")
    sound = _only(log, finite)
    if np.ptp(sound.time) == 0.0:
        raise InputError(log.source, "time", "a clock that never advances", "increasing stamps")
    kept = increasing(sound.time)
    repeats = repeated(sound.time, kept)
    backward = ~(kept | repeats)
    ascending = "stamps in ascending order"
    if Repair.BACKWARD not in repairs and backward.any() and restarts(sound.time):
        ascending += f" (or {SPLIT}, where several recordings were put together)"
    _refuse_unless_allowed(log, backward, Repair.BACKWARD, repairs, ascending)
    _refuse_unless_allowed(log, repeats, Repair.DUPLICATE, repairs, "stamps that differ")
    clean = _with_sound_lead(_only(sound, kept))
    _refuse_constant(clean)
    refuse_implausible(clean)
    intervals = np.diff(clean.time)
    step = float(np.median(intervals))
    is_gap = intervals > GAP_FACTOR * step
    turning = clean.added_mass.joint is JointKind.HINGE
    wrapping = find_wrapping(clean.angle, is_gap) if turning else None
    if wrapping is not None:
        _refuse_wrapped(clean, wrapping, repairs)
        clean = replace(clean, angle=unwrapped(clean.angle, wrapping))
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
        saturated=saturated(clean.input),
        clipped=clipped(clean.angle),
        idle=clean.time.size if np.ptp(clean.input) == 0 else 0,
        wraps=0 if wrapping is None else wrapping.rows.size,
        turns=float(np.ptp(clean.angle)) / (2 * math.pi) if turning else 0.0,
        middle=float(np.median(clean.angle)),
        cut_lines=log.reading.cut_lines,
        units=log.reading.units,
    )
    return clean, health


def _only(log: Log, kept: NDArray[np.bool_]) -> Log:
    """Return the log of some samples, itself if that is all of them: copies of long logs cost."""
    return log if kept.all() else log.take(kept)


def _with_sound_lead(log: Log) -> Log:
    """Return a piece with what of the command before it has finite values and rising stamps."""
    if log.lead is None:
        return log
    time, inputs = log.lead.time, log.lead.input
    sound = np.isfinite(time) & np.isfinite(inputs) & (time < log.time[0])
    sound[sound] = increasing(time[sound]) if sound.any() else False
    return replace(log, lead=Lead(time=time[sound], input=inputs[sound]))


def _refuse_unless_allowed(
    log: Log,
    faulty: NDArray[np.bool_],
    repair: Repair,
    allowed: Collection[Repair],
    expected: str,
) -> None:
    if repair in allowed or not faulty.any():
        return
    first = int(np.argmax(faulty))
    field = "time" if repair is not Repair.NON_FINITE else _first_not_finite(log, first)
    value = f"{log.columns()[field][first]} at sample {first} ({int(faulty.sum())} such samples)"
    hint = f"{expected} (or allow the repair {repair.value!r}, which drops and counts them: "
    hint += f"{_how(repair)})"
    raise InputError(log.source, field, value, hint)


def _how(repair: Repair) -> str:
    return f"--repair {repair}, or the manifest's key repair"


def _refuse_wrapped(log: Log, wrapping: Wrapping, allowed: Collection[Repair]) -> None:
    if Repair.UNWRAP in allowed and wrapping.exact:
        return
    first = log.time[wrapping.rows[0]]
    value = f"{wrapping.rows.size} jumps by {wrapping.turn:.4g} rad, the first at {first:.6g} s"
    hint = "an angle that goes on beyond a turn (or allow the repair 'unwrap', which undoes and "
    hint += f"counts them: {_how(Repair.UNWRAP)})"
    if not wrapping.exact:
        hint = (
            "jumps by whole turns of the joint, or a whole share of one: tell the angle's unit "
            "(--units angle=counts/N), or undo the jumps before"
        )
    raise InputError(log.source, "angle", value, hint)


def _first_not_finite(log: Log, row: int) -> str:
    return next(name for name, column in log.columns().items() if not np.isfinite(column[row]))


def _refuse_constant(log: Log) -> None:
    """Refuse a joint that does not move, and a sine that is none; a free decay has no input."""
    meanings = {"angle": "a moving joint (a log of one at rest is to be left out)"}
    if log.excitation is not None:
        meanings["input"] = "an input that excites the joint"
    for name, meaning in meanings.items():
        column = log.columns()[name]
        if np.ptp(column) == 0.0:
            raise InputError(log.source, name, f"a constant {column[0] + 0.0:g}", meaning)
