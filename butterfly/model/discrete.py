"""The linearisation seen through a zero-order hold: Lemma 4, (46)-(52)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from butterfly.errors import InputError
from butterfly.model.parameters import LumpedParameters


@dataclass(frozen=True, kw_only=True)
class HeldSystem:
    """The difference equation y[k+2] + a1 y[k+1] + a0 y[k] = b1 u[k+1] + b0 u[k] (46)."""

    # a1, a0, b1, b0: Its coefficients (47)-(50); the last two in rad per unit of input
    a1: float
    a0: float
    b1: float
    b0: float
    step: float  # Sampling period in s

    @classmethod
    def of(cls, parameters: LumpedParameters, step: float) -> HeldSystem:
        """Discretise the linearisation about the hanging position.

        An InputError if it is not underdamped (45), or the step not positive.
        """
        p = parameters
        if not step > 0:
            raise InputError("HeldSystem", "step", step, "a positive number of s")
        damping = p.p2 / (2 * math.sqrt(p.p1 * p.p3)) if p.p3 > 0 else math.inf
        if not 0 < damping < 1:
            raise InputError(
                "HeldSystem", "damping ratio", f"{damping:.3g}", "between 0 and 1 (45)"
            )
        natural = math.sqrt(p.p3 / p.p1)
        root = math.sqrt(1 - damping**2)
        decay = math.exp(-step * damping * natural)
        turn, beta = step * natural * root, math.acos(damping)
        gain = p.p4 / p.p3
        return cls(
            a1=-2 * decay * math.cos(turn),
            a0=decay**2,
            b1=gain * (1 - decay / root * math.sin(turn + beta)),
            b0=gain * (decay**2 + decay / root * math.sin(turn - beta)),
            step=step,
        )

    def response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """G_q(e^(j w step)) at frequencies in rad/s; it holds for a held input only."""
        z = np.exp(1j * np.asarray(omega, dtype=np.float64) * self.step)
        return np.asarray((self.b1 * z + self.b0) / (z**2 + self.a1 * z + self.a0))
