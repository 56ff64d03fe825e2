"""Simulate, and differentiate what was simulated by the parameters: forward sensitivities.

The derivatives are those of the discrete simulation, not of the equation: exact at reversals of the
velocity, while the joint sticks and where it breaks loose, so that they agree with differences of
simulations as far as rounding lets them (Maly & Petzold, Applied Numerical Mathematics 20, 1996;
Galan, Feehery & Barton, Applied Numerical Mathematics 31, 1999, for the jumps).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from butterfly.errors import InputError, nearest
from butterfly.model.kernel import COLUMNS, Constants, follow
from butterfly.model import kernel
from butterfly.model.parameters import NO_ADDED_MASS
from butterfly.model.terms import TERMS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from butterfly.model.parameters import AddedMass, LumpedParameters

    Samples = NDArray[np.float64]

INITIAL = ("zero", "velocity")
"""What moves the beginning of a simulation: the encoder's zero in rad, the velocity in rad/s."""

_DRIVES = {
    name: len(COLUMNS) + number for number, name in enumerate(("p4", "delay", "compression"))
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Columns:
    """Which k columns the kernel carries, and how n parameters are made of them.

    Parameters
    ----------
    column
        (k,) numbers of the kernel's constants (see `butterfly.model.kernel.COLUMNS`) and drives.
    initial
        (4, k) derivatives of the initial state.
    mixture
        (k, n) derivatives of what the columns stand for by the parameters.
    """

    column: NDArray[np.int64]
    initial: Samples
    mixture: Samples

    @classmethod
    def of(
        cls, names: Sequence[str], parameters: LumpedParameters, added: AddedMass = NO_ADDED_MASS
    ) -> Columns:
        """Return the columns for some parameters of the bare hand that carries ``added``.

        Parameters
        ----------
        names
            Of n parameters, and of `INITIAL`.
        parameters
            Of the bare hand.
        added
            What it carries.

        Raises
        ------
        InputError
            If a name is unknown, or the model has no derivative by it at these values.
        """
        parts = [_parts(name, parameters, added) for name in names]
        different = list(dict.fromkeys(key for part in parts for key in part))
        mixture = np.zeros((len(different), len(names)))
        for column, part in enumerate(parts):
            for key, share in part.items():
                mixture[different.index(key), column] = share
        numbers = COLUMNS | _DRIVES
        initial = np.zeros((4, len(different)))
        for state, name in enumerate(INITIAL):
            if name in different:
                initial[state, different.index(name)] = -1.0 if name == "zero" else 1.0
        column = np.array([numbers.get(key, -1) for key in different], dtype=np.int64)
        return cls(column=column, initial=initial, mixture=mixture)

    @property
    def drives(self) -> int:
        """How many derivatives of the drive are needed, of those by p4, delay and compression."""
        return max(int(self.column.max(initial=-1)) + 1 - len(COLUMNS), 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """What is read off a simulation: m sums over the state at both ends of single intervals.

    Parameters
    ----------
    into
        (n - 1,) number of the sum that an interval gives; -1 for none.
    weights
        (4, m) of angle and velocity at the start, and of those at the end.
    """

    into: NDArray[np.int64]
    weights: Samples

    @classmethod
    def angles(cls, count: int) -> Readings:
        """Return those of the angle at the end of each of ``count`` intervals."""
        weights = np.zeros((4, count))
        weights[2] = 1.0
        return cls(into=np.arange(count), weights=weights)


def read_off(
    parameters: LumpedParameters,
    time: Samples,
    inputs: Samples,
    start: tuple[float, float],
    readings: Readings,
) -> Samples:
    """Simulate as `butterfly.model.greybox.simulate` does, and return the (m,) readings.

    Parameters
    ----------
    parameters
        Of the hand with its added mass.
    time, inputs
        As `butterfly.model.greybox.simulate` takes them.
    start
        Initial angle in rad and velocity in rad/s.
    readings
        What is read off.
    """
    values = np.empty(readings.weights.shape[1])
    drives, constants = parameters.p4 * inputs, Constants.of(parameters)
    state = (*start, 0.0, 0.0)
    follow(time, drives, state, constants, readings.into, readings.weights, values)
    return values


def differentiate(
    parameters: LumpedParameters,
    time: Samples,
    inputs: Samples,
    start: tuple[float, float],
    readings: Readings,
    columns: Columns,
    moved: Samples,
) -> tuple[Samples, Samples]:
    """Return the readings of `read_off`, and their (m, k) derivatives by the columns.

    Parameters
    ----------
    parameters, time, inputs, start, readings
        As there.
    columns
        Of the same hand.
    moved
        (n - 1, q, 3) derivatives of p4 times the inputs, by the q of `Columns.drives`.
    """
    values = np.empty(readings.weights.shape[1])
    rows = np.empty((values.size, columns.column.size))
    drives, constants = parameters.p4 * inputs, Constants.of(parameters)
    state = (*start, 0.0, 0.0)
    kernel.differentiate(
        *(time, drives, state, constants, readings.into, readings.weights, values),
        *(columns.column, columns.initial, moved, rows),
    )
    return values, rows


def _parts(name: str, p: LumpedParameters, added: AddedMass) -> dict[str, float]:
    """Return the derivatives of the kernel's constants and drives by one parameter."""
    if name in {*INITIAL, *_DRIVES}:
        return {name: 1.0}
    if name not in TERMS:
        raise InputError("sensitivities", "parameter", name, nearest(name, (*TERMS, *INITIAL)))
    loaded = p.with_added_mass(added)
    slipping = {"coulomb": 1.0} if loaded.coulomb >= 0 else {}
    pushes = loaded.stribeck < -max(loaded.coulomb, 0.0)  # friction then is none, not negative
    if pushes and slipping:
        slipping["stribeck"] = -1.0
    match name:
        case "p2":
            return {"viscous": 1.0}
        case "back_emf":
            return {"back_emf": 1.0, "viscous": -1.0}
        case "coulomb":
            return slipping
        case "load":
            return {key: share * added.weight for key, share in slipping.items()}
        case "stribeck":
            return {} if pushes else {"stribeck": 1.0}
        case "tilt":
            return {"p3": -added.gravity_moment * math.sin(p.tilt)}
        case "time_constant":
            _require_state(name, p.time_constant, "a lag is none: the current follows at once")
            return {"lag": 1.0}
        case "bristle_stiffness" | "bristle_damping":
            _require_state("bristle_stiffness", Constants.of(loaded).bristle_stiffness, "rigid")
            return {name: 1.0}
    return {name: 1.0}


def _require_state(name: str, value: float, why: str) -> None:
    if not value > 0:
        raise InputError("sensitivities", name, value, f"more than 0, to be differentiated ({why})")
