"""Between samples: the value, moments and sums of a held input; cubic Hermite polynomials."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from butterfly.arrays import Samples, read_only
from butterfly.compiled import compiled, inlined, pasted
from butterfly.logs.log import Intersample

SIMPSON = np.array([1.0, 4.0, 1.0]) / 6
"""Weights of the values of a parabola at the start, middle and end of an interval in its mean."""

_ASTRAY = 1e-9  # share of an interval by which a stamp may miss its edge by rounding


def mean(time: Samples, inputs: Samples, edges: Samples, hold: Intersample) -> Samples:
    """Return the (m - 1,) means of the input between (m,) increasing edges in s."""
    means = np.empty(edges.size - 1)
    time, inputs, edges = map(read_only, (time, inputs, edges))
    _means(time, inputs, edges, hold is Intersample.FIRST_ORDER_HOLD, means)
    return means


def parabolas(time: Samples, inputs: Samples, edges: Samples, hold: Intersample) -> Samples:
    """Return the input over each interval as a parabola, with its derivative by a delay.

    Mean, first and second moment are those of the input, so no step is lost wherever the edges are.
    (2, m - 1, 3) values at the start, middle and end of each interval: of the parabola, and of its
    derivative by a delay of the input, per s. The moments of a held input have a kink where a
    timestamp passes an edge; the derivative there is the mean of both sides.
    """
    values = np.empty((2, edges.size - 1, 3))
    time, inputs, edges = map(read_only, (time, inputs, edges))
    _parabolas(time, inputs, edges, hold is Intersample.FIRST_ORDER_HOLD, values)
    return values


def for_sums(time: Samples, inputs: Samples, grid: Samples, hold: Intersample) -> Samples:
    """Return (m,) samples whose sums with those of a smooth signal are integrals of the input.

    For a continuous signal these are its values. Each step of a held input is spread over the three
    nearest samples: sum_k g_k u_k times the sampling period is then int g u dt for every parabola g
    and any step time; for other smooth g the error is of fourth order in the period.
    """
    if hold is Intersample.FIRST_ORDER_HOLD:
        return np.interp(grid, time, inputs)
    rate = (grid.size - 1) / (grid[-1] - grid[0])
    rise = np.zeros(grid.size + 5)  # of the samples, two more at either end, and one
    _spread_steps(read_only(time), read_only(inputs), grid[0], rate, rise)
    return np.cumsum(rise)[2:-3]


@compiled
def _means(time, inputs, edges, linear, result):
    """Write (m,) means of the input over each interval."""
    k = -1
    for cell in range(edges.size - 1):
        begin, end = edges[cell], edges[cell + 1]
        if linear:
            k, zeroth, _, _, _, _ = _over_lines(time, inputs, begin, end, k)
        else:
            k, zeroth, _, _, _, _ = _over_steps(time, inputs, begin, end, k)
        result[cell] = 0.5 * zeroth


@compiled
def _parabolas(time, inputs, edges, linear, result):
    """Write `parabolas`; by partial integration a delay only needs moments and input at edges."""
    k = -1
    for cell in range(edges.size - 1):
        begin, end = edges[cell], edges[cell + 1]
        if linear:
            k, zeroth, first, second, at_begin, at_end = _over_lines(time, inputs, begin, end, k)
        else:
            k, zeroth, first, second, at_begin, at_end = _over_steps(time, inputs, begin, end, k)
        rate, jump = 2.0 / (end - begin), at_end - at_begin
        late = (-rate * jump, rate * (zeroth - at_end - at_begin), rate * (2.0 * first - jump))
        _evaluate(_legendre(zeroth, first, second), result, cell, 0)
        _evaluate(_legendre(late[0], late[1], late[2]), result, cell, 1)


@pasted
def _legendre(zeroth, first, second):
    """Legendre coefficients of a function from its integrals against 1, x and x^2."""
    return 0.5 * zeroth, 1.5 * first, 1.25 * (3.0 * second - zeroth)


@pasted
def _evaluate(coefficients, result, cell, number):
    """Write the values of a parabola at the start, middle and end of its interval."""
    middle, slope, bend = coefficients
    result[number, cell, 0] = middle - slope + bend
    result[number, cell, 1] = middle - 0.5 * bend
    result[number, cell, 2] = middle + slope + bend


@inlined
def _over_lines(time, inputs, begin, end, k):
    """Integrate a continuous input against 1, x and x^2, x from -1 to 1 over an interval.

    ``k`` is a sample at or before the start, -1 if none; returns the last one at or before the end,
    the three integrals, and the input at both ends.
    """
    last = time.size - 1
    middle, rate = 0.5 * (begin + end), 2.0 / (end - begin)
    while k < last and time[k + 1] <= begin:
        k += 1
    at_begin = _on_line(time, inputs, begin, k)
    x, value = -1.0, at_begin
    zeroth = first = second = 0.0
    while k < last and time[k + 1] < end:
        k += 1
        x_stop, value_stop = (time[k] - middle) * rate, inputs[k]
        width, both, reach = x_stop - x, value + value_stop, x + x_stop  # of a straight line
        moment, moment_stop = value * x, value_stop * x_stop
        zeroth += width * both
        first += width * (both * reach + moment + moment_stop)
        second += width * (both * reach * reach + 2.0 * (moment * x + moment_stop * x_stop))
        x, value = x_stop, value_stop
    at_end = _on_line(time, inputs, end, k)
    width, both, reach, moment = 1.0 - x, value + at_end, x + 1.0, value * x
    zeroth += width * both
    first += width * (both * reach + moment + at_end)
    second += width * (both * reach * reach + 2.0 * (moment * x + at_end))
    return k, zeroth / 2.0, first / 6.0, second / 12.0, at_begin, at_end


@inlined
def _on_line(time, inputs, instant, k):
    """Continuous input at an instant after sample k, -1 for none."""
    if k < 0 or k == time.size - 1:
        return inputs[0 if k < 0 else k]
    share = (instant - time[k]) / (time[k + 1] - time[k])
    return inputs[k] + share * (inputs[k + 1] - inputs[k])


@inlined
def _over_steps(time, inputs, begin, end, k):
    """Integrate a held input, step by step (see `_over_lines`)."""
    last, astray = time.size - 1, _ASTRAY * (end - begin)
    middle, rate = 0.5 * (begin + end), 2.0 / (end - begin)
    while k < last and time[k + 1] <= begin:
        k += 1
    value = inputs[k] if k >= 0 else 0.0
    before, since = (inputs[k - 1] if k > 0 else 0.0, begin - time[k] if k >= 0 else np.inf)
    after, until = (inputs[k + 1], time[k + 1] - begin) if k < last else (0.0, np.inf)
    at_begin = _between(value, before, since, after, until, astray)
    zeroth, first, second = 2.0 * value, 0.0, 2.0 / 3.0 * value
    while k < last and time[k + 1] < end:
        k += 1
        x, jump = (time[k] - middle) * rate, inputs[k] - value
        square = x * x
        zeroth += jump * (1.0 - x)
        first += jump * 0.5 * (1.0 - square)
        second += jump * (1.0 / 3.0) * (1.0 - square * x)
        value = inputs[k]
    before, since = (inputs[k - 1] if k > 0 else 0.0, end - time[k] if k >= 0 else np.inf)
    after, until = (inputs[k + 1], time[k + 1] - end) if k < last else (0.0, np.inf)
    at_end = _between(value, before, since, after, until, astray)
    return k, zeroth, first, second, at_begin, at_end


@pasted
def _between(value, before, since, after, until, astray):
    """Held input at an instant; the middle of a step there."""
    other = before if since <= astray else (after if until <= astray else value)
    return 0.5 * (value + other)


@compiled
def _spread_steps(time, inputs, start, rate, rise):
    """Spread each step of a held input over the ``rise`` of the nearest samples.

    A step of 1, x sampling periods after the sample nearest to it, makes this sample
    1/2 - x + x^3/3, the one before x^2/4 - x^3/6 - 1/24, the one after 25/24 - x^2/4 - x^3/6, and
    all later ones 1.
    """
    before = 0.0
    for k in range(time.size):
        jump, before = inputs[k] - before, inputs[k]
        place = (time[k] - start) * rate + 2.0
        nearest = np.int64(place + 0.5)
        if nearest < 1:
            rise[0] += jump
        elif nearest < rise.size - 2:
            x = place - nearest
            even, odd = 0.25 * x * x - 1.0 / 24.0, (1.0 / 6.0) * x * x * x
            earlier, middle, later = even - odd, 0.5 - x + 2.0 * odd, 1.0 - even - odd
            rise[nearest - 1] += jump * earlier
            rise[nearest] += jump * (middle - earlier)
            rise[nearest + 1] += jump * (later - middle)
            rise[nearest + 2] += jump * (1.0 - later)


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
