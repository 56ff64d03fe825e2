"""Open-loop runs: many of one robot in compiled loops, and one with a recorded input."""

from __future__ import annotations

import copy
import math
import os
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache
from itertools import islice

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.logs.log import Log
from butterfly.model.kernel.servo_loop import Loop
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import IDEAL, DriveTerms
from butterfly.plant.firmware import Firmware
from butterfly.plant.joints import Joint, steps_of
from butterfly.plant.mjcf import compile_model, hinge_of, mount
from butterfly.plant.rig import Rig
from butterfly.plant.sensors import stamps_of
from butterfly.progress import Track, untracked
from butterfly.signals import hold
from butterfly.signals.excitations import Excitation, Multisine, initial_angle

_Job = tuple[tuple[AddedMass, Excitation], np.random.Generator]

_BATCH = 16  # runs simulated ahead of what is taken, which bounds the memory they take
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
    """Simulate each run from hanging at rest, with its excitation through a zero-order hold.

    The runs share ``threads``, by default one per core. Each log equals that of `Rig.play` bit for
    bit, or up to rounding if MuJoCo simulates whole runs (`Rig.runs_in_mujoco`). A run is an added
    mass, an excitation, and a seed for all its random numbers.
    """
    generators = [np.random.default_rng(seed) for seed in seeds]
    jobs = list(zip(runs, generators, strict=True))
    threads = threads or os.cpu_count() or 1
    for number, log in enumerate(_simulated(rig, jobs, duration, threads, track)):
        sine = log.excitation
        what = f"{sine.omega:g}rads" if sine else "signal"
        yield replace(log, name=f"run{number:03d}_{1e3 * log.added_mass.mass:g}g_{what}")


def _simulated(
    rig: Rig, jobs: Sequence[_Job], duration: float, threads: int, track: Track
) -> Iterator[Log]:
    if rig.runs_in_mujoco:
        batches = [jobs[k : k + _BATCH] for k in range(0, len(jobs), _BATCH)]
        yield from _by_mujoco(rig, track(batches, "Simulating"), duration, threads)
        return
    with ThreadPoolExecutor(threads) as pool:
        under_way = deque[Future[Log]]()
        waiting = iter(jobs)
        for _ in track(jobs, "Simulating"):
            for job in islice(waiting, _BATCH - len(under_way)):
                added, excitation = job[0]  # MuJoCo compiles models one by one
                joint = rig.joint(added, initial_angle(excitation))
                under_way.append(pool.submit(_run, rig, joint, duration, job))
            yield under_way.popleft().result()


def _run(rig: Rig, joint: Joint, duration: float, job: _Job) -> Log:
    """Simulate a run with any clock and path; return the log of `Rig.play`."""
    (added, excitation), rng = job
    if rig.servo is not None:
        return rig.play(added, excitation, duration, rng, joint)
    cycles = rig.clock.cycles(duration, rng)
    time = stamps_of(cycles)
    if rig.clock.even and isinstance(excitation, Multisine):
        sampled = _on_a_regular_clock(excitation, rig.clock.step, cycles.size)
    else:
        sampled = excitation.sample(time)
    commands = rig.path.shape_all(sampled)
    arrivals = np.maximum.accumulate(time + (rig.path.delay + rig.clock.late(time)))
    true = joint.angles_under(time, rig.path.delivered(commands), arrivals)
    return rig.record((added, excitation), time, commands, true, rng)


@lru_cache(maxsize=4)
def _on_a_regular_clock(multisine: Multisine, step: float, count: int) -> Samples:
    """Return a multisine at (count + 1,) timestamps, cached for runs of other robots."""
    return multisine.sample(stamps_of(np.full(count, step)))


def _by_mujoco(
    rig: Rig, batches: Iterable[Sequence[_Job]], duration: float, threads: int
) -> Iterator[Log]:
    """Simulate runs on a regular clock, of a robot that needs no `Assistance`."""
    step, count = rig.clock.step, rig.clock.count(duration)
    time = step * np.arange(count + 1, dtype=np.float64)
    substeps = steps_of(step)
    model = compile_model(rig.robot)
    model.opt.timestep = step / substeps
    workers = [mujoco.MjData(model) for _ in range(threads)]
    hinge = 1 + hinge_of(model)  # after time, among angles
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    with Rollout(nthread=threads) as pool:
        for batch in batches:
            inputs = np.array([rig.path.shape_all(run.sample(time)) for (_, run), _ in batch])
            held = rig.path.delivered(inputs[:, :-1])
            controls = np.zeros((len(batch), count * substeps, model.nu))
            controls[:, :, 0] = np.repeat(held, substeps, axis=1)
            states = np.zeros((len(batch), size))
            states[:, hinge] = [initial_angle(run) for (_, run), _ in batch]
            models = [copy.copy(model) for _ in batch]
            for own, ((added, _), _) in zip(models, batch, strict=True):
                mount(own, rig.robot, added)
            reached, _ = pool.rollout(models, workers, states, controls)
            if any(data.warning[_BAD_ACCELERATION].number for data in workers):
                raise InputError("MuJoCo", "motion", "a joint that diverged", "smaller commands")
            ends = reached[:, substeps - 1 :: substeps, hinge]
            angles = np.column_stack([states[:, hinge], ends])
            for (run, rng), command, true in zip(batch, inputs, angles, strict=True):
                yield rig.record(run, time, command, true, rng)


def replay_input(
    joint: Joint,
    log: Log,
    delay: float = 0.0,
    drive: DriveTerms = IDEAL,
    slow: tuple[float, float] = (0.0, 0.0),
) -> Samples:
    """Return the (n,) true angles in rad of a joint at a log's timestamps, driven by its input.

    The input is the output of the drive, averaged over each step with its hold, a delay in s, and
    the ``slow`` delay and interval of its clock's regimes. Steps are short, as MuJoCo's Coulomb
    friction, which creeps at rest, is sharper for shorter steps.
    """
    joint.reset()
    counts = np.ceil(np.diff(log.time) / _REPLAY_STEP * (1 - 1e-9)).astype(np.intp)
    numbers = np.concatenate([[0], np.cumsum(counts)])
    instants = np.interp(np.arange(numbers[-1] + 1), numbers, log.time)
    inputs = drive.delivered(log.command[1])
    means = hold.mean(log.arrivals(*slow), inputs, instants - delay, log.intersample)
    angles: Samples = joint.follow(means, np.diff(instants))[numbers]
    _require_motion(angles, log)
    return angles


def replay_loop(
    joint: Joint, log: Log, grid: Samples, loop: Loop, longest: float = _REPLAY_STEP
) -> tuple[Samples, Samples]:
    """Return the (n,) true angles and velocities of a joint in a log's loop on a grid in s.

    Between grid points the steps are equal, at most ``longest`` s.
    """
    joint.reset()
    firmware = Firmware(loop)
    states = np.empty((grid.size, 2))
    for k, duration in enumerate(np.diff(grid)):
        states[k] = joint.angle, joint.velocity
        firmware.update(joint, k)
        count = math.ceil(duration / longest * (1 - 1e-9))
        joint.follow(np.full(count, firmware.command), np.full(count, duration / count))
    states[-1] = joint.angle, joint.velocity
    _require_motion(states, log)
    return states[:, 0], states[:, 1]


def _require_motion(states: Samples, log: Log) -> None:
    if not np.isfinite(states).all():
        raise InputError(log.source, "angle", "a joint that diverged", "another model or input")
