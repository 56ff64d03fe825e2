"""What brakes and pulls at the joint besides inertia, gravity and motor."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from butterfly.errors import InputError, require_number


@dataclass(frozen=True, kw_only=True)
class FrictionTerms:
    """The torques of the joint that are not proportional to its velocity; each is 0 if not given.

    Sliding at velocity v and angle th, the joint is braked by

        g(v) sgn v + drag |v| v,   g(v) = T_c + T_s exp(-(v/v_s)^2),

    and pulled by ``bias + cogging sin(N th) + cogging_cosine cos(N th)``. At rest it sticks until
    the other torques exceed T_c + T_s; or, with bristles, never quite: the LuGre model replaces
    g(v) sgn v by ``k z + c z'`` with ``z' = v - k |v| z / g(v)`` (Canudas de Wit, Olsson, Astrom
    and Lischinsky, IEEE TAC 40(3), 1995).

    Parameters
    ----------
    coulomb
        T_c in N m, of the bare hand.
    load
        Growth of T_c in N m per N of added weight: friction coefficient times bearing radius, in m;
        negative if the added weight relieves the bearing.
    stribeck
        T_s in N m, by which friction at rest exceeds T_c.
    stribeck_velocity
        v_s in rad/s, by which most of that excess is lost.
    bristle_stiffness
        k in N m/rad; 0 for friction that sticks rigidly.
    bristle_damping
        c in N m s/rad.
    drag
        In N m s^2/rad^2.
    bias
        Constant torque in N m.
    cogging, cogging_cosine
        Sine and cosine part in N m of a torque that repeats over a turn. One period a turn is
        what a clutch out of line adds.
    cogging_periods
        N, the number of its periods in one turn.
    """

    coulomb: float = 0.0
    load: float = 0.0
    stribeck: float = 0.0
    stribeck_velocity: float = 0.1
    bristle_stiffness: float = 0.0
    bristle_damping: float = 0.0
    drag: float = 0.0
    bias: float = 0.0
    cogging: float = 0.0
    cogging_cosine: float = 0.0
    cogging_periods: float = 1.0

    def terms(self) -> dict[str, Any]:
        """Return every term by its name."""
        return {field.name: getattr(self, field.name) for field in fields(FrictionTerms)}

    @property
    def holding(self) -> float:
        """T_c + T_s, the largest torque in N m that friction withstands at rest."""
        return self.coulomb + self.stribeck

    @property
    def sticks_harder(self) -> bool:
        """Whether it sticks rigidly, and holds more than it brakes when sliding."""
        return self.stribeck > 0 and self.bristle_stiffness == 0

    def level(self, velocity: float) -> float:
        """Return g(v) in N m at a velocity in rad/s."""
        return self.coulomb + self.stribeck * math.exp(-((velocity / self.stribeck_velocity) ** 2))


@dataclass(frozen=True, kw_only=True)
class Friction(FrictionTerms):
    """Friction at the pivot, all terms (see `FrictionTerms`).

    Parameters
    ----------
    viscous
        k_f in N m s/rad.
    """

    viscous: float = 0.0

    def __post_init__(self) -> None:
        signed = (
            "load",
            "bias",
            "cogging",
            "cogging_cosine",
            "cogging_periods",
            "stribeck_velocity",
        )
        plain = {name: value for name, value in self.terms().items() if name not in signed}
        require_number("Friction", viscous=self.viscous, **plain)
        require_number("Friction", positive=True, stribeck_velocity=self.stribeck_velocity)
        for name in ("load", "bias", "cogging", "cogging_cosine"):
            if not math.isfinite(getattr(self, name)):
                raise InputError("Friction", name, getattr(self, name), "a finite number")
        if not (self.cogging_periods >= 1 and float(self.cogging_periods).is_integer()):
            raise InputError("Friction", "cogging_periods", self.cogging_periods, "1, 2, 3, ...")
        if self.bristle_stiffness > 0 and not self.coulomb > 0:
            raise InputError(
                "Friction", "coulomb", self.coulomb, "more than 0, for bristles to bend"
            )
