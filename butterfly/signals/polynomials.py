"""Cubic Hermite polynomials between the instants of a simulation, and local slopes.

The local polynomials are those of Savitzky & Golay (Anal. Chem. 36, 1964).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from butterfly.arrays import Samples, read_only
from butterfly.compiled import compiled

_BLOCK = 1024  # samples that stay in the fastest cache


def averages(
    grid: Samples, instants: Samples, values: Samples, slopes: bool, early: float = 0.0
) -> tuple[NDArray[np.int64], Samples, Samples, NDArray[np.int64]]:
    """Average the polynomials, or their ``slopes``, and values over the instants in each interval.

    The average is linear in the ends of the interval, so four weights replace many instants. An
    interval's polynomial is evaluated ``early`` by so many s, also beyond its ends.
    Returns (n - 1,) numbers of the average of each interval of a grid, -1 if it has no instant; (8,
    k) weights of angle and velocity at its start and end, and their derivatives by ``early``; (k,)
    mean values; and (k,) counts.
    """
    size = grid.size - 1
    into, counts = np.full(size, -1), np.empty(size, dtype=np.int64)
    weights, means = np.empty((8, size)), np.empty(size)
    grid, instants, values = map(read_only, (grid, instants, values))
    rows = _average(grid, instants, values, slopes, early, into, weights, means, counts)
    return into, weights[:, :rows].copy(), means[:rows], counts[:rows]


@compiled
def _average(grid, instants, values, slopes, early, into, weights, means, counts):
    """Write `averages`, and return how many there are."""
    last, k, row = grid.size - 2, 0, 0
    for cell in range(last + 1):
        length, first, one, two, three, total = grid[cell + 1] - grid[cell], k, 0.0, 0.0, 0.0, 0.0
        rate = 1.0 / length
        while k < instants.size and (instants[k] < grid[cell + 1] or cell == last):
            s = (instants[k] - early - grid[cell]) * rate
            one, two, three, total = one + s, two + s * s, three + s * s * s, total + values[k]
            k += 1
        if k > first:
            share = 1.0 / (k - first)
            one, two, three = share * one, share * two, share * three
            into[cell], counts[row], means[row] = row, k - first, share * total
            weights[0, row] = 1.0 - 3.0 * two + 2.0 * three
            weights[1, row] = length * (one - 2.0 * two + three)
            weights[2, row] = 3.0 * two - 2.0 * three
            weights[3, row] = length * (three - two)
            weights[4, row] = 6.0 * rate * (one - two)
            weights[5, row] = 4.0 * one - 3.0 * two - 1.0
            weights[6, row] = 6.0 * rate * (two - one)
            weights[7, row] = 2.0 * one - 3.0 * two
            if slopes:
                weights[0, row] = 6.0 * rate * (two - one)
                weights[1, row] = 1.0 - 4.0 * one + 3.0 * two
                weights[2, row] = 6.0 * rate * (one - two)
                weights[3, row] = 3.0 * two - 2.0 * one
                weights[4, row] = 6.0 * rate * rate * (1.0 - 2.0 * one)
                weights[5, row] = rate * (4.0 - 6.0 * one)
                weights[6, row] = 6.0 * rate * rate * (2.0 * one - 1.0)
                weights[7, row] = rate * (2.0 - 6.0 * one)
            row += 1
    return row


def interpolate(
    grid: Samples, angle: Samples, velocity: Samples, instants: Samples, slopes: bool
) -> Samples:
    """Return the (m,) angles, or ``slopes``, at increasing instants, also beyond the grid."""
    result = np.empty(instants.size)
    grid, angle, velocity, instants = map(read_only, (grid, angle, velocity, instants))
    _interpolate(grid, angle, velocity, instants, slopes, result)
    return result


@compiled
def _interpolate(grid, angle, velocity, instants, slopes, result):
    """Write `interpolate`."""
    k, last = 0, grid.size - 2
    for cell in range(grid.size - 1):
        # of 1, s, s^2 and s^3, s running from 0 to 1 over the interval
        length, rise = grid[cell + 1] - grid[cell], angle[cell + 1] - angle[cell]
        c0, c1, end = angle[cell], length * velocity[cell], length * velocity[cell + 1]
        c2, c3, rate = 3.0 * rise - 2.0 * c1 - end, c1 + end - 2.0 * rise, 1.0 / length
        while k < instants.size and (instants[k] < grid[cell + 1] or cell == last):
            s = (instants[k] - grid[cell]) * rate
            if slopes:
                result[k] = (c1 + s * (2.0 * c2 + s * 3.0 * c3)) * rate
            else:
                result[k] = c0 + s * (c1 + s * (c2 + s * c3))
            k += 1


def slope(values: Samples, reach: int, order: int, step: float) -> Samples:
    """Return the (n,) slopes per s of polynomials fitted to the samples around each one.

    Windows have ``reach`` samples, `step` s apart, on either side; near an end the polynomial of
    the first or last window is used.
    """
    rises, fit = _window(reach, order)
    width = 2 * reach + 1
    begin = rises[:-1] @ (fit @ (values[:width] - values[0]))  # exactly 0 for equal samples
    end = rises[:-1] @ (fit @ (values[-1] - values[: -width - 1 : -1]))
    inner = np.zeros(values.size - 2 * reach)
    _antisymmetric(read_only(values), (rises[-1] @ fit)[reach + 1 :], inner)
    return np.concatenate([begin, inner, end[::-1]]) / step


@lru_cache(maxsize=64)
def _window(reach: int, order: int) -> tuple[Samples, Samples]:
    """Return (reach + 1, k) slopes of polynomials up to the middle of a window; (k, m) their fit.

    Products of the two have m = 2 reach + 1 columns for each row: too many to keep.
    """
    x = np.arange(-reach, reach + 1) / reach
    rises = legendre.legval(x[: reach + 1], legendre.legder(np.eye(order + 1))).T / reach
    return np.asarray(rises), np.asarray(np.linalg.pinv(legendre.legvander(x, order)))


@compiled
def _antisymmetric(values, weights, result):
    """Add differences of the i-th samples after and before each one, weighted by weights[i - 1].

    The inner loop is over samples, so the processor adds several at once.
    """
    reach = weights.size
    for start in range(0, result.size, _BLOCK):
        block = result[start : start + _BLOCK]
        for k in range(1, reach + 1):
            middle, weight = start + reach, weights[k - 1]
            later = values[middle + k : middle + k + block.size]
            earlier = values[middle - k : middle - k + block.size]
            for i in range(block.size):
                block[i] += weight * (later[i] - earlier[i])
