"""Averages of each term of the equation of motion over test functions.

The test functions are bumps (1 - s^2)^4 that overlap. With a bump phi of compact support,
int phi thdd = int phi'' th: nothing is differentiated that carries noise. Multiplied by phi the
equation is the balance of momentum; multiplied by phi thd it is the balance of energy, whose terms
are powers.

A log that begins at rest may be continued before its beginning by its mirror image, which obeys the
equation at |t| and has no kink. So bumps may extend beyond the beginning, where a joint's spin-up
may have all the information on its inertia.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable
from copy import copy
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from butterfly.arrays import ROUNDING, Samples
from butterfly.errors import InputError
from butterfly.identification.limits import CELLS
from butterfly.logs.log import Log
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import GEAR, IDEAL, TERMS, DriveTerms, FrictionTerms, Motion, Term
from butterfly.signals import hold
from butterfly.signals.frequency_response import (
    dominant_period,
    resample,
    uniform_grid,
    white_variance,
)
from butterfly.signals.hold import slope

_NOISY = 0.5  # of the variance of a motion, above which noise hides its period

SPACING = 0.5
"""Of the test functions, in half-widths."""

HALF_WIDTH = 0.25
"""Half-width of the test functions in s where noise asks for none longer (see `half_width_of`)."""
VELOCITY_SHARE = 0.25
"""Half-width of the velocity's window over that of the test functions."""
_QUIET = 0.03  # of the acceleration, largest noise of its averages
_VELOCITY_ORDER = 4  # of the polynomial whose slope it is
LEAST_SAMPLES = _VELOCITY_ORDER + 1
"""Samples on either side of a test function's centre with which sums are integrals."""
_LARGEST_STICK = 0.05  # share of a window that may stand still
_STANDSTILL = 0.02  # share of the rms velocity below which the joint may stick
_BUMP = Polynomial([1, 0, -1]) ** 4
_AREA, _SQUARE = _BUMP.integ(), (_BUMP.deriv(2) ** 2).integ()
_ROUGHNESS = float((_SQUARE(1) - _SQUARE(-1)) / (_AREA(1) - _AREA(-1)) ** 2)
"""Integral of the square of a bump's second derivative, of half-width and area 1."""
_DRIVEN = {"p4", *(row.name for row in TERMS.values() if row.of_gain)}  # what the input enters


