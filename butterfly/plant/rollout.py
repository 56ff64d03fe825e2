"""Open-loop runs: many of one robot in compiled loops, and one with a recorded input."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache
from itertools import islice
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS, Batch
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.logs.log import Log
from butterfly.model.kernel.servo_loop import Loop
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import IDEAL, DriveTerms
from butterfly.plant.joints import Joint, counts_of, held_between
from butterfly.plant.mjcf import compile_model, hinge_of
from butterfly.plant.rig import Firmware, Rig
from butterfly.plant.sensors import stamps_of
from butterfly.progress import Track, untracked
from butterfly.signals import hold
from butterfly.signals.excitations import Excitation, Multisine

_Job = tuple[tuple[AddedMass, Excitation], np.random.Generator]

_AHEAD = 16  # runs simulated ahead of what is taken, which bounds the memory they take
_SIDE_BY_SIDE = 8  # runs that one thread steps in turn, seldom back in Python
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
    """Simulate each run from its start (`Rig.start`), its excitation through a zero-order hold.

    The runs share ``threads``, by default one per core. Each log equals that of `Rig.play` bit for
    bit, but on an even clock up to rounding. A run is an added mass, an excitation, and a seed for
    all its random numbers.
    """
    jobs = list(zip(runs, map(np.random.default_rng, seeds), strict=True))
    threads = threads or os.cpu_count() or 1
    for number, log in enumerate(_simulated(rig, jobs, duration, threads, track)):
        sine = log.excitation
        what = f"{sine.omega:g}rads" if sine else "signal"
        yield replace(log, name=f"run{number:03d}_{1e3 * log.added_mass.mass:g}g_{what}")


def _simulated(
    rig: Rig, jobs: Sequence[_Job], duration: float, threads: int, track: Track
) -> Iterator[Log]:
    begun, size = _alone, 1
    if rig.runs_in_mujoco:
        rounds = math.ceil(len(jobs) / (threads * _SIDE_BY_SIDE))
        begun, size = _side_by_side, math.ceil(len(jobs) / (threads * rounds))
    batches = [jobs[k : k + size] for k in range(0, len(jobs), size)]
    with ThreadPoolExecutor(threads) as pool:
        under_way = deque[Future[list[Log]]]()
        waiting = iter(batches)
        for _ in track(batches, "Simulating"):
            for batch in islice(waiting, max(_AHEAD // size, threads) - len(under_way)):
                under_way.append(pool.submit(begun(rig, batch, duration)))
            yield from under_way.popleft().result()


def _alone(rig: Rig, batch: Sequence[_Job], duration: float) -> Callable[[], list[Log]]:
    """Prepare one run with any robot and simulator."""
    ((run, _),) = batch
    joint = rig.joint(run[0], *rig.start(*run))  # MuJoCo compiles one by one
    return lambda: [_run(rig, joint, duration, batch[0])]


def _run(rig: Rig, joint: Joint, duration: float, job: _Job) -> Log:
    """Simulate a run with any clock and path; return the log of `Rig.play`."""
    (added, excitation), rng = job
    if rig.servo is not None:
        return rig.play(added, excitation, duration, rng, joint)
    time, commands, arrivals = _commanded(rig, excitation, duration, rng)
    true = joint.angles_under(time, rig.path.delivered(commands), arrivals)
    return rig.record((added, excitation), time, commands, true, rng)


def _commanded(
    rig: Rig, excitation: Excitation, duration: float, rng: np.random.Generator
) -> tuple[Samples, Samples, Samples]:
    """Return the (n,) timestamps of a run, its commands, and when they arrive."""
    cycles = rig.clock.cycles(duration, rng)
    time = stamps_of(cycles)
    if rig.clock.even and isinstance(excitation, Multisine):
        sampled = _on_a_regular_clock(excitation, rig.clock.step, cycles.size)
    else:
        sampled = excitation.sample(time)
    late = rig.path.delay + rig.clock.late(time)
    return time, rig.path.shape_all(sampled), np.maximum.accumulate(time + late)


@lru_cache(maxsize=4)
def _on_a_regular_clock(multisine: Multisine, step: float, count: int) -> Samples:
    """Return a multisine at (count + 1,) timestamps, cached for runs of other robots."""
    return multisine.sample(stamps_of(np.full(count, step)))


class _Course(NamedTuple):
    """What MuJoCo does in a run."""

    time: Samples  # (n,) timestamps in s
    commands: Samples  # (n,)
    steps: Samples  # (m,) lengths in s
    held: Samples  # (m,) commands at the terminals
    rows: NDArray[np.intp]  # (n,) steps taken until each timestamp


def _course(rig: Rig, excitation: Excitation, duration: float, rng: np.random.Generator) -> _Course:
    """Plan a run: from sample to sample, and to each command that arrives between two."""
    if rig.clock.even and rig.path.delay == 0:
        count = rig.clock.count(duration)
        time = rig.clock.step * np.arange(count + 1, dtype=np.float64)
        commands = rig.path.shape_all(excitation.sample(time))
        held, lengths = rig.path.delivered(commands[:-1]), np.full(count, rig.clock.step)
        reached = np.arange(count + 1)
    else:
        time, commands, arrivals = _commanded(rig, excitation, duration, rng)
        edges, held = held_between(time, rig.path.delivered(commands), arrivals)
        lengths, reached = np.diff(edges), np.searchsorted(edges, time)
    counts = counts_of(lengths)
    steps, held = np.repeat(lengths / counts, counts), np.repeat(held, counts)
    rows = np.concatenate([[0], np.cumsum(counts)])[reached]
    return _Course(time, commands, steps, held, rows)


def _side_by_side(rig: Rig, batch: Sequence[_Job], duration: float) -> Callable[[], list[Log]]:
    """Prepare runs of a robot that needs no `Assistance`: MuJoCo steps them all in one call."""
    courses = [_course(rig, excitation, duration, rng) for (_, excitation), rng in batch]
    models = {added: compile_model(rig.robot, added) for (added, _), _ in batch}
    run_models = [models[added] for (added, _), _ in batch]
    hinge, runs = hinge_of(run_models[0]), Batch(run_models[0], len(batch), 1)
    for name in MODEL_FIELDS:  # in which the added masses differ
        values = [getattr(model, name, 0) for model in models.values()]
        if any(not np.array_equal(value, values[0]) for value in values[1:]):
            runs.expand(name)[:] = [getattr(model, name) for model in run_models]
    starts = np.array([rig.start(*run) for run, _ in batch])
    runs.bind("qpos")[:, hinge], runs.bind("qvel")[:, hinge] = starts.T

    def simulated() -> list[Log]:
        angles = _stepped(runs, hinge, courses)
        if runs.warning[:, _BAD_ACCELERATION, 1].any():
            raise InputError("MuJoCo", "motion", "a joint that diverged", "smaller commands")
        return [
            rig.record(run, course.time, course.commands, reached[course.rows], rng)
            for (run, rng), course, reached in zip(batch, courses, angles, strict=True)
        ]

    return simulated


def _stepped(runs: Batch, hinge: int, courses: Sequence[_Course]) -> Samples:
    """Return the (k, m + 1) angles in rad of k runs at the ends of their steps.

    Shorter runs go on without a command.
    """
    longest = max(course.steps.size for course in courses)
    steps, held = np.empty((longest, len(courses))), np.zeros((longest, len(courses)))
    for k, course in enumerate(courses):
        steps[:, k] = np.resize(course.steps, longest)
        held[: course.held.size, k] = course.held
    length, command = runs.expand("opt.timestep"), runs.bind("ctrl")[:, 0]
    angle = runs.bind("qpos")[:, hinge]
    reached = np.empty((longest + 1, len(courses)))
    reached[0] = angle
    if np.ptp(steps) == 0:
        length[:] = steps[0]
        commands = np.zeros((len(courses), longest, runs.model.nu))
        commands[:, :, 0] = held.T
        reached[1:] = runs.rollout(longest, commands)["qpos"][:, :, hinge].T
        return reached.T
    for k in range(longest):
        length[:], command[:] = steps[k], held[k]
        runs.step()
        reached[k + 1] = angle
    return reached.T


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
    means = hold.mean(log.arrivals(*slow), inputs, instants - delay, log.between_samples)
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
