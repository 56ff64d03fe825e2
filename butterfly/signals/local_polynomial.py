"""Slopes of local polynomials (Savitzky & Golay, Anal. Chem. 36, 1964)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from butterfly.compiled import compiled

Samples = NDArray[np.float64]

_BLOCK = 1024  # samples that stay in the fastest cache


def slope(values: Samples, reach: int, order: int, step: float) -> Samples:
    """Return the slope of the polynomial that fits the samples about each one best.

    Within ``reach`` of an end, it is that of the polynomial of the first or last window.

    Of (n,) samples, n at least 2 `reach` + 1, `step` s apart; windows reach as many samples to
    either side. Returns (n,) slopes in the samples' unit over s.
    """
    weights = _weights(reach, order)
    width = 2 * reach + 1
    begin = weights[:-1] @ (values[:width] - values[0])  # so that where all are alike it is 0
    end = weights[:-1] @ (values[-1] - values[: -width - 1 : -1])
    inner = _antisymmetric(values, weights[-1, reach + 1 :])
    return np.concatenate([begin, inner, end[::-1]]) / step


@lru_cache(maxsize=64)
def _weights(reach: int, order: int) -> Samples:
    """(reach + 1, 2 reach + 1): by row, slope at a sample up to the middle of a window."""
    x = np.arange(-reach, reach + 1) / reach
    rise = legendre.legval(x[: reach + 1], legendre.legder(np.eye(order + 1)))
    return np.asarray(rise.T @ np.linalg.pinv(legendre.legvander(x, order)) / reach)


@compiled
def _antisymmetric(values, weights):
    """Sum each sample's differences between right and left, the i-th weighted by weights[i - 1].

    Sample after sample inside, weight after weight outside: so the machine adds several at once.
    """
    reach = weights.size
    result = np.zeros(values.size - 2 * reach)
    for start in range(0, result.size, _BLOCK):
        block = result[start : start + _BLOCK]
        for k in range(1, reach + 1):
            middle, weight = start + reach, weights[k - 1]
            right = values[middle + k : middle + k + block.size]
            left = values[middle - k : middle - k + block.size]
            for i in range(block.size):
                block[i] += weight * (right[i] - left[i])
    return result
