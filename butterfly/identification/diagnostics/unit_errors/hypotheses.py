"""What may be wrong with a whole data set, and the data set as it would be without."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.unit_errors.names import Slip
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.signals.frequency_response import response_point


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """A slip, the factor that undoes it, and how a data set would be without it.

    Parameters
    ----------
    slip, factor
        Which, and the factor.
    undo
        Returns the data set as it would be; InputError if its sines would be none.
    """

    slip: Slip
    factor: float
    undo: Callable[[DataSet], DataSet]


def of_angle(slip: Slip, factor: float) -> Hypothesis:
    """Suppose that the angle is in a unit of ``factor`` rad."""

    def undo(data: DataSet) -> DataSet:
        logs = tuple(replace(log, angle=factor * log.angle) for log in data.logs)
        points = tuple(
            None if point is None else replace(point, angle=point.angle.scaled(factor))
            for point in data.points
        )
        return replace(data, logs=logs, points=points)

    return Hypothesis(slip=slip, factor=factor, undo=undo)


def of_arms(slip: Slip, factor: float) -> Hypothesis:
    """Suppose that the arms are in a unit of ``factor`` m."""

    def undo(data: DataSet) -> DataSet:
        return carrying(
            data, [replace(log.added_mass, arm=factor * log.added_mass.arm) for log in data.logs]
        )

    return Hypothesis(slip=slip, factor=factor, undo=undo)


def of_logs(slip: Slip, factor: float, undo: Callable[[Log], Log]) -> Hypothesis:
    """Suppose that the columns of the logs are not what they are said to be."""

    def undone(data: DataSet) -> DataSet:
        logs = tuple(map(undo, data.logs))
        points = tuple(response_point(log) if log.excitation else None for log in logs)
        return replace(data, logs=logs, points=points)

    return Hypothesis(slip=slip, factor=factor, undo=undone)


def carrying(data: DataSet, masses: Sequence[AddedMass]) -> DataSet:
    """Return a data set whose logs carried other masses."""
    logs = tuple(replace(log, added_mass=mass) for log, mass in zip(data.logs, masses, strict=True))
    points = tuple(
        None if point is None else replace(point, added_mass=mass)
        for point, mass in zip(data.points, masses, strict=True)
    )
    return replace(data, logs=logs, points=points)


CLOCKS = (
    of_logs(Slip.MILLISECONDS, 1e-3, lambda log: replace(log, time=1e-3 * log.time, lead=None)),
    of_logs(Slip.MICROSECONDS, 1e-6, lambda log: replace(log, time=1e-6 * log.time, lead=None)),
)

OTHERS = (
    of_angle(Slip.DEGREES, math.pi / 180),
    of_logs(
        Slip.SWAPPED, 1.0, lambda log: replace(log, input=log.angle, angle=log.input, lead=None)
    ),
    of_arms(Slip.MILLIMETRES, 1e-3),
    of_arms(Slip.CENTIMETRES, 1e-2),
)
