"""Test functions, bumps (1 - s^2)^4 that overlap, and what signals average to over each."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

SPACING = 0.5
"""Of the test functions, in half-widths."""


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

    def means(self, signal: NDArray[np.float64], order: int = 0) -> NDArray[np.float64]:
        """(m,) integrals of an (n,) signal against the ``order``-th derivative of each.

        Over the bump's area; in the signal's unit, over s to the power ``order``.
        """
        weights = self._weights[order]
        stride, parts = weights.shape
        rows = self.centres.size + parts - 1
        first = self.margin - self._reach
        pieces = signal[first : first + rows * stride]
        if pieces.size < rows * stride:  # the last bump ends within its last part
            pieces = np.concatenate([pieces, np.zeros(rows * stride - pieces.size)])
        sums = pieces.reshape(rows, stride) @ weights
        return np.asarray(sum(sums[k : rows - parts + 1 + k, k] for k in range(parts)))

    @property
    def _stride(self) -> int:
        return max(1, round(SPACING * self.half_width / self.step))

    @property
    def _reach(self) -> int:
        """Samples inside a bump on either side of its centre."""
        return math.ceil(self.half_width / self.step) - 1

    @cached_property
    def _weights(self) -> NDArray[np.float64]:
        """(3, stride, parts) a bump and its derivatives over its area, cut where others begin.

        So the signal is cut once, and every piece multiplied once for all bumps that share it.
        """
        s = np.arange(-self._reach, self._reach + 1) * self.step / self.half_width
        inside = 1 - s**2
        derivatives = np.array(
            [
                inside**4,
                -8 * s * inside**3 / self.half_width,
                (-8 * inside**3 + 48 * s**2 * inside**2) / self.half_width**2,
            ]
        )
        parts = -(-s.size // self._stride)
        weights = np.zeros((3, parts * self._stride))
        weights[:, : s.size] = derivatives / derivatives[0].sum()
        return np.ascontiguousarray(weights.reshape(3, parts, self._stride).swapaxes(1, 2))
