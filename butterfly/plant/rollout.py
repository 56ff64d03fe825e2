"""Many open-loop runs of one robot, in a compiled loop where one can do them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.plant.excitations import Excitation
from butterfly.plant.grey_box_loop import GreyBoxLoop
from butterfly.plant.joints import Simulator
from butterfly.plant.mujoco_loop import MujocoLoop
from butterfly.plant.setup import Setup
from butterfly.progress import Track, untracked

Job = tuple[tuple[AddedMass, Excitation], np.random.Generator]

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

    The runs share a compiled loop and its threads where nothing has to be done between steps (see
    `Setup.runs_open_loop`); otherwise each goes through the motor wrapper. The grey box's loop
    gives the wrapper's log bit for bit, MuJoCo's to within rounding.

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
    setup: Setup, jobs: Sequence[Job], duration: float, workers: int, track: Track
) -> Iterator[Log]:
    if not setup.runs_open_loop:
        for (added, excitation), rng in track(jobs, "Simulating"):
            yield setup.play(added, excitation, duration, rng)
        return
    batches = [jobs[k : k + _BATCH] for k in range(0, len(jobs), _BATCH)]
    compiled = GreyBoxLoop if setup.simulator is Simulator.GREY_BOX else MujocoLoop
    with compiled(setup, duration, workers) as loop:
        for batch in track(batches, "Simulating"):
            yield from loop.logs(batch)
