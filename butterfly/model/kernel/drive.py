"""What drives the joint during one interval: a parabola through its start, middle and end."""

from __future__ import annotations

from butterfly.compiled import compiled


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
