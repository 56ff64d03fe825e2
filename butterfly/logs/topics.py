"""Tables with a row per topic: a row holds the command, the angle or the supply, and rarely all."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.logs.log import MIN_SAMPLES, InputKind, Intersample, Log


def joined(log: Log) -> tuple[Log, str]:
    """Return a log in the rows of its measured column, and what was done where these lack another.

    The last value of a column is held (of an input with a first-order hold: interpolated) if most
    of these rows lack it; rows before the first input are left out. InputError if the rows are in
    no order of time.
    """
    clock, columns = np.isfinite(log.time), log.columns()
    measured = clock & np.isfinite(log.measured)
    there = {name: clock & np.isfinite(column) for name, column in columns.items()}
    lacking = {name: int((measured & ~mask).sum()) for name, mask in there.items() if mask.any()}
    lacking.pop("time", None)
    if log.input_kind is InputKind.NONE:
        lacking.pop("input", None)
    sparse = {name: count for name, count in lacking.items() if 2 * count > measured.sum()}
    if not sparse:
        return log, ""
    for name, count in sparse.items():
        if any(np.any(np.diff(log.time[mask]) < 0) for mask in (measured, there[name])):
            problem = f"nothing in {count} of {measured.sum()} rows with the {log.measures}"
            expected = "rows in ascending order of time, so that its last value can be held"
            raise InputError(log.source, name, problem, expected)
    rows = measured
    if "input" in sparse:
        time, inputs = log.command
        rows = measured & (log.time >= time[np.isfinite(time) & np.isfinite(inputs)].min())
    if rows.sum() < MIN_SAMPLES:
        problem = f"{rows.sum()} rows with the {log.measures} after the first input"
        raise InputError(log.source, "input", problem, f"at least {MIN_SAMPLES}")
    straight = log.between_samples is Intersample.FIRST_ORDER_HOLD
    joint: dict[str, Any] = {name: column[rows] for name, column in columns.items()}
    for name in sparse:
        every = log.command if name == "input" else (log.time, columns[name])
        line = straight and name == "input"
        joint[name] = _filled(joint["time"], joint[name], *every, straight=line)
    how = "interpolated" if straight and "input" in sparse else "held"
    listing = ", ".join(f"{name} in {count} samples" for name, count in sparse.items())
    return replace(log, **joint), f"a row per topic: {how} between its rows: {listing}"


def _filled(
    time: Samples, values: Samples, clock: Samples, every: Samples, *, straight: bool
) -> Samples:
    """Return (n,) values; where missing, the last one of every row, or the interpolated one."""
    there = np.isfinite(clock) & np.isfinite(every)
    known, numbers = clock[there], every[there]
    last = np.maximum(np.searchsorted(known, time, "right") - 1, 0)
    filling = np.interp(time, known, numbers) if straight else numbers[last]
    return np.where(np.isfinite(values), values, filling)
