"""What a log says of each term of the equation of motion, averaged over test functions.

With a bump phi of compact support, int phi thdd = int phi'' th: nothing is differentiated that
carries noise. Multiplied by phi the equation is the balance of momentum; multiplied by phi thd it
is the balance of energy, whose terms are powers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from butterfly.errors import InputError
from butterfly.logs.log import Intersample
from butterfly.model.kinematics import Motion
from butterfly.model.parameters import compressed
from butterfly.model.terms import TERMS, FrictionTerms
from butterfly.signals import hold
from butterfly.signals.local_polynomial import slope
from butterfly.signals.resample import resample, uniform_grid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.model.kinematics import Term

HALF_WIDTH = 0.25
"""Longest half-width of the test functions in s; a sine's logs use at most a quarter period."""

_VELOCITY_SHARE = 0.25  # half-width of the velocity's window over that of the test functions
_VELOCITY_ORDER = 4  # of the polynomial whose slope it is
SPACING = 0.5
"""Of the test functions, in half-widths."""

_LARGEST_STICK = 0.05  # share of a window that may stand still
_STANDSTILL = 0.02  # share of the rms velocity below which the joint may stick


class Balance(StrEnum):
    """By what the equation of motion is multiplied, besides the test function."""

    MOMENTUM = "weak-form"
    ENERGY = "energy-balance"


@dataclass(frozen=True, kw_only=True, eq=False)
class WeakSignals:
    """What a log says at the centres of its test functions.

    Parameters
    ----------
    time, angle, velocity
        (n,) instants in s, angle from the hanging position in rad, velocity in rad/s.
    mean
        By parameter: (n,) averages over each test function of what it multiplies in the equation,
        the motor's torque brought to the left: summed with the parameters' values they give 0.
    still
        (n,) share of each test function in which the joint may stick.
    """

    time: NDArray[np.float64]
    angle: NDArray[np.float64]
    velocity: NDArray[np.float64]
    mean: dict[str, NDArray[np.float64]]
    still: NDArray[np.float64]

    @property
    def moving(self) -> NDArray[np.bool_]:
        """(n,) whether the joint moves enough for friction to be a function of the motion."""
        return np.asarray(self.still < _LARGEST_STICK)


@dataclass(frozen=True, kw_only=True)
class Known:
    """What is known of a joint before its torques are averaged.

    Parameters
    ----------
    zero
        Encoder reading in rad where the model's angle is 0.
    delay
        From input to torque, in s.
    compression
        Of the drive, in 1/unit of input; the column of "compression" is the derivative about it.
    settings
        Of these the periods of cogging and Stribeck's velocity.
    """

    zero: float
    delay: float = 0.0
    compression: float = 0.0
    settings: FrictionTerms = field(default_factory=FrictionTerms)


def weak_signals(
    log: Log,
    names: Sequence[str],
    known: Known,
    half_width: float,
    balance: Balance = Balance.MOMENTUM,
) -> WeakSignals:
    """Average terms of the equation of motion over the test functions of one log.

    Parameters
    ----------
    log
        Of any input.
    names
        Which parameters' terms.
    known
        What is known beforehand.
    half_width
        Of the test functions in s; they stand half of it apart.
    balance
        Of momentum, or of energy.

    Raises
    ------
    InputError
        If the log is shorter than a test function.
    """
    grid = uniform_grid(log.time)
    step = float(grid[1] - grid[0])
    reach = math.ceil((half_width + abs(known.delay)) / step)
    if grid.size < 2 * reach + 1:
        longer = f"{2 * reach * step:.3g} s or more"
        raise InputError(log.source, "time", f"{grid[-1] - grid[0]:.3g} s", longer)
    angle = resample(log.time, log.angle, grid) - known.zero
    velocity = _velocity(angle, half_width, step)
    inputs = _delivered(log, grid - known.delay, step, known.compression)
    weight = log.added_mass.weight
    motion = Motion.of(known.settings, angle, velocity, input=inputs, weight=weight)
    speed = float(np.sqrt(np.mean(velocity**2)))
    still = (np.abs(velocity) < _STANDSTILL * speed).astype(float)
    centres = np.arange(reach, grid.size - reach, max(1, round(SPACING * half_width / step)))
    column_of = _momentum if balance is Balance.MOMENTUM else _energy
    area = _against(0, np.ones_like(angle), half_width, step, centres[:1])
    return WeakSignals(
        time=grid[centres],
        angle=angle[centres],
        velocity=velocity[centres],
        mean={
            name: _against(*column_of(TERMS[name], motion), half_width, step, centres) / area
            for name in names
        },
        still=_against(0, still, half_width, step, centres) / area,
    )


def _velocity(angle: NDArray[np.float64], half_width: float, step: float) -> NDArray[np.float64]:
    reach = max(round(_VELOCITY_SHARE * half_width / step), _VELOCITY_ORDER // 2 + 1)
    return slope(angle, min(reach, (angle.size - 1) // 2), _VELOCITY_ORDER, step)


def _delivered(
    log: Log, instants: NDArray[np.float64], step: float, compression: float
) -> NDArray[np.float64]:
    """Return the delivered input at instants: a held one's mean over the ``step`` s about each."""
    inputs = compressed(log.input, compression)
    if log.intersample is Intersample.FIRST_ORDER_HOLD:
        return hold.value(log.time, inputs, instants, log.intersample)
    edges = np.concatenate([instants - step / 2, instants[-1:] + step / 2])
    return hold.mean(log.time, inputs, edges, log.intersample)


def _momentum(row: Term, motion: Motion) -> tuple[int, NDArray[np.float64]]:
    """Return what a parameter multiplies: order of the bump's derivative, and (m,) signal.

    Derivatives of the angle go over to the bump, as does that of the input by which a delay acts.
    """
    if row.derivative:
        return row.derivative, (-1) ** row.derivative * motion.angle
    if row.basis is None:
        return 1, -motion.input
    return 0, row.basis(motion)


def _energy(row: Term, motion: Motion) -> tuple[int, NDArray[np.float64]]:
    """As `_momentum`, times the velocity; what is conserved is integrated by parts."""
    if row.derivative == 2:  # noqa: PLR2004 - of the angle: the inertia
        return 1, -(motion.velocity**2) / 2
    if row.potential is not None:
        return 1, -row.potential(motion.angle, motion.periods)
    assert row.basis is not None  # noqa: S101 - a delay is known in the balance of energy
    return 0, row.basis(motion) * motion.velocity


def _against(
    order: int,
    signal: NDArray[np.float64],
    half: float,
    step: float,
    centres: NDArray[np.intp],
) -> NDArray[np.float64]:
    """Integrate a signal against the bump's derivative of an order, centred at some samples."""
    reach = int(half / step)
    s = np.arange(-reach, reach + 1) * step / half
    inside = 1 - s**2
    bump = (
        inside**4,
        -8 * s * inside**3 / half,
        (-8 * inside**3 + 48 * s**2 * inside**2) / half**2,
    )[order]
    return np.asarray(sliding_window_view(signal, bump.size)[centres - reach] @ bump * step)
