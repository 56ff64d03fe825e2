"""Energy of the joint without friction and motor (105), and its periodic orbits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import CONSERVATIVE, Term, torque_of

_GRID = 721  # angles at which the potential is evaluated
_POINTS = 1000  # of the quadrature over half a period
_ASIDE = 1e-20  # rad, of an imaginary step


def potential(
    p: LumpedParameters,
    angle: Any,  # noqa: ANN401
    rows: Iterable[Term] = CONSERVATIVE,
) -> Any:  # noqa: ANN401
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


def stiffness(p: LumpedParameters, angle: float) -> float:
    """Curvature in N m/rad of the potential at an angle in rad.

    The imaginary part of the slope at a complex angle next to the real one, which is exact to
    rounding (Squire & Trapp, SIAM Review 40, 1998).
    """
    beside = p.motion(angle + 1j * _ASIDE, 0.0)
    return float(np.imag(torque_of(p, beside, CONSERVATIVE)) / _ASIDE)


def energy(
    p: LumpedParameters,
    angle: Any,  # noqa: ANN401
    velocity: Any,  # noqa: ANN401
    rows: Iterable[Term] = CONSERVATIVE,
) -> Any:  # noqa: ANN401
    """E = p1 thd^2/2 + `potential` (105), in J; of numbers, or of arrays."""
    return 0.5 * p.p1 * velocity**2 + potential(p, angle, rows)


@dataclass(frozen=True, kw_only=True)
class Orbit:
    """A periodic swing without friction about the lowest potential energy."""

    parameters: LumpedParameters  # Of the loaded joint
    energy: float  # E* in J
    # lower, upper: Angles in rad of reversal
    lower: float
    upper: float

    @classmethod
    def of_energy(cls, parameters: LumpedParameters, target: float) -> Orbit:
        """Return the orbit of an energy E* in J, between rest and turning over.

        For a plain pendulum 0 < E* < 2 p3, the condition meant by (108). A joint with p3 < 0 rests
        upside down and swings about pi.
        """
        turn = np.linspace(-math.pi, math.pi, _GRID)
        lowest = turn[np.argmin(potential(parameters, turn))]
        angles = lowest + 1.5 * np.linspace(-math.pi, math.pi, _GRID)
        levels = potential(parameters, angles)
        bottom = _GRID // 2
        wall = min(float(levels[:bottom].max()), float(levels[bottom:].max()))
        floor = float(levels.min(initial=levels[bottom], where=np.abs(angles - lowest) < math.pi))
        if not floor < target < wall:
            raise InputError(
                "orbit",
                "energy",
                f"{target:.6g} J",
                f"between {floor:.6g} J (at rest) and {wall:.6g} J (where the joint turns over)",
            )

        def excess(angle: float) -> float:
            return float(potential(parameters, angle)) - target

        below = np.flatnonzero(levels[:bottom] > target)[-1]
        above = bottom + np.flatnonzero(levels[bottom:] > target)[0]
        lower = brentq(excess, angles[below], angles[below + 1], xtol=1e-15)
        upper = brentq(excess, angles[above - 1], angles[above], xtol=1e-15)
        return cls(parameters=parameters, energy=target, lower=lower, upper=upper)

    @classmethod
    def of_amplitude(cls, parameters: LumpedParameters, amplitude: float) -> Orbit:
        """Return the orbit that reverses at ``amplitude`` rad on the positive side."""
        if not 0 < amplitude < math.pi:
            raise InputError("orbit", "amplitude", f"{amplitude:g} rad", "between 0 and pi rad")
        return cls.of_energy(parameters, float(potential(parameters, amplitude)))

    @classmethod
    def of_state(cls, parameters: LumpedParameters, angle: float, velocity: float) -> Orbit:
        """Return the orbit through a state in rad and rad/s."""
        return cls.of_energy(parameters, float(energy(parameters, angle, velocity)))

    @property
    def period(self) -> float:
        """T in s, by quadrature."""
        return 2 * self._over_angle(lambda speed: 1 / speed)

    @property
    def squared_speed(self) -> float:
        """Integral of thd^2 over one period, in rad^2/s, by quadrature."""
        return 2 * self._over_angle(lambda speed: speed)

    def solution(self, times: Samples) -> tuple[Samples, ...]:
        """Return (n,) angles and velocities of the nominal motion, released at `upper`."""
        from scipy.integrate import solve_ivp  # noqa: PLC0415 - slow to import

        p = self.parameters

        def rhs(_: float, state: Samples) -> list[float]:
            return [float(state[1]), pull(p, float(state[0])) / p.p1]

        span = (0.0, float(times[-1]) if times.size else 0.0)
        solved = solve_ivp(rhs, span, [self.upper, 0.0], "DOP853", times, rtol=1e-12, atol=1e-13)
        return solved.y[0], solved.y[1]

    def _over_angle(self, integrand: Callable[[Samples], Samples]) -> float:
        """Integrate a function of the speed over the angle, its square-root ends straightened.

        In the phase the integrand is periodic and smooth: the midpoint rule converges
        exponentially.
        """
        p, middle = self.parameters, 0.5 * (self.lower + self.upper)
        reach, step = 0.5 * (self.upper - self.lower), math.pi / _POINTS
        phase = (np.arange(_POINTS) + 0.5) * step - math.pi / 2
        left = self.energy - potential(p, middle + reach * np.sin(phase))
        return float(np.sum(integrand(np.sqrt(2 * left / p.p1)) * reach * np.cos(phase)) * step)
