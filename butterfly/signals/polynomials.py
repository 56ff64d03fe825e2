"""Cubic Hermite polynomials between a simulation's instants, and the slopes of local ones.

The local ones are those of Savitzky & Golay (Anal. Chem. 36, 1964).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.compiled import compiled

_BLOCK = 1024  # samples that stay in the fastest cache


def averages(
    grid: Samples, instants: Samples, values: Samples
) -> tuple[NDArray[np.int64], Samples, Samples]:
    """Average the polynomials, and values, over the instants in each interval of a grid.

    What is averaged is linear in the ends of the interval, so that four numbers, worked out once,
    stand for many instants.

    Returns (n - 1,) numbers of the average of each interval, -1 where it holds no instant; (4, k)
    weights of angle and velocity at its start, and at its end; and (k,) mean values.
    """
    into = np.empty(grid.size - 1, dtype=np.int64)
    means = np.empty((5, grid.size - 1))
    count = _averages(grid, instants, values, into, means)
    return into, np.ascontiguousarray(means[:4, :count]), means[4, :count].copy()


@compiled
def _cubic(grid, angle, velocity, cell):
    """Coefficients of 1, s, s^2 and s^3, s running from 0 to 1 over the interval; and 1/length."""
    length = grid[cell + 1] - grid[cell]
    start, end = length * velocity[cell], length * velocity[cell + 1]
    rise = angle[cell + 1] - angle[cell]
    return (
        angle[cell],
        start,
        3.0 * rise - 2.0 * start - end,
        start + end - 2.0 * rise,
        1.0 / length,
    )


@compiled
def interpolate(grid, angle, velocity, instants):
    """Return the (m,) angles at increasing instants.

    From (n,) angles in rad and velocities in rad/s on an increasing grid in s. Beyond the grid the
    outermost polynomials go on.
    """
    result = np.empty(instants.size)
    k, last = 0, grid.size - 2
    for cell in range(grid.size - 1):
        c0, c1, c2, c3, rate = _cubic(grid, angle, velocity, cell)
        while k < instants.size and (instants[k] < grid[cell + 1] or cell == last):
            s = (instants[k] - grid[cell]) * rate
            result[k] = c0 + s * (c1 + s * (c2 + s * c3))
            k += 1
    return result


@compiled
def _averages(grid, instants, values, into, means):
    """Fill ``into`` and the columns of ``means``; return how many are filled."""
    k, last, count = 0, grid.size - 2, 0
    for cell in range(grid.size - 1):
        length = grid[cell + 1] - grid[cell]
        rate, first = 1.0 / length, k
        one = two = three = value = 0.0  # sums of s, s^2, s^3 and the values
        while k < instants.size and (instants[k] < grid[cell + 1] or cell == last):
            s = (instants[k] - grid[cell]) * rate
            one += s
            two += s * s
            three += s * s * s
            value += values[k]
            k += 1
        into[cell] = -1
        if k > first:
            share = 1.0 / (k - first)
            one, two, three = share * one, share * two, share * three
            means[0, count] = 1.0 - 3.0 * two + 2.0 * three
            means[1, count] = length * (one - 2.0 * two + three)
            means[2, count] = 3.0 * two - 2.0 * three
            means[3, count] = length * (three - two)
            means[4, count] = share * value
            into[cell], count = count, count + 1
    return count


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
