"""Open-loop runs of MuJoCo, in its own compiled loop and threads."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from numpy.typing import NDArray

from butterfly.errors import InputError
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.plant.excitations import initial_angle
from butterfly.plant.held_commands import steps_of
from butterfly.plant.mjcf import compile_model, mount
from butterfly.plant.setup import Setup

if TYPE_CHECKING:
    from butterfly.plant.rollout import Job

_BAD_ACCELERATION = int(mujoco.mjtWarning.mjWARN_BADQACC)


class MujocoLoop:
    """Simulates batches of runs on a regular clock.

    Parameters
    ----------
    setup
        Whose robot needs no `Assistance`.
    duration
        Of a run in s.
    threads
        How many runs are simulated at a time.
    """

    def __init__(self, setup: Setup, duration: float, threads: int) -> None:
        clock = setup.clock
        self._setup = setup
        self._time = clock.step * np.arange(clock.count(duration) + 1, dtype=np.float64)
        self._model = compile_model(setup.robot)
        self._substeps = steps_of(clock.step)
        self._model.opt.timestep = clock.step / self._substeps
        self._data = [mujoco.MjData(self._model) for _ in range(threads)]
        self._pool = Rollout(nthread=threads)

    def __enter__(self) -> MujocoLoop:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.close()

    def logs(self, batch: Sequence[Job]) -> Iterator[Log]:
        """Simulate a batch, and yield its logs in order.

        Raises
        ------
        InputError
            If a simulation diverges.
        """
        setup, time = self._setup, self._time
        excitations = [excitation for (_, excitation), _ in batch]
        inputs = np.array([setup.path.shape_all(each.sample(time)) for each in excitations])
        start = np.array([initial_angle(each) for each in excitations])
        angles = self._roll_out(
            [added for (added, _), _ in batch], start, setup.path.deliver(inputs[:, :-1])
        )
        for (run, rng), command, true in zip(batch, inputs, angles, strict=True):
            yield setup.record(run, time, command, true, rng)

    def _roll_out(
        self, added: list[AddedMass], start: NDArray[np.float64], held: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the (runs, cycles + 1) angles under (runs, cycles) held commands."""
        models = [copy.copy(self._model) for _ in added]
        for model, mass in zip(models, added, strict=True):
            mount(model, self._setup.robot, mass)
        controls = np.zeros((len(added), held.shape[1] * self._substeps, self._model.nu))
        controls[:, :, 0] = np.repeat(held, self._substeps, axis=1)
        size = mujoco.mj_stateSize(self._model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        states = np.zeros((len(added), size))
        states[:, 1] = start  # a state is time, angles, velocities
        reached, _ = self._pool.rollout(models, self._data, states, controls)
        if any(data.warning[_BAD_ACCELERATION].number for data in self._data):
            raise InputError("MuJoCo", "motion", "a joint that diverged", "smaller commands")
        return np.column_stack([start, reached[:, self._substeps - 1 :: self._substeps, 1]])
