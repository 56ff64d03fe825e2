"""A delay as a linear system, by Padé's approximation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError

HIGHEST_ORDER = 10
"""Of this order a delay of half a turn is exact to rounding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DelayStates:
    """x' = a x + b u, y = c x + feedthrough u, where y is u later."""

    # a, b, c: (n, n), (n,) and (n,)
    a: NDArray[np.float64]
    b: NDArray[np.float64]
    c: NDArray[np.float64]
    feedthrough: float  # 1 or -1: every frequency comes through at its size

    @classmethod
    def of(cls, delay: float, order: int) -> DelayStates:
        """Approximate exp(-s delay) by a fraction of polynomials, both of the same order.

        At w rad/s it is off by (n!)^2/((2n)! (2n + 1)!) (w delay)^(2n + 1) and less beyond (Baker &
        Graves-Morris, Padé Approximants, 1996, 1.2).

        The delay, in s, is above 0 and the order n from 1 to `HIGHEST_ORDER`: an InputError
        otherwise.
        """
        if not delay > 0:
            raise InputError("Padé", "delay", delay, "a positive number of s")
        if not isinstance(order, int) or order not in range(1, HIGHEST_ORDER + 1):
            raise InputError(
                "Padé", "order", order, f"a whole number between 1 and {HIGHEST_ORDER}"
            )
        powers = np.arange(order + 1)
        size = [
            math.comb(order, int(k)) * math.perm(2 * order - int(k), order - int(k)) for k in powers
        ]
        # In time in units of delay/rate all coefficients are of one size.
        rate = float(size[0]) ** (1 / order)
        below = np.array(size, dtype=np.float64) * rate ** (powers - order)
        sign = (-1.0) ** powers
        a = np.diag(np.ones(order - 1), 1)
        a[-1] = -below[:-1]
        feedthrough = sign[-1]
        return cls(
            a=a * rate / delay,
            b=np.eye(order)[-1] * rate / delay,
            c=(sign * below - feedthrough * below)[:-1],
            feedthrough=float(feedthrough),
        )
