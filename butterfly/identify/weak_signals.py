"""What a log says of each term of the equation of motion, averaged over test functions.

With a bump phi of compact support, int phi thdd = int phi'' th: nothing is differentiated that
carries noise. Multiplied by phi the equation is the balance of momentum; multiplied by phi thd it
is the balance of energy, whose terms are powers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import savgol_filter

from butterfly.errors import InputError
from butterfly.logs.log import Intersample, held_impulses
from butterfly.model.friction import FrictionTerms
from butterfly.model.parameters import compressed
from butterfly.signals.resample import resample, uniform_grid

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.logs.log import Log

    _Columns = dict[str, tuple[int, NDArray[np.float64]]]

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


def weak_signals(
    log: Log,
    zero: float,
    half_width: float,
    delay: float = 0.0,
    *,
    balance: Balance = Balance.MOMENTUM,
    cogging_periods: float = 1.0,
    compression: float = 0.0,
) -> WeakSignals:
    """Average every term of the equation of motion over the test functions of one log.

    Parameters
    ----------
    log
        Of any input.
    zero
        Encoder reading in rad of the hand at rest.
    half_width
        Of the test functions in s; they stand half of it apart.
    delay
        From input to torque, in s.
    balance
        Of momentum, or of energy.
    cogging_periods
        Of the cogging torque in one turn.
    compression
        Of the drive, in 1/unit of input, about which "compression" is the derivative of p4 v.

    Raises
    ------
    InputError
        If the log is shorter than a test function.
    """
    grid = uniform_grid(log.time)
    step = float(grid[1] - grid[0])
    reach = math.ceil((half_width + abs(delay)) / step)
    if grid.size < 2 * reach + 1:
        longer = f"{2 * reach * step:.3g} s or more"
        raise InputError(log.source, "time", f"{grid[-1] - grid[0]:.3g} s", longer)
    angle = resample(log.time, log.angle, grid) - zero
    delivered = compressed(log.input, compression)
    inputs, lost = (
        _mean(log, values, grid - delay, step)
        for values in (delivered, delivered * np.abs(delivered))
    )
    width = 2 * max(round(_VELOCITY_SHARE * half_width / step), _VELOCITY_ORDER // 2 + 1) + 1
    width = min(width, angle.size - 1 + angle.size % 2)
    velocity = savgol_filter(angle, width, _VELOCITY_ORDER, deriv=1, delta=step)
    speed = float(np.sqrt(np.mean(velocity**2)))
    still = (np.abs(velocity) < _STANDSTILL * speed).astype(float)
    centres = np.arange(reach, grid.size - reach, max(1, round(SPACING * half_width / step)))
    of = _momentum if balance is Balance.MOMENTUM else _energy
    columns = of(angle, velocity, inputs, cogging_periods)
    columns["compression"] = (0, lost if balance is Balance.MOMENTUM else lost * velocity)
    columns["load"] = (0, log.added_mass.weight * columns["coulomb"][1])
    area = _against(0, np.ones_like(angle), half_width, step, centres[:1])
    return WeakSignals(
        time=grid[centres],
        angle=angle[centres],
        velocity=velocity[centres],
        mean={
            name: _against(*column, half_width, step, centres) / area
            for name, column in columns.items()
        },
        still=_against(0, still, half_width, step, centres) / area,
    )


def _momentum(
    angle: NDArray[np.float64],
    velocity: NDArray[np.float64],
    inputs: NDArray[np.float64],
    periods: float,
) -> _Columns:
    """Return what each parameter multiplies: order of the bump's derivative, and (m,) signal."""
    sign = np.sign(velocity)
    return {
        "p1": (2, angle),
        "p2": (1, -angle),
        "p3": (0, np.sin(angle)),
        "p3_offset": (0, np.cos(angle)),
        "coulomb": (0, sign),
        "stribeck": (0, _weakening(velocity) * sign),
        "drag": (0, np.abs(velocity) * velocity),
        "bias": (0, -np.ones_like(angle)),
        "cogging": (0, -np.sin(periods * angle)),
        "cogging_cosine": (0, -np.cos(periods * angle)),
        "p4": (0, -inputs),
        "delay": (1, -inputs),
    }


def _energy(
    angle: NDArray[np.float64],
    velocity: NDArray[np.float64],
    inputs: NDArray[np.float64],
    periods: float,
) -> _Columns:
    """As `_momentum`, times the velocity; what is conserved is integrated by parts."""
    speed = np.abs(velocity)
    return {
        "p1": (1, -(velocity**2) / 2),
        "p2": (0, velocity**2),
        "p3": (1, np.cos(angle)),
        "p3_offset": (1, -np.sin(angle)),
        "coulomb": (0, speed),
        "stribeck": (0, _weakening(velocity) * speed),
        "drag": (0, speed**3),
        "bias": (1, angle),
        "cogging": (1, -np.cos(periods * angle) / periods),
        "cogging_cosine": (1, np.sin(periods * angle) / periods),
        "p4": (0, -inputs * velocity),
    }


def _weakening(velocity: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.exp(-((velocity / FrictionTerms.stribeck_velocity) ** 2)))


def _mean(
    log: Log, values: NDArray[np.float64], instants: NDArray[np.float64], step: float
) -> NDArray[np.float64]:
    """Average values held as the log's input is over ``step`` s about instants; 0 before it."""
    if log.intersample is Intersample.FIRST_ORDER_HOLD:
        return np.interp(instants, log.time, values, left=0.0)
    ends = np.concatenate([instants - step / 2, instants[-1:] + step / 2])
    return held_impulses(log.time, values, ends) / step


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
