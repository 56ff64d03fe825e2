"""Energy shaping (103), (109), and how much gain and delay the loop bears."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import InputError, require_number
from butterfly.model.energy import Orbit, potential, pull
from butterfly.model.linear import DelayStates, LinearJoint
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import CONSERVATIVE, DISSIPATIVE, TERMS, made_up, torque_of
from butterfly.plant.motor import ControlLaw, Reading
from butterfly.plant.sensors import FilteredDifference

Target = Callable[[LumpedParameters], Orbit]

_FRICTION = tuple(row for row in DISSIPATIVE if row.name != "p2")
_STARTED = 0.01  # share of the wanted kinetic energy above which the hand needs no kick
_LEAST_GAIN = 0.1  # share of its gain that a drive is believed to keep at any command
_SINES = 12  # of a dither
_ANGLES = 361  # of a turn, where its potential is looked at
_STANDSTILL = 1e-3  # rad/s, below which Coulomb friction has no sign and is not compensated
_STATIC = (*CONSERVATIVE, *DISSIPATIVE)


def gain_for(orbit: Orbit, multiplier: float) -> float:
    """Return gamma with which perturbations shrink to ``multiplier`` of themselves in a period.

    The Floquet multiplier is exp(-p4 gamma oint thd^2 dt), from (114) over a period.
    """
    if not 0 < multiplier < 1:
        raise InputError("orbit", "multiplier", multiplier, "between 0 and 1")
    return -math.log(multiplier) / (abs(orbit.parameters.p4) * orbit.squared_speed)


class VelocityEstimator(Protocol):
    """Gives the velocity at each reading, as `FilteredDifference` and `Observer` do."""

    def update(self, time: float, angle: float, command: float) -> float:
        """Return the velocity in rad/s; ``command`` was held since the reading before."""
        ...


class Observer:
    """Luenberger's observer with the model: without lag where the model is right.

    Delay, armature's lag and bristles are left out of it. The parameters are of the hand with what
    it carries; ``zero`` is the encoder reading in rad where the model's angle is 0. Both poles are
    at the ``bandwidth`` in rad/s, which amplifies encoder noise s to about 2 bandwidth s.
    """

    def __init__(
        self, parameters: LumpedParameters, zero: float = 0.0, bandwidth: float = 60.0
    ) -> None:
        require_number("Observer", positive=True, bandwidth=bandwidth)
        self._p, self._zero = parameters, zero
        self._gains = (2 * bandwidth, bandwidth**2)
        self._time: float | None = None
        self._angle = self._velocity = 0.0

    def update(self, time: float, angle: float, command: float) -> float:
        """Return the velocity in rad/s."""
        angle -= self._zero
        if self._time is None:
            self._angle = angle
        else:
            p, step = self._p, time - self._time
            error = angle - self._angle
            drive = p.p4 * p.delivered(command)
            motor = drive - p.back_emf * self._velocity
            motion = p.motion(self._angle, self._velocity, motor=motor)
            if abs(self._velocity) <= _STANDSTILL:
                motion = motion._replace(direction=0.0)
            rate = (drive - torque_of(p, motion, _STATIC)) / p.p1 + self._gains[1] * error
            self._angle += step * (self._velocity + 0.5 * step * rate + self._gains[0] * error)
            self._velocity += step * rate
        self._time = time
        return self._velocity


class EnergyShaping:
    """The control law (103) with (109), to be run on a bench.

    v = (p2 thd + T_c sgn thd)/p4 - gamma thd (E - E*) sgn p4, and whatever other friction the
    model has is compensated like T_c. The orbit is that of the hand with what it carries, as
    believed; gamma is in units of the input per rad/s and J. A ``kick`` along the velocity starts a
    hand that stands still, which (109) would leave alone.

    For an orbit that turns over, bias is compensated, too. While the hand moves against the orbit's
    direction, E* is below the top's energy by the factor by which it is above it otherwise.
    """

    def __init__(
        self,
        orbit: Orbit,
        gamma: float,
        *,
        zero: float = 0.0,
        velocity: VelocityEstimator | None = None,
        kick: float = 0.0,
    ) -> None:
        self._velocity = velocity or FilteredDifference()
        self._zero, self._kick, self._command = zero, kick, 0.0
        self.retune(orbit, gamma)

    def retune(self, orbit: Orbit, gamma: float) -> None:
        """Hold another orbit, of other believed parameters, from the next reading on."""
        if not (math.isfinite(gamma) and gamma > 0):
            raise InputError("EnergyShaping", "gamma", gamma, "a positive number")
        self._p = p = orbit.parameters
        self._target, self._direction = orbit.energy, orbit.direction
        levels = potential(orbit.conserving, np.linspace(orbit.lower, orbit.upper, _ANGLES))
        lowest, top = float(levels.min()), float(levels.max())
        self._backwards = lowest + (top - lowest) ** 2 / (orbit.energy - lowest)  # short of the top
        self._gain = math.copysign(gamma, p.p4)
        lost = (*_FRICTION, TERMS["bias"]) if orbit.direction else _FRICTION
        # Looking for the terms that a hand has takes longer than what is left of the law.
        self._stored, self._braked = (
            tuple(row for row in rows if getattr(of, row.name))
            for of, rows in ((orbit.conserving, CONSERVATIVE), (p, lost))
        )

    def __call__(self, reading: Reading) -> float:
        """Return the command for one reading."""
        p = self._p
        speed = self._velocity.update(reading.time, reading.angle, self._command)
        angle = reading.angle - self._zero
        target = self._target if speed * self._direction >= 0 else self._backwards
        kinetic, wanted = 0.5 * p.p1 * speed**2, target - potential(p, angle, self._stored)
        excess = kinetic - wanted
        command = p.p2 / p.p4 * speed - self._gain * speed * excess
        if self._braked and abs(speed) > _STANDSTILL:
            motion = p.motion(angle, speed, motor=p.p4 * command - p.back_emf * speed)
            command += made_up(p, motion, self._braked) / p.p4
        command /= max(1 - p.compression * abs(command), _LEAST_GAIN)
        command += math.copysign(p.dead_zone, command)
        if kinetic < _STARTED * wanted:
            command += math.copysign(self._kick, speed)
        self._command = float(command)
        return self._command


class Dithered:
    """A law with a random sum of sines added, of a given share of the law's own running rms."""

    def __init__(
        self, law: ControlLaw, share: float, omega: float, rng: np.random.Generator
    ) -> None:
        require_number("Dithered", share=share)
        require_number("Dithered", positive=True, omega=omega)
        self._law, self._share = law, share
        self._omega = rng.uniform(0.5, 4.0, _SINES) * omega
        self._phase = rng.uniform(0, 2 * math.pi, _SINES)
        self._rate, self._square, self._time = omega / (2 * math.pi), 0.0, 0.0

    def __call__(self, reading: Reading) -> float:
        """Return the command for one reading."""
        command = self._law(reading)
        fade = math.exp(-self._rate * (reading.time - self._time))
        self._time = reading.time
        self._square = fade * self._square + (1 - fade) * command**2
        sines = float(np.sin(self._omega * reading.time + self._phase).sum())
        return command + self._share * math.sqrt(2 * self._square / _SINES) * sines


