"""Clocks of files: dates, epochs, day numbers, or a known sampling interval in place of a clock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.logs.unit_words import factor_of
from butterfly.logs.units import ASSUMED, DATES, GIVEN, ColumnReading, Heading, Words

EXACT = 1 << 53
"""Integers below this are exact as floats; a larger clock counts from its first."""

_BY_SIZE = "from its size"
_EPOCHS = ("s", "ms", "us", "ns")
_YEARS = (631_152_000.0, 4_102_444_800.0)  # 1990 and 2100 in s since 1970
_DAYS = ((32_874.0, 73_051.0), (726_834.0, 767_011.0))  # the same in days of Excel, of MATLAB
_LONGEST = 60.0  # s between samples, above which an epoch by size is doubted
SHORTEST, LONGEST = 2e-5, 0.25
"""s between the samples of a log in which a joint moves; below these a clock may be one of days."""

_ENOUGH = 1000  # samples that show the step of a clock
_AGREE = 0.01  # relative difference of a clock from the given interval


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
