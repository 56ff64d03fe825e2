"""An estimate with its interval as a mark in a row of a table: a line of a forest plot."""

from __future__ import annotations

import math
from dataclasses import dataclass

_MARGIN = 0.1  # of the range that is shown, on either side


@dataclass(frozen=True, kw_only=True)
class Whisker:
    """What is drawn of one parameter, on a scale of its own.

    Parameters
    ----------
    value
        The estimate.
    limits
        Of its 95 % interval; None if there is none.
    left_out
        Range of the estimates that leave one added mass out; None if there are none.
    true
        Where it is known.
    """

    value: float
    limits: tuple[float, float] | None = None
    left_out: tuple[float, float] | None = None
    true: float | None = None

    @property
    def scale(self) -> tuple[float, float]:
        """Multistart of an axis that holds all of it."""
        known = [self.value, *(self.limits or ()), *(self.left_out or ())]
        known += [] if self.true is None else [self.true]
        least, most = min(known), max(known)
        spare = _MARGIN * (most - least) or abs(least) or 1.0
        return least - spare, most + spare

    @property
    def zero(self) -> float | None:
        """Where 0 is, from 0 to 100 along the axis; None if it is not on it."""
        least, most = self.scale
        return self.place(0.0) if least <= 0.0 <= most else None

    def place(self, number: float) -> float:
        """Return where a number is, from 0 to 100 along the axis."""
        least, most = self.scale
        return round(100 * (number - least) / (most - least), 2)

    @property
    def drawn(self) -> bool:
        """Whether there is an interval to draw, of finite limits."""
        return self.limits is not None and all(map(math.isfinite, self.scale))

    def __str__(self) -> str:
        return ""
