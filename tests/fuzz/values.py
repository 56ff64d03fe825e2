"""Logs that are whole files of senseless numbers, as `inspect` and `identify` take them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.fuzz.escape import escape_of_command
from tests.independent.integrator import Joint, motion

Table = NDArray[np.float64]

_JOINT = Joint(inertia=0.011, viscous=0.01, gravity=0.3, gain=0.05)
_METHODS = ("auto", "output-error", "weak-form", "harmonic-balance", "linear")


def _sound(rng: np.random.Generator) -> Table:
    """Time, input and angle of a joint that swings; columns t, u, q."""
    time = 0.005 * np.arange(int(rng.integers(20, 1500)))
    inputs = np.sin(rng.uniform(1, 8) * time) * (rng.random() > 0.2)
    angles, _ = motion(_JOINT, time, inputs, float(rng.choice([0.0, 0.4])))
    return np.column_stack([time, inputs, np.round(angles, 4)])


def _sized(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(low, high))


def _holed(column: Table, rng: np.random.Generator) -> Table:
    column[rng.integers(len(column), size=3)] = rng.choice([np.nan, np.inf, -np.inf, 1e308, 0.0])
    return column


def _constant(column: Table, rng: np.random.Generator) -> Table:
    first = rng.integers(len(column))
    column[first:] = column[first]
    return column


def _coarse(column: Table, rng: np.random.Generator) -> Table:
    step = abs(_sized(rng, -3, 2))
    return np.round(column / step) * step


_OF_A_COLUMN: tuple[Callable[[Table, np.random.Generator], Table], ...] = (
    lambda column, rng: column * _sized(rng, -300, 300),
    lambda column, rng: column * rng.choice([1e-3, 1e3, 1e6, 180 / np.pi, -1.0, 650.0]),
    lambda column, rng: column + _sized(rng, -3, 20),
    lambda column, rng: column + _sized(rng, -4, 3) * rng.normal(size=len(column)),
    *(_holed, _constant, _coarse),
)
_OF_A_TABLE: tuple[Callable[[Table, np.random.Generator], Table], ...] = (
    lambda table, rng: table[:, rng.permutation(3)],
    lambda table, rng: np.roll(table, rng.integers(len(table)), axis=0),
    lambda table, rng: table[: rng.integers(1, len(table) + 1)],
    lambda table, rng: np.repeat(table, rng.integers(1, 4), axis=0),
)


@np.errstate(over="ignore", invalid="ignore")
def _senseless(rng: np.random.Generator) -> Table:
    table = _sound(rng)
    for _ in range(rng.integers(1, 3)):
        if rng.random() < 0.4:
            table = _OF_A_TABLE[rng.integers(len(_OF_A_TABLE))](table, rng)
        else:
            column, way = rng.integers(3), _OF_A_COLUMN[rng.integers(len(_OF_A_COLUMN))]
            table[:, column] = way(table[:, column], rng)
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
