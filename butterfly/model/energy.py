"""Energy of the hand, friction and motor aside (105), and the periodic orbits it has."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from butterfly.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from butterfly.model.parameters import LumpedParameters

_GRID = 721  # angles in a turn at which the potential is looked at
_POINTS = 1000  # of the quadrature over half a period


def potential(p: LumpedParameters, angle: float) -> float:
    """Potential energy in J above that at angle 0: gravity, offset, bias and cogging."""
    raised = 2 * p.p3 * math.sin(angle / 2) ** 2 + p.p3_offset * math.sin(angle) - p.bias * angle
    turned = p.cogging_periods * angle
    raised -= 2 * p.cogging / p.cogging_periods * math.sin(turned / 2) ** 2
    return raised - p.cogging_cosine / p.cogging_periods * math.sin(turned)


def pull(p: LumpedParameters, angle: float) -> float:
    """Torque in N m of the potential at an angle in rad: its slope, downwards."""
    turned = p.cogging_periods * angle
    torque = p.bias - p.p3 * math.sin(angle) - p.p3_offset * math.cos(angle)
    return torque + p.cogging * math.sin(turned) + p.cogging_cosine * math.cos(turned)


def stiffness(p: LumpedParameters, angle: float) -> float:
    """Curvature in N m/rad of the potential at an angle in rad."""
    turned = p.cogging_periods * angle
    ripple = p.cogging * math.cos(turned) - p.cogging_cosine * math.sin(turned)
    weight = p.p3 * math.cos(angle) - p.p3_offset * math.sin(angle)
    return weight - p.cogging_periods * ripple


def energy(p: LumpedParameters, angle: float, velocity: float) -> float:
    """E = p1 thd^2/2 + potential (105), in J."""
    return 0.5 * p.p1 * velocity**2 + potential(p, angle)


@dataclass(frozen=True, kw_only=True)
class Orbit:
    """A periodic swing of the hand without friction, about its lowest potential energy.

    Parameters
    ----------
    parameters
        Of the hand with what it carries.
    energy
        E* in J.
    lower, upper
        Angles in rad at which it turns back.
    """

    parameters: LumpedParameters
    energy: float
    lower: float
    upper: float

    @classmethod
    def of_energy(cls, parameters: LumpedParameters, target: float) -> Orbit:
        """Take the orbit of an energy E* in J.

        Raises
        ------
        InputError
            If it is not between the energy at rest and that at which the hand turns over; for a
            plain pendulum, 0 < E* < 2 p3 (the condition that (108) means).
        """
        angles = np.linspace(-math.pi, math.pi, _GRID)
        levels = np.array([potential(parameters, angle) for angle in angles.tolist()])
        bottom = int(np.argmin(levels))
        wall = min(float(levels[: bottom + 1].max()), float(levels[bottom:].max()))
        floor = float(levels[bottom])
        if not floor < target < wall:
            raise InputError(
                "orbit",
                "energy",
                f"{target:.6g} J",
                f"between {floor:.6g} J, at rest, and {wall:.6g} J, where the hand turns over",
            )

        def excess(angle: float) -> float:
            return potential(parameters, angle) - target

        below = np.flatnonzero(levels[:bottom] > target)[-1]
        above = bottom + np.flatnonzero(levels[bottom:] > target)[0]
        lower = brentq(excess, angles[below], angles[below + 1], xtol=1e-15)
        upper = brentq(excess, angles[above - 1], angles[above], xtol=1e-15)
        return cls(parameters=parameters, energy=target, lower=lower, upper=upper)

    @classmethod
    def of_amplitude(cls, parameters: LumpedParameters, amplitude: float) -> Orbit:
        """Take the orbit that turns back at ``amplitude`` rad on the positive side.

        Raises
        ------
        InputError
            If there is none.
        """
        if not 0 < amplitude < math.pi:
            raise InputError("orbit", "amplitude", f"{amplitude:g} rad", "between 0 and pi")
        return cls.of_energy(parameters, potential(parameters, amplitude))

    @classmethod
    def of_state(cls, parameters: LumpedParameters, angle: float, velocity: float) -> Orbit:
        """Take the orbit through a state in rad and rad/s.

        Raises
        ------
        InputError
            If there is none.
        """
        return cls.of_energy(parameters, energy(parameters, angle, velocity))

    @property
    def period(self) -> float:
        """T in s, by quadrature."""
        return 2 * self._over_angle(lambda speed: 1 / speed)

    @property
    def squared_speed(self) -> float:
        """Integral of thd^2 over one period, in rad^2/s, by quadrature."""
        return 2 * self._over_angle(lambda speed: speed)

    def solution(self, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return (n,) angles and velocities of the nominal motion, released at `upper`."""
        p = self.parameters

        def rhs(_: float, state: NDArray[np.float64]) -> list[float]:
            return [float(state[1]), pull(p, float(state[0])) / p.p1]

        span = (0.0, float(times[-1]) if times.size else 0.0)
        solved = solve_ivp(rhs, span, [self.upper, 0.0], "DOP853", times, rtol=1e-12, atol=1e-13)
        return solved.y[0], solved.y[1]

    def _over_angle(self, integrand: Callable[[float], float]) -> float:
        """Integrate a function of the speed over the angle, its square-root ends straightened."""
        p, middle = self.parameters, 0.5 * (self.lower + self.upper)
        reach = 0.5 * (self.upper - self.lower)

        # In the phase the integrand is periodic and smooth: the midpoint rule converges
        # exponentially.
        total, step = 0.0, math.pi / _POINTS
        for k in range(_POINTS):
            phase = (k + 0.5) * step - math.pi / 2
            left = self.energy - potential(p, middle + reach * math.sin(phase))
            total += integrand(math.sqrt(2 * left / p.p1)) * reach * math.cos(phase)
        return total * step
