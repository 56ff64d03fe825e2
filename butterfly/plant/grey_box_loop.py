"""Open-loop runs of the grey box, each in one compiled loop, several at a time in threads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from butterfly.logs.log import Log
from butterfly.plant.excitations import Multisine, initial_angle
from butterfly.plant.joints import GreyBoxJoint
from butterfly.plant.sensors import stamps_of
from butterfly.plant.setup import Setup

if TYPE_CHECKING:
    from butterfly.plant.rollout import Job


class GreyBoxLoop:
    """Simulates batches of runs, on any clock and through any path: the logs of `Setup.play`.

    What is random is drawn in the same order as there: cycles, encoder, faults.

    Parameters
    ----------
    setup
        Whose simulator is the grey box.
    duration
        Of a run in s.
    threads
        How many runs are simulated at a time.
    """

    def __init__(self, setup: Setup, duration: float, threads: int) -> None:
        self._setup, self._duration = setup, duration
        self._pool = ThreadPoolExecutor(threads)

    def __enter__(self) -> GreyBoxLoop:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown()

    def logs(self, batch: Sequence[Job]) -> Iterator[Log]:
        """Simulate a batch, and yield its logs in order.

        Raises
        ------
        InputError
            If a command cannot be used, or a simulation diverges.
        """
        return self._pool.map(self._log, batch)

    def _log(self, job: Job) -> Log:
        ((added, excitation), rng), setup = job, self._setup
        cycles = setup.clock.cycles(self._duration, rng)
        time = stamps_of(cycles)
        if setup.clock.jitter == 0 and isinstance(excitation, Multisine):
            sampled = _on_a_regular_clock(excitation, setup.clock.step, cycles.size)
        else:
            sampled = excitation.sample(time)
        commands = setup.path.shape_all(sampled)
        joint = GreyBoxJoint(setup.robot, added, angle=initial_angle(excitation))
        true = joint.angles_under(time, setup.path.deliver(commands), setup.path.delay)
        return setup.record((added, excitation), time, commands, true, rng)


@lru_cache(maxsize=4)
def _on_a_regular_clock(multisine: Multisine, step: float, count: int) -> NDArray[np.float64]:
    """Return a multisine at (count + 1,) stamps; runs that differ in the robot alone share it."""
    return multisine.sample(stamps_of(np.full(count, step)))
