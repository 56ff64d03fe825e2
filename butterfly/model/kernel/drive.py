"""What drives the joint during one interval: a parabola through its start, middle and end."""

from __future__ import annotations

import math

from butterfly.compiled import compiled

_ROUNDING = 1e-12  # share of an interval


@compiled
def drive_at(drives, fraction):
    """Evaluate the parabola through drives at fractions 0, 1/2 and 1 of the interval."""
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    return start + fraction * (end - start - bend + bend * fraction)


@compiled
def drive_slope(drives, fraction):
    """Differentiate `drive_at` by the fraction."""
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    return end - start - bend + 2.0 * bend * fraction


@compiled
def exceeds_at(drives, begin, load, most):
    """Return where a parabola and a load first exceed ``most`` from a fraction on, and their sign.

    The fraction is 1 where they do not; at ``begin`` they do not yet.
    """
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    slope = end - start - bend
    first, side = 1.0, 0.0
    for sign in (-1.0, 1.0):
        offset = start + load - sign * most
        square = slope**2 - 4.0 * bend * offset
        if square <= 0.0:
            continue
        outward = sign * math.sqrt(square)  # the slope where it is exceeded
        if slope * outward >= 0.0:
            at = -2.0 * offset / (slope + outward)
        elif bend != 0.0:
            at = (outward - slope) / (2.0 * bend)
        else:
            continue
        if begin - _ROUNDING <= at < first:
            first, side = max(at, begin), sign
    return first, side


@compiled
def part_of(drives, part, parts):
    """Return the drives of one of ``parts`` equal parts of the interval, counted from 0."""
    return (
        drive_at(drives, part / parts),
        drive_at(drives, (part + 0.5) / parts),
        drive_at(drives, (part + 1) / parts),
    )


@compiled
def piece_of(drives, begin, share):
    """Return the drives of ``share`` of the interval from fraction ``begin`` on."""
    return (
        drive_at(drives, begin),
        drive_at(drives, begin + 0.5 * share),
        drive_at(drives, begin + share),
    )