_ORDER = 8  # of Padé's approximation; to 6e-8 at the third harmonic of the orbit a quarter late
_STEPS = 800  # of a period
_NODES = np.array([0.5 - math.sqrt(3) / 6, 0.5 + math.sqrt(3) / 6])  # Gauss's, of a step
_SAMPLES = 256  # of a period, in a balance of powers
_LEVELS = 16  # energies between rest and the orbit's, at which powers are balanced
_DEEPEST = 0.99  # share of the orbit's energy that the smallest of them is short of
_RATIO = math.sqrt(2)  # between the gain factors that are looked at
_LARGEST = 1024.0  # gain factor
_PARTS = 32  # of a period, between the delays that are looked at
_HALVINGS = 16


@dataclass(frozen=True, kw_only=True)
class Margins:
    """What the loop bears, one change at a time."""

    # factors on gamma between which an orbit is held; 0 and infinity are no limit to a thousandfold
    gain: tuple[float, float]
    delay: float  # further s up to which one is held; infinity where a whole period is borne
    multiplier: float  # size of the largest nontrivial Floquet multiplier of the loop as it is


def loop_margins(orbit: Orbit, gamma: float, *, lag: float = 0.0) -> Margins:
    """Return the gain and delay margins of the loop about its orbit, by bisection.

    The loop is a periodic one and has no single frequency response. What is multiplied is the
    feedback of the energy; what is delayed is the whole command. The margins are the first factor
    and the first delay with which either

    - a nontrivial Floquet multiplier leaves the unit circle, or
    - friction, compensated late, takes more energy from every smaller swing than the feedback
      gives, and the hand comes to rest; or from every slower turn, and it falls back. Powers are
      balanced over a period of the orbit of that energy; a swing is slowed by the part of the
      command in phase with the angle.

    Within the margins the loop holds an orbit, but with friction and a delay not quite the wanted
    one, and a wrong p4 moves it too. The delay of the orbit's parameters is in the loop, and the
    lag of its armature, counted as a delay; ``lag`` in s is what the controller adds.
    """
    require_number("loop_margins", lag=lag)
    require_number("loop_margins", positive=True, gamma=gamma)
    p = orbit.parameters
    now = max(p.delay, 0.0) + p.time_constant + lag
    transverse, smaller = _Transverse(orbit), _Smaller(orbit)

    def holds(factor: float, more: float) -> bool:
        strength, delay = factor * gamma, now + more
        return smaller.carry(strength, delay) and transverse.multiplier(strength, delay) < 1

    multiplier = transverse.multiplier(gamma, now)
    if not holds(1.0, 0.0):
        finding = f"Floquet multiplier {multiplier:.3g} with {now:.3g} s of lag"
        expected = "a stable orbit; reduce the lag or change gamma"
        raise InputError("loop_margins", "loop", finding, expected)
    factors = np.geomspace(_RATIO, _LARGEST, round(math.log(_LARGEST, _RATIO)))
    delays = orbit.period * np.arange(1, _PARTS + 1) / _PARTS
    low, high = (
        _edge(lambda factor: holds(factor, 0.0), 1.0, others, none)
        for others, none in ((1 / factors, 0.0), (factors, math.inf))
    )
    late = _edge(lambda more: holds(1.0, more), 0.0, delays, math.inf)
    return Margins(gain=(low, high), delay=late, multiplier=multiplier)