@dataclass(frozen=True, kw_only=True, eq=False)
class Bumps:
    """Bumps of one width on a uniform clock of n samples, as many as have room."""

    half_width: float  # in s
    step: float  # of the clock in s
    size: int  # n
    margin: int  # samples that stay free of centres at either end; a half-width or more

    @cached_property
    def centres(self) -> NDArray[np.intp]:
        """(m,) samples at which they are centred."""
        return np.arange(self.margin, self.size - self.margin, self._stride)

    def means(self, signal: Samples, order: int = 0) -> Samples:
        """(m,) integrals of an (n,) signal against a derivative of each, over its area."""
        weights = self._weights[order]
        stride, parts = weights.shape
        rows = self.centres.size + parts - 1
        first = self.margin - self._half
        pieces = signal[first : first + rows * stride]
        if pieces.size < rows * stride:  # the last bump ends within its last part
            pieces = np.concatenate([pieces, np.zeros(rows * stride - pieces.size)])
        sums = pieces.reshape(rows, stride) @ weights
        return np.asarray(sum(sums[k : rows - parts + 1 + k, k] for k in range(parts)))

    @property
    def _stride(self) -> int:
        return max(1, round(SPACING * self.half_width / self.step))

    @property
    def _half(self) -> int:
        """Samples inside a bump on either side of its centre."""
        return math.ceil(self.half_width / self.step) - 1

    @cached_property
    def _weights(self) -> Samples:
        """(3, stride, parts) a bump and its derivatives over its area, cut where others begin."""
        s = np.arange(-self._half, self._half + 1) * self.step / self.half_width
        inside = 1 - s**2
        derivatives = np.array(
            [
                inside**4,
                -8 * s * inside**3 / self.half_width,
                (-8 * inside**3 + 48 * s**2 * inside**2) / self.half_width**2,
            ]
        )
        # a sum is not quite an integral, but many turns of angle are no acceleration
        derivatives[2] -= derivatives[0] * (derivatives[2].sum() / derivatives[0].sum())
        parts = -(-s.size // self._stride)
        weights = np.zeros((3, parts * self._stride))
        weights[:, : s.size] = derivatives / derivatives[0].sum()
        return np.ascontiguousarray(weights.reshape(3, parts, self._stride).swapaxes(1, 2))


class Balance(StrEnum):
    """Balance by the factor of the equation of motion: the test function, or it times velocity."""

    MOMENTUM = "weak-form"
    ENERGY = "energy-balance"


@dataclass(frozen=True, kw_only=True, eq=False)
class WeakSignals:
    """Averaged terms of a log at the centres of its test functions."""

    # time, angle, velocity: (n,) instants in s, angle from the hanging position in rad, velocity in
    # rad/s
    time: Samples
    angle: Samples
    velocity: Samples
    # by parameter: (n,) averages over each test function of what it multiplies in the equation, the
    # motor's torque on the left: multiplied by the parameters' values they sum to 0
    mean: dict[str, Samples]
    # (n,) whether the joint moves enough in each for friction to be a function of the motion
    moving: NDArray[np.bool_]


class Averaging:
    """One log, ready to be averaged over test functions with one delay after another.

    Averages are cached; another delay or drive recomputes only the terms that the input enters,
    unless the delay moves the test functions.

    ``log``: of any input; ``zero``: encoder reading in rad where the model's angle is 0;
    ``half_width``: of the test functions in s, with a spacing of half of it; ``settings``: of these
    the periods of cogging and Stribeck's velocity; ``balance``: of momentum, or of energy.
    """

    def __init__(
        self,
        log: Log,
        zero: float,
        half_width: float,
        settings: FrictionTerms,
        balance: Balance = Balance.MOMENTUM,
    ) -> None:
        self._log, self._zero, self.half_width = log, zero, half_width
        self._settings, self._balance = settings, balance
        self._column_of = _momentum if balance is Balance.MOMENTUM else _energy
        self._grid = uniform_grid(log.time)
        self._step = float(self._grid[1] - self._grid[0])
        astray = np.abs(log.time - self._grid).max() > ROUNDING * self._step
        angle = (resample(log.time, log.angle, self._grid) if astray else log.angle) - zero
        self._rests = log.initial_state.velocity == 0
        mirror = angle[math.ceil(half_width / self._step) : 0 : -1] if self._rests else angle[:0]
        half = max(round(VELOCITY_SHARE * half_width / self._step), _VELOCITY_ORDER // 2 + 1)
        half = min(half, (mirror.size + angle.size - 1) // 2)
        velocity = slope(np.append(mirror, angle), half, _VELOCITY_ORDER, self._step)[mirror.size :]
        self.added = log.added_mass
        weight, mass = self.added.weight, self.added.mass
        self._motion = settings.motion(angle, velocity, weight=weight, mass=mass)
        speed = float(np.sqrt(np.mean(velocity**2)))
        self._still = (np.abs(velocity) < _STANDSTILL * speed).astype(float)
        self._places: dict[int, _Place] = {}

    def with_measurement(self, measured: Samples) -> Averaging:
        """Return the averages of another motion over the same test functions."""
        log, settings = self._log.with_measurement(measured), self._settings
        averages = Averaging(log, self._zero, self.half_width, settings, self._balance)
        averages._rests = self._rests
        return averages

    def signals(
        self,
        names: Iterable[str],
        *,
        delay: float = 0.0,
        drive: DriveTerms = IDEAL,
        stribeck_velocity: float | None = None,
    ) -> WeakSignals:
        """Average the terms of some parameters."""
        place = self._place(delay)
        slow = stribeck_velocity or self._motion.stribeck_velocity
        longer: dict[str, tuple[Hashable, ...]] = {"stribeck": ("stribeck", slow)}
        longer |= {name: (name, delay, drive) for name in (*_DRIVEN, *GEAR)}
        keys = {name: longer.get(name, (name,)) for name in names}
        missing = [name for name, key in keys.items() if key not in place.mean]
        motion = self._motion._replace(stribeck_velocity=slow)
        if not {*_DRIVEN, *GEAR}.isdisjoint(missing):
            motion = self._driven(motion, delay, drive)
        for name in missing:
            place.mean[keys[name]] = place.means(*self._column_of(TERMS[name], motion))
        centres = place.bumps.centres - place.lead
        return WeakSignals(
            time=self._grid[centres],
            angle=self._motion.angle[centres],
            velocity=self._motion.velocity[centres],
            mean={name: place.mean[key] for name, key in keys.items()},
            moving=place.moving,
        )

    def _driven(self, motion: Motion, delay: float, drive: DriveTerms) -> Motion:
        log = self._log
        inputs = drive.delivered(log.input)
        delivered = hold.for_sums(log.time, inputs, self._grid - delay, log.between_samples)
        p = self._settings
        if not (p.geared and isinstance(p, LumpedParameters)):
            return motion._replace(input=delivered)
        motor = p.p4 * delivered - p.back_emf * motion.velocity
        return p.motion(
            motion.angle, motion.velocity, motor=motor, weight=motion.weight, input=delivered
        )

    def moving(self, delay: float) -> NDArray[np.bool_]:
        """(n,) whether the joint moves in each test function."""
        return self._place(delay).moving

    def carrying(self, added: AddedMass) -> Averaging:
        """Return the same averages with another added mass, if none depends on it."""
        averages = copy(self)
        averages.added = added
        return averages

    @property
    def fastest(self) -> float:
        """Largest speed of the log in rad/s."""
        return float(np.abs(self._motion.velocity).max())

    @property
    def duration(self) -> float:
        """Length of the log in s."""
        return float(self._grid[-1] - self._grid[0])

    def _place(self, delay: float) -> _Place:
        """Place the test functions where the input is known a delay before."""
        margin = math.ceil((self.half_width + abs(delay)) / self._step)
        if margin not in self._places:
            time = self._grid
            if time.size < 2 * margin + 1:
                least = f"at least {2 * margin * self._step:.3g} s, the length of one window"
                wider = f" of half-width {self.half_width:.3g} s, and the delay before it"
                given = f"{time[-1] - time[0]:.3g} s"
                raise InputError(self._log.source, "time", given, least + wider)
            lead = margin if self._rests else 0
            size = time.size + lead
            bumps = Bumps(half_width=self.half_width, step=self._step, size=size, margin=margin)
            place = _Place(bumps, lead, np.empty(0, dtype=bool), {})
            moving = np.asarray(place.means(self._still) < _LARGEST_STICK)
            self._places[margin] = place._replace(moving=moving)
        return self._places[margin]


class _Place(NamedTuple):
    """Test functions, whether the joint moves in each, and means over them."""

    bumps: Bumps
    lead: int  # samples that are mirrored before the first
    moving: NDArray[np.bool_]
    # by name; what the input enters by name, delay and drive
    mean: dict[tuple[Hashable, ...], Samples]

    def means(self, signal: Samples, order: int = 0) -> Samples:
        """(m,) means of an (n,) signal and its mirror image, odd if integrated by parts once."""
        mirror = signal[self.lead : 0 : -1]
        before = 2 * signal[0] - mirror if order % 2 else mirror
        return self.bumps.means(np.concatenate([before, signal]), order)


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualTorque:
    """Residual torque of one log at the joint: that of all terms less the motor's.

    Averaged over bumps, the acceleration becomes int phi'' th, so nothing is differentiated twice;
    where the joint may stick, friction is no function of the motion and there is no residual.
    """

    label: str  # of the log
    # (n,) instants in s at which the joint moves, angle in rad from the hanging position, velocity
    # in rad/s, N m
    time: Samples
    angle: Samples
    velocity: Samples
    torque: Samples

    @classmethod
    def of(cls, log: Log, values: LumpedParameters, zero: float) -> ResidualTorque:
        """Subtract all terms: tau_eps = p1 thdd + p2 thd + p3 sin th + ... - p4 v (5)."""
        loaded = values.with_added_mass(log.added_mass)
        omega = log.excitation.omega if log.excitation else resonance_frequency(loaded)
        width = half_width_of(log)
        if omega:
            width = min(width, max(math.pi / (4 * omega), LEAST_SAMPLES * log.mean_step))
        acting = [row.name for row in TERMS.values() if row.basis or row.derivative]
        signals = Averaging(log, zero, width, loaded).signals(
            acting, delay=values.delay, drive=values.drive
        )
        sizes = {name: getattr(values, name) for name in acting if not TERMS[name].of_gain}
        sizes |= {"p1": loaded.p1, "p3": loaded.p3}
        torque = sum(size * signals.mean[name] for name, size in sizes.items())
        moving = signals.moving
        return cls(
            label=log.label,
            time=signals.time[moving],
            angle=signals.angle[moving],
            velocity=signals.velocity[moving],
            torque=np.asarray(torque)[moving],
        )


def half_width_of(log: Log) -> float:
    """Return the half-width in s of the test functions of a log, in its own time.

    Short ones see fast motion, long ones less noise. So they are `HALF_WIDTH`, or as long as makes
    the noise of averaged accelerations small; at most a quarter of the motion's period and one of
    the `CELLS` of a log, but at least `LEAST_SAMPLES`.
    """
    step, length = log.mean_step, float(log.time[-1] - log.time[0])
    variance, omega = white_variance(log.angle), 2 * math.pi / length
    if log.excitation is not None:
        omega = log.excitation.omega
    elif variance < _NOISY * log.rms_motion**2:  # else noise hides it
        omega = 2 * math.pi / dominant_period(log.time, log.angle)
    longest = min(math.pi / (2 * omega), length / CELLS)
    if acceptable := _QUIET * log.rms_motion * omega**2:
        noise = math.sqrt(step * variance * _ROUGHNESS)  # with a half-width of 1 s
        longest = min(longest, max(HALF_WIDTH, (noise / acceptable) ** 0.4))
    return max(longest, LEAST_SAMPLES * step)


def _momentum(row: Term, motion: Motion) -> tuple[Samples, int]:
    """Return the (n,) signal that a parameter multiplies, and how often its bump is derived."""
    if row.derivative:
        return (-1) ** row.derivative * motion.angle, row.derivative
    if row.basis is None:
        return -motion.input, 1
    return row.basis(motion), 0


def _energy(row: Term, motion: Motion) -> tuple[Samples, int]:
    """As `_momentum`, times the velocity; conservative terms are integrated by parts."""
    if row.derivative == 2:  # noqa: PLR2004 - of the angle: the inertia
        return -(motion.velocity**2) / 2, 1
    if row.potential is not None:
        return -row.potential(motion.angle, motion.periods), 1
    assert row.basis is not None  # noqa: S101 - a delay is known in the balance of energy
    return row.basis(motion) * motion.velocity, 0
