"""The grey-box model, with set-valued Coulomb friction: compiled simulation, and its derivatives.

The derivatives are those of the discrete simulation, not of the equation. They are exact at
reversals of the velocity, while the joint sticks and where it breaks loose, and agree with
differences of simulations up to rounding (Maly & Petzold, Applied Numerical Mathematics 20, 1996;
for the jumps Galan, Feehery & Barton, Applied Numerical Mathematics 31, 1999).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from butterfly.arrays import Samples
from butterfly.errors import InputError, nearest
from butterfly.model.kernel import differentiate as kernel
from butterfly.model.kernel.equation import COLUMNS, DRIVES, MOST_STEPS, Constants
from butterfly.model.kernel.integrate import begin_to_give, integrate, integrate_loop, steps_at
from butterfly.model.kernel.servo_loop import MEMORY, Loop
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters, first_moments
from butterfly.model.terms import (
    BASE_TERMS,
    BEYOND_MUJOCO,
    DRIVE,
    FIXED_BASE,
    LOOP_TERMS,
    TERMS,
)

INITIAL = {"zero": -1.0, "velocity": 1.0}
"""Parameters of the initial state, the encoder zero in rad and the velocity in rad/s, and the
derivatives of the initial angle and velocity by them."""


DERIVED = ("viscous", "lag", "coulomb", "stribeck", "bristle_stiffness")
OF_BASE = ("give", "swing", "slow", "moment", "moment_offset")
"""Constants of the equation that follow from parameters: see the next two functions."""


def derived(p: Any) -> tuple[float, ...]:  # noqa: ANN401 - also translated
    """Return the derived constants of the joint."""
    coulomb = max(p.coulomb, 0.0)
    return (
        p.p2 - p.back_emf,
        p.time_constant,
        coulomb,
        max(p.stribeck, -coulomb),
        p.bristle_stiffness if coulomb > 0 else 0.0,
    )


def of_base(p: Any) -> tuple[float, ...]:  # noqa: ANN401 - also translated
    """Return the derived constants of a moving base."""
    w = p.base_frequency
    moment, moment_offset = first_moments(p)
    return p.base_compliance, 1 / w**2, 2 * p.base_damping / w, moment, moment_offset


_IN_ORDER = itemgetter(*Constants._fields)


def constants_of(p: LumpedParameters, *, moving: bool | None = None) -> Constants:
    """Return the constants of the equation with the parameters of the loaded joint.

    Those of a moving base are 0 unless it moves, or is ``moving`` for its derivatives. An estimator
    may try negative friction under a load; it counts as 0, since it would drive the motion.
    Bristles without Coulomb friction are ignored.
    """
    constants = dict(zip(DERIVED, derived(p), strict=True)) | {"geared": p.geared}
    gives = of_base(p) if moving or p.base_gives else (0.0,) * len(OF_BASE)
    constants |= dict(zip(OF_BASE, gives, strict=True))
    return Constants(*map(float, _IN_ORDER(vars(p) | constants)))


class Simulated(NamedTuple):
    """A simulation: its motion, and the work that it took."""

    angle: Samples  # (n,) rad
    velocity: Samples  # (n,) rad/s
    steps: int


def simulate(  # noqa: PLR0917 - a robot, where and how it is driven, and from where on
    parameters: LumpedParameters,
    time: Samples,
    inputs: Samples,
    angle: float,
    velocity: float = 0.0,
    loop: Loop | None = None,
) -> tuple[Samples, Samples]:
    """Return the angles and velocities of `simulate_counted`."""
    return simulate_counted(parameters, time, inputs, angle, velocity, loop)[:2]


def simulate_counted(  # noqa: PLR0917 - as `simulate`
    parameters: LumpedParameters,
    time: Samples,
    inputs: Samples,
    angle: float,
    velocity: float = 0.0,
    loop: Loop | None = None,
    most: int = MOST_STEPS,
) -> Simulated:
    """Integrate the equation of `LumpedParameters` over ``time``, one RK4 step per interval.

    A step in which the velocity changes sign is split where it vanishes. The joint then sticks
    while static friction holds it, and slips from the instant when the other torques exceed
    friction, so no regularisation parameter is needed. Each interval is divided into steps short
    enough for the armature's lag and the bristles; current and bristles start at 0.

    `time` has (n,) increasing instants in s, `inputs` (n - 1, 3) values at the start, middle and
    end of each interval, already delayed; unused with the ``loop`` of a servo. From where an
    interval needs more than ``most`` steps, angles and velocities are NaN.
    """
    start, constants = (angle, velocity, 0.0, 0.0), constants_of(parameters)
    moving = require_plain_base(parameters) if parameters.base_gives else None
    written = np.empty(time.size), np.empty(time.size)
    if loop is None:
        drives = parameters.p4 * inputs
        steps = integrate(time, drives, start, constants, moving, most, *written)
    else:
        off, memory = constants._replace(back_emf=0.0), np.zeros(MEMORY)
        steps = integrate_loop(time, start, constants, off, loop, memory, moving, most, *written)
    return Simulated(*written, steps)


def steps_of_interval(parameters: LumpedParameters, velocity: float, duration: float) -> int:
    """Return the steps that a simulation takes for one interval, in s, at a velocity in rad/s.

    0 if it needs more than `MOST_STEPS`.
    """
    moving = True if parameters.base_gives else None
    return int(steps_at(velocity, duration, constants_of(parameters), moving))


def require_plain_base(parameters: LumpedParameters) -> bool:
    """Return True, or raise InputError for terms that are not simulated on a moving base."""
    for name in FIXED_BASE:
        if (value := getattr(parameters, name)) > 0:
            expected = "0 on a moving base (not simulated together)"
            amount = f"{value:g} {TERMS[name].unit}".removesuffix(" –")
            raise InputError("Base", name, amount, expected)
    return True


@dataclass(frozen=True, kw_only=True, eq=False)
class Columns:
    """The k derivatives computed by the kernel, and how n parameters combine them."""

    names: tuple[str, ...]  # (n,) of the parameters
    joint: LumpedParameters  # with its added mass
    column: NDArray[np.int64]  # (k,) of the kernel's `COLUMNS`
    initial: Samples  # (4, k) derivatives of the initial state
    mixture: Samples  # (k, n) derivatives of the quantities of the columns by the parameters

    @classmethod
    def of(
        cls,
        names: Sequence[str],
        parameters: LumpedParameters,
        added: AddedMass = NO_ADDED_MASS,
        *,
        exact: bool = True,
    ) -> Columns:
        """Return the columns for parameters of the joint with ``added``, or of `INITIAL`.

        Unless ``exact``, that by a base's compliance at 0 is within a per cent or so: the response
        to what such a base would add, which takes a quarter of the time.
        """
        loaded = parameters.with_added_mass(added)
        parts = _parts(loaded, added)
        if loaded.base_gives or (exact and not {*BASE_TERMS}.isdisjoint(names)):
            parts |= _parts_of_base(parameters, added, parts["tilt"]["p3"])
        elif not exact:
            parts |= {term: {} for term in BASE_TERMS}
            parts["base_compliance"] = {"begin_to_give": 1.0}
        for name in names:
            _require_derivative(name, parts, loaded)
        keys = dict.fromkeys(key for name in names for key in parts[name])
        different = {key: number for number, key in enumerate(keys)}
        mixture = np.zeros((len(different), len(names)))
        for column, name in enumerate(names):
            for key, share in parts[name].items():
                mixture[different[key], column] = share
        initial = np.zeros((4, len(different)))
        for state, (name, slope) in enumerate(INITIAL.items()):
            if name in different:
                initial[state, different[name]] = slope
        return cls(
            names=tuple(names),
            joint=loaded,
            column=np.array([COLUMNS.get(key, -1) for key in different], dtype=np.int64),
            initial=initial,
            mixture=mixture,
        )

    @cached_property
    def drives(self) -> int:
        """Number of input derivatives needed, of p4, delay, slow_delay and `DRIVE` in order."""
        gains = COLUMNS[LOOP_TERMS[0]]
        last = int(self.column.max(initial=-1, where=self.column < gains))
        return max(last + 1 - len(Constants._fields), 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """Outputs of a simulation: m sums of the state at both ends of single intervals."""

    into: NDArray[np.int64]  # (n - 1,) number of the sum that an interval gives; -1 for none
    # (4, m) of angle and velocity at the start, and of those at the end; 4 more are of other sums
    weights: Samples


class Differentiated(NamedTuple):
    """Readings of a simulation, their derivatives, and the work that they took."""

    values: Samples  # (m,)
    rows: Samples  # (m, n) derivatives by n parameters
    steps: int
    others: Samples  # (m,) the other sums of `Readings`, where it has them


def differentiate(
    time: Samples,
    inputs: Samples,
    starts: ArrayLike,
    readings: Readings,
    columns: Columns,
    *,
    pieces: NDArray[np.int64] | None = None,
    loop: Loop | None = None,
    most: int = MOST_STEPS,
) -> Differentiated:
    """Simulate as `simulate` does, with derivatives by n parameters.

    `inputs` has (q, n - 1, 3) values at the start, middle and end of each interval: the input,
    already delayed, and, as counted by `Columns.drives`, its derivatives by both delays and the
    terms of the drive (none with the ``loop`` of a servo); `starts` in rad and rad/s are one, or
    (s, 2) of s pieces, whose (s, 2) first and last instants `pieces` numbers.
    """
    begins = np.array(starts, dtype=float, ndmin=2)
    if pieces is None:
        pieces = np.array([[0, time.size - 1]])
    if not columns.names:
        assert len(pieces) == 1  # noqa: S101 - segments have derivatives by their starts
        angle, velocity, steps = simulate_counted(
            columns.joint, time, inputs[0], begins[0, 0], begins[0, 1], loop, most
        )
        ends = np.array([angle[:-1], velocity[:-1], angle[1:], velocity[1:]])
        values = np.sum(readings.weights[:4] * ends[:, readings.into >= 0], axis=0)
        return Differentiated(values, np.empty((values.size, 0)), steps, np.empty(0))
    values = np.empty((2, readings.weights.shape[1]))
    rows = np.empty((values.shape[1], columns.column.size))
    joint, numbers = columns.joint, columns.column
    moving = require_plain_base(joint) if joint.base_gives or COLUMNS["give"] in numbers else None
    constants = constants_of(joint, moving=moving)
    open_circuit, drives = constants._replace(back_emf=0.0), joint.p4 * inputs[0]
    moved = inputs if loop is None else inputs[:0]
    gives, steps = numbers == COLUMNS["begin_to_give"], 0
    if gives.any():
        torques = np.zeros((1, *inputs.shape[1:]))
        yielding = constants_of(joint, moving=True)
        for (first, last), begin in zip(pieces.tolist(), begins.tolist(), strict=True):
            part, motion = time[first : last + 1], np.empty((2, last + 1 - first))
            start = (*begin, 0.0, 0.0)
            steps += integrate(part, drives[first:last], start, constants, moving, most, *motion)
            steps += begin_to_give(part, *motion, yielding, torques[0, first:last])
        numbers = np.where(gives, DRIVES + len(inputs), numbers)
        moved = np.concatenate([inputs, torques])
    steps += kernel.differentiate(
        *(pieces, begins, time, drives, constants, readings.into, readings.weights, values),
        *(numbers, columns.initial, moved, rows, loop, open_circuit, moving, most),
        kernel.Work.of(columns.initial, 0 if loop is None else time.size - 1),
    )
    return Differentiated(values[0], rows @ columns.mixture, steps, values[1])


_ALONE: dict[str, Mapping[str, float]] = {name: {name: 1.0} for name in (*COLUMNS, *INITIAL)}
_NAMES = {*TERMS, *INITIAL}


def _parts(loaded: LumpedParameters, added: AddedMass) -> dict[str, Mapping[str, float]]:
    """Return derivatives of the kernel's constants, drives and `INITIAL` by each parameter."""
    brakes = loaded.coulomb >= 0
    held = loaded.stribeck < -max(loaded.coulomb, 0.0)  # at that limit friction at rest is 0
    level = {"coulomb": 1.0} | ({"stribeck": -1.0} if held else {}) if brakes else {}
    return _ALONE | {
        "p2": {"viscous": 1.0},
        "back_emf": {"back_emf": 1.0, "viscous": -1.0},
        "coulomb": level,
        "load_drag": {"drag": added.mass},
        "load": {name: slope * added.weight for name, slope in level.items()},
        "stribeck": {} if held else {"stribeck": 1.0},
        "delay": {"delay": loaded.p4},
        "slow_delay": {"slow_delay": loaded.p4},
        **{name: {name: loaded.p4} for name in DRIVE},
        "mass_inertia": {"p1": added.swung},
        "tilt": {"p3": -added.gravity_moment * math.sin(loaded.tilt)},
        "time_constant": {"lag": 1.0},
    }


