"""For how long a simulation stays near a log.

About the upright gravity drives errors apart, however well the parameters are known. Their growth
is that of the linearised equation along the measured motion, friction aside.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.encoder_offset import reading_of
from butterfly.identification.simulation import LONGEST_STEP
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.signals.spectrum import uniform_grid

GROWTH = 30.0
"""Times by which an error at the start of a segment may grow within it."""

_EVERY = 5  # steps from one beginning to the next
_PREFERRED = np.array(
    [1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0]
)  # horizons, times powers of ten


def horizon_of(
    logs: Iterable[Log], parameters: LumpedParameters, zeros: Mapping[AddedMass, float]
) -> float:
    """Return the longest time in s within which no small error grows by more than `GROWTH`.

    Rounded down, so that little depends on the parameters; infinite where none grows so, as in a
    loop.
    """
    free = [log for log in logs if not log.closed]
    found = min(
        (_horizon(log, parameters, reading_of(log, zeros)) for log in free), default=math.inf
    )
    if not math.isfinite(found):
        return math.inf
    decade = 10.0 ** math.floor(math.log10(found))
    fits = _PREFERRED[_PREFERRED * decade <= found * (1 + 1e-9)]
    return float(f"{fits[-1] * decade:.2g}")


def _horizon(log: Log, parameters: LumpedParameters, zero: float) -> float:
    loaded = parameters.with_added_mass(log.added_mass)
    if not (loaded.p1 > 0 and loaded.p3 > 0):
        return math.inf
    angle = log.angle - zero
    if max(angle.max(), -angle.min()) <= math.pi / 2 or np.cos(angle).min() >= 0:
        return math.inf  # gravity pulls back wherever the hand is
    grid = uniform_grid(log.time, LONGEST_STEP)
    falling = -loaded.p3 / loaded.p1 * np.cos(np.interp(grid, log.time, angle))
    damping = max(loaded.p2, 0.0) / loaded.p1
    slowest = math.sqrt(loaded.p1 / loaded.p3)
    steps = _soonest(falling, damping, slowest)
    return steps * LONGEST_STEP if steps else math.inf


def _soonest(falling: Samples, damping: float, slowest: float) -> int:
    """Fewest steps in which an error grows `GROWTH`-fold, from any beginning on; 0 if none does."""
    begins = np.arange(0, falling.size - 1, _EVERY)
    angle = np.repeat([[1.0], [0.0]], begins.size, axis=1)  # of errors of angle, and of velocity
    velocity = 1 - angle
    for count in range(1, falling.size):
        begins = begins[begins + count < falling.size]
        angle, velocity = angle[:, : begins.size], velocity[:, : begins.size]
        velocity += LONGEST_STEP * (falling[begins + count] * angle - damping * velocity)
        angle += LONGEST_STEP * velocity
        sizes = np.abs(angle) / [[1.0], [max(count * LONGEST_STEP, slowest)]]
        if sizes.max(initial=0.0) > GROWTH:
            return count
    return 0
