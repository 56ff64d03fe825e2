"""Friction of a physical hand, its numbers checked."""

from __future__ import annotations

import math
from dataclasses import dataclass

from butterfly.errors import InputError, require_number
from butterfly.model.terms import TERMS, FrictionTerms


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
        require_number("Friction", viscous=self.viscous)
        require_number("Friction", positive=True, stribeck_velocity=self.stribeck_velocity)
        for name, value in self.terms().items():
            if TERMS[name].lower == 0:
                require_number("Friction", **{name: value})
            elif not math.isfinite(value):
                raise InputError("Friction", name, value, "a finite number")
        require_periods("Friction", self.cogging_periods)
        if self.bristle_stiffness > 0 and not self.coulomb > 0:
            raise InputError(
                "Friction", "coulomb", self.coulomb, "more than 0, for bristles to bend"
            )


def require_periods(source: str, periods: float) -> None:
    """Raise InputError unless periods of cogging in a turn are 1, 2, 3, and so on."""
    if not (periods >= 1 and float(periods).is_integer()):
        raise InputError(source, "cogging_periods", periods, "1, 2, 3, ...")
