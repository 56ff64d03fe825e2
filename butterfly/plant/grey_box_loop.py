"""Open-loop runs of the grey box, each in one compiled loop, several at a time in threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from butterfly.plant.bench import recorded
from butterfly.plant.excitations import initial_angle
from butterfly.plant.joints import GreyBoxJoint
from butterfly.plant.sensors import stamps_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.plant.excitations import Excitation
    from butterfly.plant.rollout import Job
    from butterfly.plant.setup import Setup


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
        if self._setup.clock.jitter > 0:
            return self._pool.map(self._on_its_own_clock, batch)
        time = self._stamps(batch[0][1])
        excitations = {id(excitation): excitation for (_, excitation), _ in batch}
        commands = self._pool.map(lambda each: self._commands(each, time), excitations.values())
        held = dict(zip(excitations, commands, strict=True))
        return self._pool.map(lambda job: self._log(job, time, held[id(job[0][1])]), batch)

    def _on_its_own_clock(self, job: Job) -> Log:
        (_, excitation), rng = job
        time = self._stamps(rng)
        return self._log(job, time, self._commands(excitation, time))

    def _stamps(self, rng: np.random.Generator) -> NDArray[np.float64]:
        return stamps_of(self._setup.clock.cycles(self._duration, rng))

    def _commands(self, excitation: Excitation, time: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._setup.path.shape_all(excitation.sample(time))

    def _log(self, job: Job, time: NDArray[np.float64], commands: NDArray[np.float64]) -> Log:
        ((added, excitation), rng), setup = job, self._setup
        joint = GreyBoxJoint(setup.robot, added, angle=initial_angle(excitation))
        true = joint.angles_under(time, setup.path.deliver(commands), setup.path.delay)
        angle = setup.encoder.read(time, true, rng)
        about = setup.about(added, excitation)
        log = recorded(time, commands, angle, input_kind=setup.input_kind, **about)
        return setup.faults.apply(log, rng)