def _parts_of_base(
    bare: LumpedParameters, added: AddedMass, tilting: float
) -> dict[str, Mapping[str, float]]:
    """Return derivatives of the constants of a moving base by each parameter."""
    w, slow = bare.base_frequency, 2 * bare.base_damping / bare.base_frequency
    pulled = 1 / added.gravity if added.gravity else 0.0
    return {
        "p3": {"p3": 1.0, "moment": pulled},
        "p3_offset": {"p3_offset": 1.0, "moment_offset": pulled},
        "tilt": {"p3": tilting, "moment": pulled * tilting},
        "base_compliance": {"give": 1.0, "swing": added.mass},
        "base_frequency": {"swing": -2 / w**3, "slow": -slow / w},
        "base_damping": {"slow": 2 / w},
    }


def _require_derivative(
    name: str, parts: Mapping[str, Mapping[str, float]], loaded: LumpedParameters
) -> None:
    """Raise InputError unless the model has a derivative by a parameter at its value."""
    if name not in _NAMES or name not in parts:
        known = [term for term in (*TERMS, *INITIAL) if term in parts]
        raise InputError("sensitivities", "parameter", name, nearest(name, known))
    if name == "time_constant" and not loaded.time_constant > 0:
        expected = "more than 0 s, for its derivative (at 0 s the current has no lag)"
        raise InputError("sensitivities", name, loaded.time_constant, expected)
    if name in BEYOND_MUJOCO and loaded.bristle_stiffness > 0:
        expected = "0 with friction that depends on torque or angle (not simulated together)"
        raise InputError("sensitivities", "bristle_stiffness", loaded.bristle_stiffness, expected)
    if name.startswith("bristle_") and not constants_of(loaded).bristle_stiffness > 0:
        stiffness, coulomb = loaded.bristle_stiffness, loaded.coulomb
        expected = "both more than 0, for their derivatives"
        values = f"{stiffness:g} N m/rad and {coulomb:g} N m"
        raise InputError("sensitivities", "bristle_stiffness and coulomb", values, expected)