class _Transverse:
    """The loop's linearisation along its orbit, at the Gauss nodes of the period's steps."""

    def __init__(self, orbit: Orbit) -> None:
        p, self._step = orbit.conserving, orbit.period / _STEPS
        times = ((np.arange(_STEPS)[:, None] + _NODES) * self._step).ravel()
        angle, velocity = orbit.solution(times)
        pulls = np.array([pull(p, x) for x in angle.tolist()])
        slopes = np.array([LinearJoint.of(p, x).stiffness for x in angle.tolist()])
        change = np.stack([-pulls, p.p1 * velocity], axis=1)
        begin, speed = orbit.start
        self._flow = speed, pull(p, begin) / p.p1  # velocity and acceleration at first
        self._fall = slopes / p.p1  # (2 steps,) in 1/s^2
        # (2 steps, 2) acceleration per angle and velocity, gamma 1
        self._feedback = -abs(p.p4) / p.p1 * velocity[:, None] * change

    def multiplier(self, gamma: float, delay: float) -> float:
        """Return the size of the largest nontrivial Floquet multiplier of the late loop.

        p1 thdd = pull - |p4| gamma [thd (E - E*)](t - delay): (104) with (109), friction made up
        for on time. The late loop has the very same orbit, on which the bracket vanishes, and its
        variational equation feeds back thd times the change of E, integrated over a period from
        `Orbit.start` on.

        The delay is Padé's, the steps are those of the Magnus series of fourth order (Iserles &
        Nørsett, Phil. Trans. R. Soc. A 357, 1999). The shift along the orbit, in which the delay's
        states do not take part, keeps its size: across it the monodromy matrix has the other
        multipliers.
        """
        feedback, size = gamma * self._feedback, 2 + _ORDER * (delay > 0)
        rates = np.zeros((self._fall.size, size, size))
        rates[:, 0, 1] = 1.0
        rates[:, 1, 0] = -self._fall
        if delay > 0:
            late = DelayStates.of(delay, _ORDER)
            rates[:, 2:, 2:] = late.a
            rates[:, 2:, :2] = late.b[:, None] * feedback[:, None, :]
            rates[:, 1, 2:] = late.c
            feedback = late.feedthrough * feedback
        rates[:, 1, :2] += feedback
        first, second = rates[::2], rates[1::2]
        mean = 0.5 * self._step * (first + second)
        twist = self._step**2 * math.sqrt(3) / 12 * (second @ first - first @ second)
        monodromy = np.eye(size)
        for part in _exponential(mean + twist):
            monodromy = part @ monodromy
        across = np.linalg.svd([[*self._flow, *np.zeros(size - 2)]])[2][1:]
        return float(np.abs(np.linalg.eigvals(across @ monodromy @ across.T)).max())


