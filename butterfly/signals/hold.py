"""What the input does between its stamps: its value, its moments, and its gain at a frequency.

The rule is the same wherever an input is used. A command that is held (zero-order hold) is 0 before
its first stamp, as a motor's is that has not been told anything; each is held until the next. A
continuous signal that was sampled (first-order hold) was before its first stamp what it is there,
and runs on a straight line from each stamp to the next. After the last stamp both stay.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from butterfly.compiled import compiled
from butterfly.logs.log import Intersample

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Samples = NDArray[np.float64]


def value(time: Samples, inputs: Samples, instants: Samples, hold: Intersample) -> Samples:
    """Return the (m,) input at (m,) instants in s.

    Parameters
    ----------
    time, inputs
        (n,) increasing stamps in s, and the input at each.
    instants
        In any order.
    hold
        Between the stamps.
    """
    if hold is Intersample.FIRST_ORDER_HOLD:
        return np.interp(instants, time, inputs)
    latest = np.searchsorted(time, instants, "right") - 1
    return np.where(latest >= 0, inputs[latest], 0.0)


def mean(time: Samples, inputs: Samples, edges: Samples, hold: Intersample) -> Samples:
    """Return the (m - 1,) means of the input between (m,) increasing edges in s (see `value`)."""
    return np.asarray(moments(time, inputs, edges, hold)[0])


def moments(time: Samples, inputs: Samples, edges: Samples, hold: Intersample) -> Samples:
    """Return the first three Legendre coefficients of the input over each interval.

    c0 + c1 x + c2 (3 x^2 - 1)/2, x from -1 to 1 over the interval, is the parabola that has the
    input's mean and first and second moment; no step of the input is lost or gained, wherever the
    edges fall.

    Parameters
    ----------
    time, inputs, hold
        As in `value`.
    edges
        (m,) increasing instants in s.

    Returns
    -------
    (3, m - 1) coefficients in the input's unit.
    """
    return np.asarray(_moments(time, inputs, edges, hold is Intersample.FIRST_ORDER_HOLD, None))


def parabolas(time: Samples, inputs: Samples, edges: Samples, hold: Intersample) -> Samples:
    """Return the input over each interval as the parabola that has its moments, and its delay's.

    Parameters
    ----------
    time, inputs, edges, hold
        As in `moments`.

    Returns
    -------
    (m - 1, 2, 3) values at the start, middle and end of each interval: of the parabola, and of its
    derivative by a delay of the input, per s. A held input's moments have a kink where a stamp
    passes an edge; there it is one of the slopes.
    """
    late = np.empty((3, edges.size - 1))
    found = _moments(time, inputs, edges, hold is Intersample.FIRST_ORDER_HOLD, late)
    return np.asarray(_values(found, late))


def for_sums(time: Samples, inputs: Samples, grid: Samples, hold: Intersample) -> Samples:
    """Return samples whose sums against those of a smooth signal are integrals of the input.

    A continuous signal's values will do. Each step of a held one is spread over the three samples
    about it, so that sum_k g_k u_k times the sampling period is int g u dt for every parabola g,
    wherever the step falls; for other smooth g the error is of fourth order in the period.

    Parameters
    ----------
    time, inputs, hold
        As in `value`.
    grid
        (m,) instants of a uniform clock in s, two or more.

    Returns
    -------
    (m,) samples in the input's unit.
    """
    if hold is Intersample.FIRST_ORDER_HOLD:
        return value(time, inputs, grid, hold)
    rate = (grid.size - 1) / (grid[-1] - grid[0])
    return np.asarray(_spread_steps(time, inputs, grid[0], rate, grid.size))


def gain(omega: float, step: float, hold: Intersample) -> complex:
    """Gain, with its phase, of a hold on a sine of ``omega`` rad/s sampled each ``step`` s.

    A zero-order hold delays by half a step, a first-order hold between samples does not.
    """
    half = 0.5 * omega * step
    shape = np.sinc(half / np.pi)
    if hold is Intersample.FIRST_ORDER_HOLD:
        return complex(shape**2)
    return complex(shape * np.exp(-1j * half))


@compiled
def _values(found, late):
    """Evaluate two parabolas at the start, middle and end of each interval."""
    result = np.empty((found.shape[1], 2, 3))
    for cell in range(found.shape[1]):
        for number, of in enumerate((found, late)):
            middle, slope, bend = of[0, cell], of[1, cell], of[2, cell]
            result[cell, number, 0] = middle - slope + bend
            result[cell, number, 1] = middle - 0.5 * bend
            result[cell, number, 2] = middle + slope + bend
    return result


@compiled
def _at(time, inputs, instant, k, linear):
    """Input at an instant of which k is the latest stamp at or before, -1 if there is none."""
    if k < 0:
        return inputs[0] if linear else 0.0
    if not linear or k == time.size - 1:
        return inputs[k]
    share = (instant - time[k]) / (time[k + 1] - time[k])
    return inputs[k] + share * (inputs[k + 1] - inputs[k])


@compiled
def _moments(time, inputs, edges, linear, late):
    """Sum the input against 1, x and x^2 piece by piece, between stamps and edges.

    Returns (3, m) Legendre coefficients, and writes into ``late`` their derivatives by a delay of
    the input, if it is not None: by partial integration they need the moments and the input at the
    edges only.
    """
    count, last = edges.size - 1, time.size - 1
    result = np.empty((3, count))
    k = -1  # the latest stamp at or before the instant
    for cell in range(count):
        begin, end = edges[cell], edges[cell + 1]
        middle, rate = 0.5 * (begin + end), 2.0 / (end - begin)
        while k < last and time[k + 1] <= begin:
            k += 1
        zeroth = first = second = 0.0
        x, value = -1.0, _at(time, inputs, begin, k, linear)
        at_begin = value
        while True:
            is_last = k == last or time[k + 1] >= end
            if is_last:
                x_stop, value_stop = 1.0, _at(time, inputs, end, k, linear)
            else:
                x_stop, value_stop = (time[k + 1] - middle) * rate, value
                if linear:
                    value_stop = inputs[k + 1]
            width, both = x_stop - x, value + value_stop  # a straight line between the two
            zeroth += width * both
            first += width * (both * (x + x_stop) + value * x + value_stop * x_stop)
            second += width * (
                both * (x + x_stop) ** 2 + 2.0 * (value * x * x + value_stop * x_stop * x_stop)
            )
            if is_last:
                at_end = value_stop
                break
            k += 1
            x, value = x_stop, inputs[k]
        zeroth, first, second = zeroth / 2.0, first / 6.0, second / 12.0
        result[0, cell] = 0.5 * zeroth
        result[1, cell] = 1.5 * first
        result[2, cell] = 1.25 * (3.0 * second - zeroth)
        if late is not None:
            jump = at_end - at_begin
            late[0, cell] = -0.5 * rate * jump
            late[1, cell] = 1.5 * rate * (zeroth - at_end - at_begin)
            late[2, cell] = 1.25 * rate * (6.0 * first - 2.0 * jump)
    return result


@compiled
def _spread_steps(time, inputs, start, rate, count):
    """Spread each step of a held input over the samples about it, and sum up.

    A step of 1, x sampling periods after the sample nearest to it, makes this sample
    1/2 - x + x^3/3, the one before x^2/4 - x^3/6 - 1/24, the one after 25/24 - x^2/4 - x^3/6, and
    all later ones 1.
    """
    rise = np.zeros(count + 5)  # of the samples, from two before the first to two after the last
    before = 0.0
    for k in range(time.size):
        jump, before = inputs[k] - before, inputs[k]
        place = (time[k] - start) * rate + 2.0
        nearest = int(place + 0.5)
        if nearest < 1:
            rise[0] += jump
        elif nearest < count + 3:
            x = place - nearest
            even, odd = 0.25 * x * x - 1.0 / 24.0, (1.0 / 6.0) * x * x * x
            left, middle, right = even - odd, 0.5 - x + 2.0 * odd, 1.0 - even - odd
            rise[nearest - 1] += jump * left
            rise[nearest] += jump * (middle - left)
            rise[nearest + 1] += jump * (right - middle)
            rise[nearest + 2] += jump * (1.0 - right)
    return np.cumsum(rise)[2 : count + 2]
