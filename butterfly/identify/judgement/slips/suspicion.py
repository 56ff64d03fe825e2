"""Whether to look for slips at all: told by what is known already, and by sizes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from butterfly.identify.judgement.findings import FindingKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.identify.data import DataSet
    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.logs.log import Log
    from butterfly.model.parameters import AddedMass

_TELLING = {
    FindingKind.POOR_FIT,
    FindingKind.UNFOLLOWED,
    FindingKind.NO_INERTIA,
    FindingKind.NEGATIVE,
    FindingKind.TORQUE_DRIVEN,
    FindingKind.ROUNDS,
}

LONGEST_STEP = 0.05
"""Mean sampling period in s above which stamps may be no seconds."""

LONGEST_LOG = 3600.0
"""Duration in s above which stamps may be no seconds."""

_LONGEST_ARM = 5.0  # m
_COARSEST = 0.02  # rad that an encoder tells apart; 314 counts per turn
_HEAVIEST = 50.0  # kg
_STEEL = 7850.0  # kg/m^3
_LOOKED_AT = 1000  # samples


def suspicious(data: DataSet, estimate: ParameterEstimate) -> bool:
    """Whether an estimate, or the sizes in its data, are those of a slip."""
    return (
        any(each.kind in _TELLING for each in estimate.findings)
        or any(mass.arm > _LONGEST_ARM for mass in data.masses)
        or any(point.amplitude > math.pi for point in data.sines)
        or all(angle_step(log) >= _COARSEST for log in data.logs)
    )


def slow_clock(data: DataSet) -> bool:
    """Whether the stamps of a data set advance as those of no robot that is controlled."""
    steps = [log.mean_step for log in data.logs]
    spans = [log.time[-1] - log.time[0] for log in data.logs]
    return bool(np.median(steps) > LONGEST_STEP or np.median(spans) > LONGEST_LOG)


def too_heavy(masses: Sequence[AddedMass]) -> bool:
    """Whether a mass has no room at its arm: a ball of steel of it would reach halfway to the pivot.

    In grams all masses are a thousand times too large, which the motion does not tell.
    """
    return any(
        mass.mass > min(_HEAVIEST, _STEEL * 4 / 3 * math.pi * (mass.arm / 2) ** 3)
        for mass in masses
        if mass.arm > 0
    )


def angle_step(log: Log) -> float:
    """Return the least distance in rad between readings of the angle in the middle of a log."""
    middle = log.angle.size // 2
    changes = np.abs(np.diff(log.angle[middle : middle + _LOOKED_AT]))
    return float(np.min(changes[changes > 0], initial=math.inf)) if changes.any() else 0.0