class _Smaller:
    """Orbits of the same kind and less energy, and what the loop does to them in a period."""

    def __init__(self, orbit: Orbit) -> None:
        self._orbit, p = orbit, orbit.parameters
        shares = np.sin(np.pi * (np.arange(_LEVELS) + 0.5) / _LEVELS / 2) ** 2
        self._missing = _DEEPEST * (orbit.energy - orbit.least) * shares  # (n,) J short of it
        energies = (orbit.energy - self._missing).tolist()
        orbits = [Orbit.of_energy(p, energy, orbit.direction or 1) for energy in energies]
        self._periods = np.array([smaller.period for smaller in orbits])
        times = np.arange(_SAMPLES) / _SAMPLES
        motions = np.array([smaller.solution(times * smaller.period) for smaller in orbits])
        angle, self._velocity = motions[:, 0], motions[:, 1]  # (n, samples)
        # a term's basis need not take arrays
        states = np.stack([angle, self._velocity], axis=-1).reshape(-1, 2).tolist()
        friction = [made_up(p, p.motion(*state), DISSIPATIVE) for state in states]
        self._friction = np.reshape(friction, angle.shape)

    def carry(self, gamma: float, delay: float) -> bool:
        """Return whether any of them gains energy in a period of the late loop.

        Its frequency w in rad/s solves w^2 + w strength/p1 sin(w delay) = (2 pi/T)^2.
        """
        p, velocity, free = self._orbit.parameters, self._velocity, 2 * np.pi / self._periods
        command = self._friction + abs(p.p4) * gamma * self._missing[:, None] * velocity
        strength = np.mean(command * velocity, axis=1) / np.mean(velocity**2, axis=1)
        strength *= not self._orbit.direction  # a turn is not slowed
        low, high = np.zeros_like(free), free
        for _ in range(_HALVINGS):
            omega = 0.5 * (low + high)
            slow = omega**2 + omega * strength / p.p1 * np.sin(omega * delay) < free**2
            low, high = np.where(slow, omega, low), np.where(slow, high, omega)
        turns = np.arange(_SAMPLES // 2 + 1) * (high * delay / (2 * np.pi))[:, None]
        late = np.fft.irfft(np.fft.rfft(command) * np.exp(-2j * np.pi * turns), _SAMPLES)
        return bool((np.mean((late - self._friction) * velocity, axis=1) > 0).any())


def _exponential(exponents: Samples) -> Samples:
    """Return Padé's third order of exponentials of (n, k, k) matrices; SciPy's own are slower."""
    one, square = np.eye(exponents.shape[-1]), exponents @ exponents
    even, odd = one + square / 10, exponents @ (one / 2 + square / 120)
    return np.asarray(np.linalg.solve(even - odd, even + odd))


def _edge(holds: Callable[[float], bool], inside: float, others: Samples, none: float) -> float:
    """Return where the orbit is first lost going through ``others``, or ``none`` if nowhere."""
    for other in map(float, others):
        if not holds(other):
            break
        inside = other
    else:
        return none
    outside = other
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if holds(middle) else (inside, middle)
    return 0.5 * (inside + outside)
