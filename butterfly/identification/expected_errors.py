"""What an estimate leaves over of logs, as the errors to expect of a log that nobody has recorded.

The honest error is that of a log whose added mass the estimate has not seen: each log is simulated
with the estimate that was made without its mass. Where there is none, as with two masses, of which
none can be left out, errors in sample stand for it, larger by sqrt(1 + 1/G): of G masses, a further
one differs from what they have in common by (1 + 1/G) times their variance, if they are like it.

Of a new log, the error at any instant is one that a log with another mass had, relative to its
motion. A whole log is the donor, so that a log that is followed badly is so throughout, and its
errors are drawn in blocks of whole drive periods, so that they stay as slow as they were (the
circular block bootstrap: Politis & Romano, in Exploring the Limits of Bootstrap, 1992).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.predict import Predictor
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass

_BLOCK = 5.0  # s, of a log without a drive period, and least of any


@dataclass(frozen=True, kw_only=True, eq=False)
class LeftOver:
    """Errors of one log.

    Parameters
    ----------
    log
        The log.
    relative
        (n,) measured less simulated angle at its stamps, over the rms of its motion; larger by
        sqrt(1 + 1/G) if it was seen with G masses.
    unseen
        Whether the estimate was made without its added mass.
    """

    log: Log
    relative: NDArray[np.float64]
    unseen: bool

    def drawn(self, time: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """(m,) relative errors at (m,) instants in s, in blocks that begin anywhere in the log.

        Those of samples as they are: between two the mean of their noise would be smaller.
        """
        own = self.log.time - self.log.time[0]
        length = min(block(self.log), float(own[-1]))
        number = ((time - time[0]) / length).astype(np.intp)
        starts = rng.uniform(0, own[-1], number[-1] + 1)
        instants = starts[number] + (time - time[0]) - number * length
        latest = np.searchsorted(own, instants % own[-1], side="right") - 1
        return np.asarray(self.relative[latest])


def block(log: Log) -> float:
    """Return the length in s of the blocks of a log: whole periods of its drive."""
    if log.excitation is None:
        return _BLOCK
    period = 2 * math.pi / log.excitation.omega
    return math.ceil(_BLOCK / period) * period


def left_over(data: DataSet, estimate: Estimate) -> list[LeftOver]:
    """Return the errors of the logs that an estimate was made from, in their order.

    A log that stands still has none.
    """
    predictor, found = Predictor(data), []
    further = math.sqrt(1 + 1 / len(data.masses))
    for number, log in enumerate(data.logs):
        motion = float(np.std(log.angle))
        if not motion:
            continue
        others = estimate.left_out.get(log.added_mass)
        own = estimate if others is None else replace(estimate, values=others)
        run = predictor.run(number, own)
        relative = (log.angle - run.simulated) / motion * (further if others is None else 1.0)
        found.append(LeftOver(log=log, relative=relative, unseen=others is not None))
    return found


def donors(found: Sequence[LeftOver], mass: AddedMass) -> list[LeftOver]:
    """Return the logs with other added masses than one; all if there are none."""
    others = [
        each for each in found if each.log.added_mass.inertia_and_moment != mass.inertia_and_moment
    ]
    return others or list(found)
