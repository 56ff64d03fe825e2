"""Clocks: of files (dates, epochs, intervals), and regimes of a controller's sampling."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.logs.unit_words import factor_of
from butterfly.logs.units import ASSUMED, DATES, GIVEN, ColumnReading, Heading, Words

EXACT = 1 << 53
"""Integers below this are exact as floats; a larger clock counts from its first."""

NANOSECONDS = "nanoseconds"
"""The column beside one of whole seconds, as in ROS's stamps."""

_SECOND = 10**9  # ns
_LATEST = 2**63 // _SECOND - 1  # s that dates in ns hold
_BY_SIZE = "from its size"
_EPOCHS = ("s", "ms", "us", "ns")
_YEARS = (631_152_000.0, 4_102_444_800.0)  # 1990 and 2100 in s since 1970
_DAYS = ((32_874.0, 73_051.0), (726_834.0, 767_011.0))  # the same in days of Excel, of MATLAB
_LONGEST = 60.0  # s between samples, above which an epoch by size is doubted
SHORTEST, LONGEST = 2e-5, 0.25
"""s between the samples of a log in which a joint moves; below these a clock may be one of days."""

_ENOUGH = 1000  # samples that show the step of a clock
_AGREE = 0.01  # relative difference of a clock from the given interval


def with_stamps(
    source: object, columns: Mapping[str, Any], headings: Mapping[str, Heading]
) -> tuple[Mapping[str, Any], Mapping[str, Heading]]:
    """Return columns and headings whose time is dates, where it is whole seconds and nanoseconds.

    They are added as integers. InputError if a number is no such part of a stamp.
    """
    if NANOSECONDS not in columns:
        return columns, headings
    names = [headings[field].name or field for field in ("time", NANOSECONDS)]
    parts = []
    for name, field, most in zip(names, ("time", NANOSECONDS), (_LATEST, _SECOND - 1), strict=True):
        lowest, unit = (-most, "s") if field == "time" else (0, "ns")
        expected = f"whole {unit} from {lowest} to {most}, beside the other part of the time"
        try:
            numbers = np.asarray(columns[field], dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(source, name, "values that are not numbers", expected) from None
        known = np.isfinite(numbers)
        wrong = known & ((numbers % 1 != 0) | (numbers < lowest) | (numbers > most))
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(source, name, f"{numbers[row]:.12g} at sample {row}", expected)
        parts.append(np.where(known, numbers, np.nan))
    there = np.isfinite(parts[0]) & np.isfinite(parts[1])
    seconds, rest = (np.where(there, part, 0).astype(np.int64) for part in parts)
    stamps = (seconds * _SECOND + rest).astype("datetime64[ns]")
    stamps[~there] = np.datetime64("NaT")
    others = {field: column for field, column in columns.items() if field != NANOSECONDS}
    heads = {field: heading for field, heading in headings.items() if field != NANOSECONDS}
    return {**others, "time": stamps}, {**heads, "time": Heading(name=" and ".join(names))}


def with_clock(
    columns: Mapping[str, Any], headings: Mapping[str, Heading], interval: float | None
) -> tuple[Mapping[str, Any], Mapping[str, Heading], float]:
    """Return columns and headings with a numeric clock, and the timestamp it counts from, or 0."""
    if "time" not in columns:
        size = max((np.shape(column)[:1] for column in columns.values()), default=(0,))
        return {**columns, "time": np.arange(*size) * (interval or np.nan)}, headings, 0.0
    try:
        values = np.asanyarray(columns["time"])
    except (TypeError, ValueError):  # told later
        return columns, headings, 0.0
    if values.dtype.kind in "OUST" and (stamps := dates(columns["time"])) is not None:
        values = stamps
    kind, heading = values.dtype.kind, headings["time"]
    there = np.ones(values.shape, dtype=np.bool_)
    if kind in "mM":
        unit = next((u for u in _EPOCHS if u == np.datetime_data(values.dtype)[0]), "ns")
        heading = replace(heading, unit_words=(*heading.unit_words, Words(unit, DATES)))
        values = values.astype(f"{kind}8[{unit}]")
        there, values = ~np.isnat(values), values.astype(np.int64)
    elif kind not in "iu" or values.ndim != 1 or not np.any(np.abs(values[:1]) >= EXACT):
        return columns, headings, 0.0
    first = values[there][:1].sum(dtype=values.dtype)
    numbers = np.where(there, (values - first).astype(np.int64), np.nan)
    return {**columns, "time": numbers}, {**headings, "time": heading}, float(first)


def dates(column: Any) -> NDArray[np.datetime64] | None:  # noqa: ANN401 - texts of any library
    """Return (n,) dates as in ISO 8601, or times of day; None if one is neither."""
    import pyarrow as pa  # noqa: PLC0415 - slow to import
    from pyarrow import compute  # noqa: PLC0415

    try:
        texts = column if isinstance(column, pa.ChunkedArray) else pa.array(column)
        texts = compute.utf8_trim(texts.cast(pa.string()), characters=' \t"')
        texts = compute.replace_substring(texts, pattern=",", replacement=".")
        texts = compute.replace_substring_regex(texts, r"^\d\d:\d\d:", r"1970-01-01 \0")
        texts = compute.if_else(compute.equal(texts, ""), None, texts)
        zone = compute.match_substring_regex(texts, r":\d\d(\.\d+)?(Z|[+-]\d\d(:?\d\d)?)$")
        kind = pa.timestamp("ns", "UTC" if compute.any(zone).as_py() else None)
        return np.asarray(texts.cast(kind).to_numpy(zero_copy_only=False))
    except (pa.ArrowException, OverflowError):
        return None


@np.errstate(over="ignore", invalid="ignore")  # of absurd timestamps
def clock_reading(
    source: object, reading: ColumnReading, first: float, time: Samples
) -> tuple[ColumnReading, float]:
    """Return how a clock is read (an epoch is known by its size), and the start to subtract."""
    finite = time if np.isfinite(time).all() else time[np.isfinite(time)]
    if finite.size <= 1:
        return reading, 0.0
    begin, steps = first or float(finite[0]), np.diff(finite[:_ENOUGH])
    low, step = np.quantile(steps, (0.1, 0.5)).tolist()  # a clock that falls is none
    span = begin, first + float(finite[-1])
    value = f"{begin:.10g}, with {step:.4g} between samples"
    expected = "the unit of time (--units time=... or units: in the manifest)"
    where = reading.name or f"column {reading.number}"
    silent = reading.unit_source == ASSUMED and low >= 0 < step
    days = any(_within(span, limits) for limits in _DAYS)
    if silent and days and step < SHORTEST:
        raise InputError(source, where, value, f"{expected}: days, if these are day numbers")
    for unit in [name for name in _EPOCHS if silent and _within(span, _YEARS, factor_of(name))]:
        if step * factor_of(unit) > _LONGEST:
            raise InputError(source, where, value, f"{expected}: by its size an epoch in {unit}")
        reading = replace(
            reading, unit=f"epoch {unit}", unit_source=_BY_SIZE, factor=factor_of(unit)
        )
    absolute = reading.unit_source != ASSUMED and _within(span, _YEARS, reading.factor)
    absolute |= days and reading.unit == "days"
    return reading, begin if absolute and not first else 0.0


def clock_cure(reading: ColumnReading | None, step: float) -> str:
    """Return how to say the unit that makes a step in s one of a log; "" if none does."""
    if reading is None or reading.unit_source in {DATES, _BY_SIZE} or "interval" in reading.name:
        return ""
    steps = {unit: step / reading.factor * factor_of(unit) for unit in _EPOCHS}
    unit = next((name for name, interval in steps.items() if SHORTEST < interval < LONGEST), None)
    if unit is None:
        return ""
    given = unit if reading.unit_source in {ASSUMED, GIVEN} else f"{factor_of(unit):g}"
    return (
        f"Time may be in {unit}: use --units time={given}, or units: {{time: {given}}} in the "
        "manifest."
    )


def _within(span: Iterable[float], limits: tuple[float, float], factor: float = 1.0) -> bool:
    return all(limits[0] <= instant * factor < limits[1] for instant in span)


def interval_reading(
    source: object, interval: float, reading: ColumnReading | None, time: Samples
) -> ColumnReading:
    """Return how the clock of a given interval in s is read; refuse a column that differs."""
    if reading is None:
        name = f"interval {interval:g} s"
        return ColumnReading(name=name, number=None, unit="s", unit_source=GIVEN, factor=1.0)
    step = float(np.median(np.diff(time)))
    if not abs(step - interval) <= _AGREE * interval:
        value = f"{interval:g} s, and a column of time with {step:.4g} s between samples"
        raise InputError(source, "interval", value, "one of the two, or two that agree")
    return reading


_GAP = 3.0  # median intervals, above which one is a gap
_BLOCK = 32  # intervals per mean,
_MOST = 1000  # and means per piece at most
_LEAST = 16  # means of a regime
_WHOLE = 200.0  # of the statistic; of a million even clocks fewer than 200 come to 138
_NEAR = 80.0  # of the statistic over so many means on either side,
_BESIDE = 32
_STEP = 0.01  # of the interval, that counts as a change
_SMOOTH = 5  # degree of a drift,
_LESS = 0.95  # and the residual squares of a step over its own, at most
_HALVES = 2  # of a piece without a switch, as two may cancel


class Regime(NamedTuple):
    """A stretch of a log: its beginning in s, and its mean sampling interval in s."""

    begin: float
    interval: float


def find_regimes(time: Samples) -> tuple[Regime, ...]:
    """Return the regimes of (n,) increasing timestamps in s, at least one."""
    intervals = np.diff(time)
    even = intervals <= _GAP * np.median(intervals)
    regular = intervals if even.all() else intervals[even]
    switches = _switches(regular)
    edges = [0, *switches, regular.size]
    first = [0, *(np.flatnonzero(even)[switches] if switches else ())]
    return tuple(
        Regime(float(time[row]), float(regular[begin:end].mean()))
        for row, (begin, end) in zip(first, pairwise(edges), strict=True)
    )


def between_regimes(logs: Sequence[tuple[Regime, ...]], ends: Iterable[float]) -> float:
    """Return an interval between fast and slow regimes (Otsu, IEEE Trans. SMC 9, 1979), or 0."""
    if all(len(regimes) == 1 for regimes in logs):
        return 0.0
    stretches = sorted(
        (here.interval, after - here.begin)
        for regimes, end in zip(logs, ends, strict=True)
        for here, after in zip(
            regimes, [*(regime.begin for regime in regimes[1:]), end], strict=True
        )
    )
    interval, weight = np.array(stretches).T
    fast, slow = np.cumsum(weight)[:-1], np.cumsum(weight[::-1])[-2::-1]
    sums = np.cumsum(weight * interval)
    lower, upper = sums[:-1] / fast, (sums[-1] - sums[:-1]) / slow
    best = int(np.argmax(fast * slow * (upper - lower) ** 2))
    return float(lower[best] + upper[best]) / 2


def _switches(intervals: Samples) -> list[int]:
    """Return the numbers of the intervals at which a regime begins, except the first."""
    switches, waiting = [], [(0, intervals.size, 0)]
    while waiting:
        begin, end, halved = waiting.pop()
        if end - begin < 2 * _LEAST * _BLOCK:
            continue
        cut = _switch(intervals[begin:end])
        if cut is not None:
            switches.append(begin + cut)
        elif halved == _HALVES:
            continue
        middle = begin + (cut or (end - begin) // 2)
        halvings = halved + (cut is None)
        waiting += [(begin, middle, halvings), (middle, end, halvings)]
    switches.sort()
    while True:  # drop the smallest false switch
        pieces = np.split(intervals, switches)
        wrong = [
            (abs(before.mean() - after.mean()), number)
            for number, (before, after) in enumerate(pairwise(pieces))
            if not _is_step(before, after)
        ]
        if not wrong:
            return switches
        del switches[min(wrong)[1]]


def _switch(intervals: Samples) -> int | None:
    """Return the number of the interval at which the mean changes, if it does."""
    block = _length(intervals.size)
    if not _changes(_means(intervals, block))[_LEAST - 1 : -_LEAST].max(initial=0.0) > _WHOLE:
        return None
    sums = np.cumsum(intervals - intervals.mean())[:-1]
    count = np.arange(1, intervals.size)
    least = _LEAST * block - 1
    contrast = np.abs(sums) / np.sqrt(count * (intervals.size - count))
    return int(np.argmax(contrast[least:-least])) + least + 1


def _is_step(before: Samples, after: Samples) -> bool:
    """Whether two pieces differ by a step, also close by, and not by a drift."""
    means = before.mean(), after.mean()
    if abs(means[1] - means[0]) <= _STEP * min(means):
        return False
    block = _length(before.size + after.size)
    early, late = _means(before[before.size % block :], block), _means(after, block)
    near = min(_BESIDE, early.size, late.size)
    if not _changes(np.concatenate([early[early.size - near :], late[:near]]))[near - 1] > _NEAR:
        return False
    both = np.concatenate([early, late])
    drift, _ = np.linalg.qr(legendre.legvander(np.linspace(-1, 1, both.size), _SMOOTH))
    smooth = both - drift @ (drift.T @ both)
    return bool(early.size * early.var() + late.size * late.var() < _LESS * (smooth @ smooth))


def _length(count: int) -> int:
    return max(_BLOCK, count // _MOST)


def _means(intervals: Samples, block: int) -> Samples:
    """Return the means of whole blocks."""
    count = intervals.size // block
    return np.asarray(intervals[: count * block].reshape(count, block).mean(axis=1))


def _changes(values: Samples) -> Samples:
    """(n - 1,) self-normalised statistics: the mean of (n,) values changes after each of them."""
    values = values - values.mean()
    sums, before = _partial(values)
    _, after = _partial(values[::-1])
    spread = (before[:-1] + after[-2::-1]) / values.size**2
    floor: float = np.finfo(float).tiny
    return np.asarray(sums[:-1] ** 2 / values.size / np.maximum(spread, floor))


def _partial(values: Samples) -> tuple[Samples, Samples]:
    """Return (n,) partial sums, and the sums of their squares about the line of their mean."""
    count = np.arange(1.0, values.size + 1)
    sums = np.cumsum(values)
    line = sums / count
    squares = np.cumsum(sums**2) - 2 * line * np.cumsum(count * sums)
    return sums, squares + line**2 * np.cumsum(count**2)
