"""Open-loop runs: many of one robot in compiled loops, and one with a recorded input."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from numpy.typing import NDArray

from butterfly.errors import InputError
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass, compressed
from butterfly.plant.joints import GreyBoxJoint, Joint, steps_of
from butterfly.plant.mjcf import compile_model, mount
from butterfly.plant.rig import Rig, Simulator
from butterfly.plant.sensors import stamps_of
from butterfly.progress import Track, untracked
from butterfly.signals import hold
from butterfly.signals.excitations import Excitation, Multisine, initial_angle

_Job = tuple[tuple[AddedMass, Excitation], np.random.Generator]

_BATCH = 16  # runs simulated between two reports of progress, which bounds the memory they take
_BAD_ACCELERATION = int(mujoco.mjtWarning.mjWARN_BADQACC)
_REPLAY_STEP = 5e-4  # s


def simulate_runs(
    rig: Rig,
    runs: Sequence[tuple[AddedMass, Excitation]],
    duration: float,
    seeds: Sequence[np.random.SeedSequence],
    *,
    threads: int | None = None,
    track: Track = untracked,
) -> Iterator[Log]:
    """Simulate each run from rest, hanging down, its excitation applied through a zero-order hold.

    The runs share a compiled loop and its threads where nothing has to be done between steps (see
    `Rig.runs_open_loop`); otherwise each goes through the motor wrapper. The grey box's loop
    gives the wrapper's log bit for bit, MuJoCo's to within rounding.

    `runs`: What the robot carries and its excitation, for each run; `seeds`: One for each run, the
    source of everything random in it; `threads`: Of the compiled loop; one per core if not given.
    Returns the log of each run, in order, named after its number, mass and frequency. Raises
    InputError if a simulation diverges.
    """
    generators = [np.random.default_rng(seed) for seed in seeds]
    jobs = list(zip(runs, generators, strict=True))
    workers = threads or os.cpu_count() or 1
    for number, log in enumerate(_simulated(rig, jobs, duration, workers, track)):
        sine = log.excitation
        what = f"{sine.omega:g}rads" if sine else "signal"
        yield replace(log, name=f"run{number:03d}_{1e3 * log.added_mass.mass:g}g_{what}")


def _simulated(
    rig: Rig, jobs: Sequence[_Job], duration: float, workers: int, track: Track
) -> Iterator[Log]:
    if not rig.runs_open_loop:
        for (added, excitation), rng in track(jobs, "Simulating"):
            yield rig.play(added, excitation, duration, rng)
        return
    batches = [jobs[k : k + _BATCH] for k in range(0, len(jobs), _BATCH)]
    compiled = _GreyBoxLoop if rig.simulator is Simulator.GREY_BOX else _MujocoLoop
    with compiled(rig, duration, workers) as loop:
        for batch in track(batches, "Simulating"):
            yield from loop.logs(batch)


class _GreyBoxLoop:
    """Simulates batches of runs, on any clock and through any path: the logs of `Rig.play`.

    What is random is drawn in the same order as there: cycles, encoder, faults.
    """

    def __init__(self, rig: Rig, duration: float, threads: int) -> None:
        self._rig, self._duration = rig, duration
        self._pool = ThreadPoolExecutor(threads)

    def __enter__(self) -> _GreyBoxLoop:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown()

    def logs(self, batch: Sequence[_Job]) -> Iterator[Log]:
        """Simulate a batch, and yield its logs in order."""
        return self._pool.map(self._log, batch)

    def _log(self, job: _Job) -> Log:
        ((added, excitation), rng), rig = job, self._rig
        cycles = rig.clock.cycles(self._duration, rng)
        time = stamps_of(cycles)
        if rig.clock.jitter == 0 and isinstance(excitation, Multisine):
            sampled = _on_a_regular_clock(excitation, rig.clock.step, cycles.size)
        else:
            sampled = excitation.sample(time)
        commands = rig.path.shape_all(sampled)
        joint = GreyBoxJoint(rig.robot, added, angle=initial_angle(excitation))
        true = joint.angles_under(time, rig.path.deliver(commands), rig.path.delay)
        return rig.record((added, excitation), time, commands, true, rng)


@lru_cache(maxsize=4)
def _on_a_regular_clock(multisine: Multisine, step: float, count: int) -> NDArray[np.float64]:
    """Return a multisine at (count + 1,) stamps; runs that differ in the robot alone share it."""
    return multisine.sample(stamps_of(np.full(count, step)))


class _MujocoLoop:
    """Simulates batches of runs on a regular clock, of a robot that needs no `Assistance`.

    MuJoCo's own compiled loop does, in its threads.
    """

    def __init__(self, rig: Rig, duration: float, threads: int) -> None:
        clock = rig.clock
        self._rig = rig
        self._time = clock.step * np.arange(clock.count(duration) + 1, dtype=np.float64)
        self._model = compile_model(rig.robot)
        self._substeps = steps_of(clock.step)
        self._model.opt.timestep = clock.step / self._substeps
        self._data = [mujoco.MjData(self._model) for _ in range(threads)]
        self._pool = Rollout(nthread=threads)

    def __enter__(self) -> _MujocoLoop:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.close()

    def logs(self, batch: Sequence[_Job]) -> Iterator[Log]:
        """Simulate a batch, and yield its logs in order."""
        rig, time = self._rig, self._time
        excitations = [excitation for (_, excitation), _ in batch]
        inputs = np.array([rig.path.shape_all(each.sample(time)) for each in excitations])
        start = np.array([initial_angle(each) for each in excitations])
        angles = self._roll_out(
            [added for (added, _), _ in batch], start, rig.path.deliver(inputs[:, :-1])
        )
        for (run, rng), command, true in zip(batch, inputs, angles, strict=True):
            yield rig.record(run, time, command, true, rng)

    def _roll_out(
        self, added: list[AddedMass], start: NDArray[np.float64], held: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the (runs, cycles + 1) angles under (runs, cycles) held commands."""
        models = [copy.copy(self._model) for _ in added]
        for model, mass in zip(models, added, strict=True):
            mount(model, self._rig.robot, mass)
        controls = np.zeros((len(added), held.shape[1] * self._substeps, self._model.nu))
        controls[:, :, 0] = np.repeat(held, self._substeps, axis=1)
        size = mujoco.mj_stateSize(self._model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        states = np.zeros((len(added), size))
        states[:, 1] = start  # a state is time, angles, velocities
        reached, _ = self._pool.rollout(models, self._data, states, controls)
        if any(data.warning[_BAD_ACCELERATION].number for data in self._data):
            raise InputError("MuJoCo", "motion", "a joint that diverged", "smaller commands")
        return np.column_stack([start, reached[:, self._substeps - 1 :: self._substeps, 1]])


def replay_input(
    joint: Joint, log: Log, delay: float = 0.0, compression: float = 0.0
) -> NDArray[np.float64]:
    """Return the (n,) true angles in rad of a joint at a log's stamps, driven with its input.

    The input is compressed as its drive does, held at its mean over each step, its hold and a delay
    in s accounted for. Steps are short: MuJoCo's Coulomb friction, which creeps at rest, is the
    sharper the shorter they are. The joint starts at rest; one that diverges is an InputError.
    """
    joint.reset()
    counts = np.ceil(np.diff(log.time) / _REPLAY_STEP * (1 - 1e-9)).astype(np.intp)
    numbers = np.concatenate([[0], np.cumsum(counts)])
    instants = np.interp(np.arange(numbers[-1] + 1), numbers, log.time)
    inputs = compressed(log.input, compression)
    means = hold.mean(log.time, inputs, instants - delay, log.intersample)
    reached = [joint.angle]
    for mean, step in zip(means.tolist(), np.diff(instants).tolist(), strict=True):
        joint.advance(mean, step)
        reached.append(joint.angle)
    angles = np.array(reached)[numbers]
    if not np.isfinite(angles).all():
        raise InputError(log.source, "angle", "a joint that diverged", "another model or input")
    return np.asarray(angles)
