"""Whether to look for slips at all: told by what is known already, and by sizes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.estimate import Estimate
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.verdict import Level

_TELLING = {FindingKind.POOR_FIT, FindingKind.UNFOLLOWED, FindingKind.TORQUE_DRIVEN}

_LONGEST_STEP = 0.05  # s, above which stamps may be no seconds
_LONGEST_LOG = 3600.0  # s
_LONGEST_ARM = 5.0  # m
_COARSEST = 0.02  # rad that an encoder tells apart; 314 counts per turn
_HEAVIEST = 10.0  # kg
_HEAVY = 1.0  # kg, of a motor whose resistance seems to be none
_STEEL = 7850.0  # kg/m^3
_LOOKED_AT = 1000  # samples


def suspicious(data: DataSet, estimate: Estimate) -> bool:
    """Whether an estimate, or the sizes in its data, are those of a slip."""
    return (
        any(each.severity is Level.WARNING or each.kind in _TELLING for each in estimate.findings)
        or any(mass.arm > _LONGEST_ARM for mass in data.masses)
        or any(point.amplitude > math.pi for point in data.sines)
        or all(angle_step(log) >= _COARSEST for log in data.logs)
    )


def slow_clock(data: DataSet) -> bool:
    """Whether the stamps of a data set advance as those of no robot that is controlled."""
    steps = [log.mean_step for log in data.logs]
    spans = [log.time[-1] - log.time[0] for log in data.logs]
    return bool(np.median(steps) > _LONGEST_STEP or np.median(spans) > _LONGEST_LOG)


def too_heavy(masses: Sequence[AddedMass], estimate: Estimate) -> bool:
    """Whether a mass is too heavy for its place: so heavy, so large, or for such a motor.

    In grams all masses, and with them all parameters but the delay, are a thousand times too large,
    which the motion does not tell. A ball of steel that reaches halfway to the pivot is too large;
    a voltage-fed motor of almost no resistance is one whose torque is too large.
    """
    driven = any(each.kind is FindingKind.TORQUE_DRIVEN for each in estimate.findings)
    return any(
        mass.mass > min(_HEAVY if driven else _HEAVIEST, _ball(mass.arm / 2))
        for mass in masses
        if mass.arm > 0
    )


def _ball(radius: float) -> float:
    """Mass in kg of a ball of steel with a radius in m."""
    return _STEEL * 4 / 3 * math.pi * radius**3


def angle_step(log: Log) -> float:
    """Return the least distance in rad between readings of the angle in the middle of a log."""
    middle = log.angle.size // 2
    changes = np.abs(np.diff(log.angle[middle : middle + _LOOKED_AT]))
    return float(np.min(changes[changes > 0], initial=math.inf)) if changes.any() else 0.0
