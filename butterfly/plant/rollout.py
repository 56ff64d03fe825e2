"""Many open-loop runs of one robot, in MuJoCo's compiled loop where it can do them."""

from __future__ import annotations

import copy
import os
from dataclasses import replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from butterfly.errors import InputError
from butterfly.plant.bench import recorded
from butterfly.plant.excitations import Excitation, initial_angle
from butterfly.plant.joints import steps_of
from butterfly.plant.mjcf import compile_model, mount
from butterfly.progress import Track, untracked

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.model.parameters import AddedMass
    from butterfly.plant.setup import Setup

    _Job = tuple[tuple[AddedMass, Excitation], np.random.Generator]

_BAD_ACCELERATION = int(mujoco.mjtWarning.mjWARN_BADQACC)
_BATCH = 16  # runs simulated between two reports of progress, which bounds the memory they take


def simulate_runs(
    setup: Setup,
    runs: Sequence[tuple[AddedMass, Excitation]],
    duration: float,
    seeds: Sequence[np.random.SeedSequence],
    *,
    threads: int | None = None,
    track: Track = untracked,
) -> Iterator[Log]:
    """Simulate each run from rest, hanging down, its excitation applied through a zero-order hold.

    The runs share MuJoCo's compiled loop and its threads where nothing has to be done between
    steps (see `Setup.runs_open_loop`); otherwise each goes through the motor wrapper. Both ways
    give the same log to within rounding.

    Parameters
    ----------
    setup
        The simulated bench.
    runs
        What the robot carries and its excitation, for each run.
    duration
        Of a run in s.
    seeds
        One for each run, the source of everything random in it.
    threads
        Of the compiled loop; one per core if not given.
    track
        Shows progress.

    Yields
    ------
    The log of each run, in order, named after its number, mass and frequency.

    Raises
    ------
    InputError
        If a simulation diverges.
    """
    generators = [np.random.default_rng(seed) for seed in seeds]
    jobs = list(zip(runs, generators, strict=True))
    workers = threads or os.cpu_count() or 1
    for number, log in enumerate(_simulated(setup, jobs, duration, workers, track)):
        yield replace(log, name=_name(number, log))


def _name(number: int, log: Log) -> str:
    sine = log.excitation
    what = f"{sine.omega:g}rads" if sine else "signal"
    return f"run{number:03d}_{1e3 * log.added_mass.mass:g}g_{what}"


def _simulated(
    setup: Setup, jobs: Sequence[_Job], duration: float, workers: int, track: Track
) -> Iterator[Log]:
    if not setup.runs_open_loop:
        for (added, excitation), rng in track(jobs, "Simulating"):
            yield setup.play(added, excitation, duration, rng)
        return
    batches = [jobs[k : k + _BATCH] for k in range(0, len(jobs), _BATCH)]
    with Rollout(nthread=workers) as pool:
        loop = _CompiledLoop(setup, duration, pool, workers)
        for batch in track(batches, "Simulating"):
            yield from loop.logs(batch)


class _CompiledLoop:
    """Simulates batches of runs on a regular clock in MuJoCo's own threads."""

    def __init__(self, setup: Setup, duration: float, pool: Rollout, workers: int) -> None:
        clock = setup.clock
        self._setup = setup
        self._time = clock.step * np.arange(clock.count(duration) + 1, dtype=np.float64)
        self._pool = pool
        self._model = compile_model(setup.robot)
        self._substeps = steps_of(clock.step)
        self._model.opt.timestep = clock.step / self._substeps
        self._data = [mujoco.MjData(self._model) for _ in range(workers)]

    def logs(self, batch: Sequence[_Job]) -> Iterator[Log]:
        """Simulate a batch, and yield its logs in order."""
        setup, time = self._setup, self._time
        excitations = [excitation for (_, excitation), _ in batch]
        inputs = np.array([setup.path.shape_all(each.sample(time)) for each in excitations])
        start = np.array([initial_angle(each) for each in excitations])
        angles = self._roll_out(
            [added for (added, _), _ in batch], start, setup.path.deliver(inputs[:, :-1])
        )
        for ((added, excitation), rng), command, true in zip(batch, inputs, angles, strict=True):
            angle = setup.encoder.read(time, true, rng)
            about = setup.about(added, excitation)
            log = recorded(time, command, angle, input_kind=setup.input_kind, **about)
            yield setup.faults.apply(log, rng)

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
