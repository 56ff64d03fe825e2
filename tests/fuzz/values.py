"""Logs that are whole files of senseless numbers, as `inspect` and `identify` take them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.fuzz.escape import escape_of_command

Table = NDArray[np.float64]

_P1, _P2, _P3, _P4 = 0.011, 0.01, 0.3, 0.05
_METHODS = ("auto", "output-error", "weak-form", "harmonic-balance", "linear")


def _sound(rng: np.random.Generator) -> Table:
    """Time, input and angle of a joint that swings, by a method of its own; columns t, u, q."""
    step, count = 0.005, int(rng.integers(20, 1500))
    time = step * np.arange(count)
    inputs = np.sin(rng.uniform(1, 8) * time) * (rng.random() > 0.2)
    angle, speed = rng.choice([0.0, 0.4]), 0.0
    angles = np.empty(count)
    for k in range(count):
        angles[k] = angle
        torque = _P4 * inputs[k] - _P2 * speed - _P3 * np.sin(angle)
        speed += step * torque / _P1
        angle += step * speed
    return np.column_stack([time, inputs, np.round(angles, 4)])


def _scaled(table: Table, rng: np.random.Generator) -> Table:
    table[:, rng.integers(3)] *= rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-300, 300)
    return table


def _in_other_units(table: Table, rng: np.random.Generator) -> Table:
    table[:, rng.integers(3)] *= rng.choice([1e-3, 1e3, 1e6, 180 / np.pi, -1.0, 650.0])
    return table


def _shifted(table: Table, rng: np.random.Generator) -> Table:
    table[:, rng.integers(3)] += rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-3, 20)
    return table


def _holed(table: Table, rng: np.random.Generator) -> Table:
    rows = rng.integers(len(table), size=rng.integers(1, 5))
    table[rows, rng.integers(3)] = rng.choice([np.nan, np.inf, -np.inf, 1e308, -1e150, 0.0])
    return table


def _constant(table: Table, rng: np.random.Generator) -> Table:
    first = rng.integers(len(table) - 1)
    table[first:, rng.integers(3)] = table[first, rng.integers(3)]
    return table


def _swapped(table: Table, rng: np.random.Generator) -> Table:
    return table[:, rng.permutation(3)]


def _torn(table: Table, rng: np.random.Generator) -> Table:
    first = rng.integers(len(table))
    return np.concatenate([table[first:], table[:first]])


def _cut(table: Table, rng: np.random.Generator) -> Table:
    return table[: rng.integers(1, len(table) + 1)]


def _repeated(table: Table, rng: np.random.Generator) -> Table:
    return np.repeat(table, rng.integers(1, 4), axis=0)


def _coarse(table: Table, rng: np.random.Generator) -> Table:
    column, step = rng.integers(3), 10.0 ** rng.uniform(-3, 2)
    table[:, column] = np.round(table[:, column] / step) * step
    return table


def _noisy(table: Table, rng: np.random.Generator) -> Table:
    table[:, rng.integers(3)] += 10.0 ** rng.uniform(-4, 3) * rng.normal(size=len(table))
    return table


_MISFORTUNES: tuple[Callable[[Table, np.random.Generator], Table], ...] = (
    *(_scaled, _in_other_units, _shifted, _holed, _constant, _swapped),
    *(_torn, _cut, _repeated, _coarse, _noisy),
)


@np.errstate(over="ignore", invalid="ignore")
def _senseless(rng: np.random.Generator) -> Table:
    table = _sound(rng)
    for _ in range(rng.integers(1, 3)):
        table = _MISFORTUNES[rng.integers(len(_MISFORTUNES))](table, rng)
    return table


def escapes(content: bytes, path: Path) -> str:
    """Write a log of numbers that the content decides on, and look at it as a user would."""
    rng = np.random.default_rng(list(content))
    table = _senseless(rng)
    path = path.with_suffix(".csv")
    rows = "\n".join(",".join(map(repr, row)) for row in table.tolist())
    path.write_text(f"time,input,angle\n{rows}\n", encoding="utf-8")
    repairs = ["--repair", "backward", "--repair", "non_finite"] * bool(rng.integers(2))
    method = ["--method", _METHODS[rng.integers(len(_METHODS))]]
    known = ["--known", rng.choice(["p4=0.05", "p3=0.3+-0.01", "p1=0.011,p2=0"])]
    looks = [("inspect", path, *repairs), ("identify", path, *repairs, *method, *known)]
    found = (escape_of_command(*words) for words in looks)
    return next(filter(None, found), "")
