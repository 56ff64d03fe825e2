"""What the compiled equation needs to know, and the numbers of its states and derivatives."""

from __future__ import annotations

from typing import NamedTuple

from butterfly.model.parameters import LumpedParameters

State = tuple[float, float, float, float]
"""Angle in rad, velocity in rad/s, torque of the motor in N m (a state only with a lag), and
deflection of the bristles in rad (a state only with a stiffness of theirs)."""

X, V, M, Z = range(4)


class Constants(NamedTuple):
    """All numbers of the equation; see `LumpedParameters`."""

    p1: float
    viscous: float
    back_emf: float
    lag: float
    p3: float
    p3_offset: float
    coulomb: float
    stribeck: float
    stribeck_velocity: float
    bristle_stiffness: float
    bristle_damping: float
    drag: float
    bias: float
    cogging: float
    cogging_cosine: float
    cogging_periods: float

    @classmethod
    def of(cls, p: LumpedParameters) -> Constants:
        """Take them from the parameters of the hand with its added mass.

        An estimator may try friction that is negative under a load; it counts as none, since it
        would feed the motion. Bristles that no Coulomb friction bends are left out.
        """
        coulomb = max(p.coulomb, 0.0)
        own = {
            "viscous": p.p2 - p.back_emf,
            "lag": p.time_constant,
            "coulomb": coulomb,
            "stribeck": max(p.stribeck, -coulomb),
            "bristle_stiffness": p.bristle_stiffness if coulomb > 0 else 0.0,
        }
        return cls(*(float(own.get(name, getattr(p, name, 0.0))) for name in cls._fields))


COLUMNS = {
    name: number for number, name in enumerate((*Constants._fields, "p4", "delay", "compression"))
}
"""Number of the derivative by each constant, and by each parameter that acts through the drives."""

DRIVES = len(Constants._fields)
MOST_DRIVES = len(COLUMNS) - DRIVES

(
    P1,
    VISCOUS,
    BACK_EMF,
    LAG,
    P3,
    P3_OFFSET,
    COULOMB,
    STRIBECK,
    STRIBECK_VELOCITY,
    STIFFNESS,
    DAMPING,
    DRAG,
    BIAS,
    COGGING,
    COGGING_COSINE,
    PERIODS,
) = range(DRIVES)


STEP, REVERSAL, REST, LOOSE = 0.0, 1.0, 2.0, 3.0
KIND, BEGIN, SHARE, SIGN, INTERVAL, PART, PARTS = range(7)
COUNT, CURRENT = 0, 7
STAGE, PER_STAGE = 8, 10
TAPE_WIDTH = STAGE + 4 * PER_STAGE
LATE, BEFORE = 4, 5
BASIS = 4
WEIGHT = BASIS + DRIVES + MOST_DRIVES
RATE = WEIGHT + 4
