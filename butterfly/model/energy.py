"""Energy of the joint without friction and motor (105), and its periodic orbits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import CONSERVATIVE, Term, torque_of

_GRID = 721  # angles at which the potential is evaluated
_POINTS = 1000  # of the quadrature over half a period
_NEAREST = 1e-3  # of the energy from rest to the top: so small an error decides what the hand does


def potential(p: LumpedParameters, angle: Any, rows: Iterable[Term] = CONSERVATIVE) -> Any:  # noqa: ANN401
    """Potential energy in J of the loaded joint relative to angle 0, of `rows` with a potential."""
    total = 0.0 * angle
    for row in rows:
        value = getattr(p, row.name)
        if value:
            assert row.potential is not None  # noqa: S101 - or it would not be conservative
            total = total + value * row.potential(angle, p.cogging_periods)
    return total


def pull(p: LumpedParameters, angle: float) -> float:
    """Torque in N m of the potential at an angle in rad: its slope, downwards."""
    return -torque_of(p, p.motion(angle, 0.0), CONSERVATIVE)  # type: ignore[no-any-return]


def energy(p: LumpedParameters, angle: Any, velocity: Any) -> Any:  # noqa: ANN401
    """E = p1 thd^2/2 + `potential` (105), in J; of numbers, or of arrays."""
    return 0.5 * p.p1 * velocity**2 + potential(p, angle)


@dataclass(frozen=True, kw_only=True)
class Orbit:
    """A periodic motion without friction: a swing about the lowest energy, or turns one way round.

    While a hand turns over, a bias is no part of its energy, which would otherwise not be periodic:
    the control makes up for it as for friction.
    """

    parameters: LumpedParameters  # Of the loaded joint
    energy: float  # E* in J
    # lower, upper: Angles in rad of reversal; of a hand that turns over, a turn about its rest
    lower: float
    upper: float
    direction: int = 0  # 1 or -1 of a hand that turns over, 0 of a swing

    @classmethod
    def of_energy(cls, parameters: LumpedParameters, target: float, direction: int = 1) -> Orbit:
        """Return the orbit of an energy E* in J: a swing, or above the top one that turns over.

        For a plain pendulum these are 0 < E* < 2 p3 and E* > 2 p3, the condition meant by (108); in
        the latter case ``direction`` is 1 or -1. A joint with p3 < 0 rests upside down and swings
        about pi.
        """
        if direction not in {1, -1}:
            raise InputError("orbit", "direction", direction, "1 or -1")
        turn = np.linspace(-math.pi, math.pi, _GRID)
        lowest = turn[np.argmin(potential(parameters, turn))]
        angles = lowest + 1.5 * turn
        levels = potential(parameters, angles)
        about: dict[str, Any] = {"parameters": parameters, "energy": target}
        bottom = _GRID // 2
        wall = min(float(levels[:bottom].max()), float(levels[bottom:].max()))
        floor = float(levels.min(initial=levels[bottom], where=np.abs(angles - lowest) < math.pi))
        rest, least = _turning(parameters)
        if target > floor and target >= max(least, wall):
            return cls(**about, lower=rest - math.pi, upper=rest + math.pi, direction=direction)
        most = wall - _NEAREST * (wall - floor)
        if not floor < target <= most:
            expected = (
                f"between {floor:.6g} J (at rest) and {most:.6g} J (of a swing), or at least "
                f"{least:.6g} J (where the joint turns over)"
            )
            if target > most:
                expected += (
                    f"; in between, an error of {_NEAREST:.1%} in the model decides which it is"
                )
            raise InputError("orbit", "energy", f"{target:.6g} J", expected)
        above = np.flatnonzero(levels > target)
        lower, upper = (
            brentq(
                lambda x: float(potential(parameters, x)) - target, *angles[k : k + 2], xtol=1e-15
            )
            for k in (above[above < bottom][-1], above[above >= bottom][0] - 1)
        )
        return cls(**about, lower=lower, upper=upper)

    @classmethod
    def of_amplitude(cls, parameters: LumpedParameters, amplitude: float) -> Orbit:
        """Return the orbit that reverses at ``amplitude`` rad on the positive side."""
        if not 0 < amplitude < math.pi:
            raise InputError("orbit", "amplitude", f"{amplitude:g} rad", "between 0 and pi rad")
        return cls.of_energy(parameters, float(potential(parameters, amplitude)))

    @classmethod
    def of_speed(cls, parameters: LumpedParameters, speed: float) -> Orbit:
        """Return the orbit that turns over at a mean ``speed`` in rad/s, either way round."""
        least = _turning(parameters)[1] + 1e-12 * parameters.p1 * speed**2
        direction = 1 if speed > 0 else -1

        def missing(target: float) -> float:
            return abs(speed) - abs(cls.of_energy(parameters, target, direction).mean_speed)

        if missing(least) > 0:
            most = least + parameters.p1 * speed**2
            return cls.of_energy(parameters, brentq(missing, least, most, xtol=1e-15), direction)
        slowest = cls.of_energy(parameters, least).mean_speed
        expected = (
            f"more than {slowest:.6g} rad/s in either direction: if slower, an error of "
            f"{_NEAREST:.1%} in the model decides whether the joint turns over"
        )
        raise InputError("orbit", "speed", f"{speed:.6g} rad/s", expected)

    @classmethod
    def of_state(cls, parameters: LumpedParameters, angle: float, velocity: float) -> Orbit:
        """Return the orbit through a state in rad and rad/s, in the direction of its velocity."""
        turning = float(energy(replace(parameters, bias=0.0), angle, velocity))
        if turning >= _turning(parameters)[1]:
            return cls.of_energy(parameters, turning, 1 if velocity > 0 else -1)
        return cls.of_energy(parameters, float(energy(parameters, angle, velocity)))

    def of_same_size(self, parameters: LumpedParameters) -> Orbit:
        """Return the orbit of other parameters with this upper reversal, or mean speed."""
        if self.direction:
            return Orbit.of_speed(parameters, self.mean_speed)
        return Orbit.of_amplitude(parameters, self.upper)

    @property
    def conserving(self) -> LumpedParameters:
        """Parameters with whose potential the energy is conserved along it."""
        return replace(self.parameters, bias=0.0) if self.direction else self.parameters

    @property
    def start(self) -> tuple[float, float]:
        """Angle in rad and velocity in rad/s where it begins: `upper`, or rest if it turns over."""
        if not self.direction:
            return self.upper, 0.0
        middle = 0.5 * (self.lower + self.upper)
        return middle, self.direction * float(self._speed(middle))

    @property
    def period(self) -> float:
        """T in s, of a swing to and fro or of a turn, by quadrature."""
        return self._over_angle(lambda speed: 1 / speed)

    @property
    def squared_speed(self) -> float:
        """Integral of thd^2 over one period, in rad^2/s, by quadrature."""
        return self._over_angle(lambda speed: speed)

    @property
    def mean_speed(self) -> float:
        """Mean velocity in rad/s, with its sign; 0 of a swing."""
        return self.direction * 2 * math.pi / self.period

    @property
    def size(self) -> float:
        """Amplitude in rad of a swing; `mean_speed` of a hand that turns over."""
        return self.mean_speed if self.direction else 0.5 * (self.upper - self.lower)

    @property
    def least(self) -> float:
        """Lower limit in J of the energy of orbits of its kind: that at rest, or at the top."""
        if self.direction:
            return _turning(self.parameters)[1]
        return float(potential(self.parameters, np.linspace(self.lower, self.upper, _GRID)).min())

    def solution(self, times: Samples) -> tuple[Samples, ...]:
        """Return (n,) angles and velocities of the nominal motion, begun at `start`."""
        from scipy.integrate import solve_ivp  # noqa: PLC0415 - slow to import

        p = self.conserving

        def rhs(_: float, state: Samples) -> list[float]:
            return [float(state[1]), pull(p, float(state[0])) / p.p1]

        span = (0.0, float(times[-1]) if times.size else 0.0)
        solved = solve_ivp(rhs, span, self.start, "DOP853", times, rtol=1e-12, atol=1e-13)
        return solved.y[0], solved.y[1]

    def _speed(self, angle: Any) -> Any:  # noqa: ANN401
        """Speed in rad/s on the orbit at angles in rad."""
        return np.sqrt(2 * (self.energy - potential(self.conserving, angle)) / self.parameters.p1)

    def _over_angle(self, integrand: Callable[[Samples], Samples]) -> float:
        """Integrate a function of the speed over the angle, for a period."""
        # of a swing over the phase, which straightens the square-root ends: so the integrand is
        # periodic and smooth, and the midpoint rule converges exponentially
        middle, reach = 0.5 * (self.lower + self.upper), 0.5 * (self.upper - self.lower)
        step = math.pi / _POINTS
        if self.direction:
            angles = self.lower + (np.arange(2 * _POINTS) + 0.5) * step
            return float(np.sum(integrand(self._speed(angles))) * step)
        phase = (np.arange(_POINTS) + 0.5) * step - math.pi / 2
        speeds = self._speed(middle + reach * np.sin(phase))
        return float(2 * np.sum(integrand(speeds) * reach * np.cos(phase)) * step)


def _turning(parameters: LumpedParameters) -> tuple[float, float]:
    """Return the angle in rad of rest without bias, and the least energy in J of turning over."""
    turn = np.linspace(-math.pi, math.pi, _GRID)
    levels = potential(replace(parameters, bias=0.0), turn)
    least = levels.max() + _NEAREST * np.ptp(levels)
    return float(turn[np.argmin(levels)]), float(least)
