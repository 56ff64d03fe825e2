"""Open-loop sweeps: many sines on one robot in MuJoCo."""

from __future__ import annotations

import copy
import math
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from butterfly.errors import InputError
from butterfly.logs.log import Intersample, Log, Sine
from butterfly.plant.bench import Bench
from butterfly.plant.joints import MujocoJoint, kind_of, steps_of
from butterfly.plant.mjcf import compile_model, mount
from butterfly.plant.motor import CommandPath, Reading, SimulatedMotor
from butterfly.plant.sensors import Clock, Encoder, filtered_difference
from butterfly.progress import Track, untracked

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from butterfly.model.parameters import AddedMass
    from butterfly.plant.mjcf import Robot

_BATCH = 16  # runs simulated between two reports of progress, which bounds the memory they take


@dataclass(frozen=True, kw_only=True)
class Controller:
    """The controller that applies the sines: its clock, encoder, command path and duration in s."""

    duration: float
    clock: Clock = Clock()
    encoder: Encoder = Encoder()
    path: CommandPath = CommandPath()

    def __post_init__(self) -> None:
        if not (math.isfinite(self.duration) and self.duration > 0):
            raise InputError(
                "experiment", "duration", self.duration, "a finite positive number of s"
            )


def sweep(
    robot: Robot,
    runs: Sequence[tuple[AddedMass, Sine]],
    controller: Controller,
    seeds: Sequence[np.random.SeedSequence],
    *,
    threads: int | None = None,
    track: Track = untracked,
) -> Iterator[Log]:
    """Simulate each run from rest, hanging down, its sine applied through a zero-order hold.

    On a regular clock the runs share MuJoCo's compiled loop and its threads; on a jittered one, or
    with a delayed command, each goes through the motor wrapper. Both give the same log to within
    rounding.

    Parameters
    ----------
    robot
        The robot.
    runs
        What it carries, and the sine, of each run.
    controller
        What applies the sines and records.
    seeds
        One for each run, the source of everything random in it.
    threads
        Of the compiled loop; one per core if not given.
    track
        Shows progress.

    Yields
    ------
    The log of each run, in order.

    Raises
    ------
    InputError
        If a simulation diverges.
    """
    generators = [np.random.default_rng(seed) for seed in seeds]
    jobs = list(zip(runs, generators, strict=True))
    if controller.clock.jitter > 0 or controller.path.delay > 0:
        for (added, sine), rng in track(jobs, "Simulating in MuJoCo"):
            yield through_wrapper(robot, added, sine, controller, rng)
        return
    model = compile_model(robot)
    substeps = steps_of(controller.clock.step)
    model.opt.timestep = controller.clock.step / substeps
    batches = [jobs[k : k + _BATCH] for k in range(0, len(jobs), _BATCH)]
    workers = [mujoco.MjData(model) for _ in range(threads or os.cpu_count() or 1)]
    with Rollout(nthread=len(workers)) as pool:

        def roll_out(
            models: list[mujoco.MjModel], held: NDArray[np.float64]
        ) -> NDArray[np.float64]:
            """Return the (runs, cycles + 1) angles under (runs, cycles) held commands."""
            controls = np.repeat(held, substeps, axis=1)[:, :, None]
            size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
            start = np.zeros((len(models), size))
            states, _ = pool.rollout(models, workers, start, controls)
            angles = states[:, substeps - 1 :: substeps, 1]  # the state is time, angle, velocity
            return np.column_stack([start[:, 1], angles])

        for batch in track(batches, "Simulating in MuJoCo"):
            yield from _together(batch, model, controller, robot, roll_out)


def through_wrapper(
    robot: Robot, added: AddedMass, sine: Sine, controller: Controller, rng: np.random.Generator
) -> Log:
    """Simulate one run through the motor wrapper (see `sweep`)."""
    motor = SimulatedMotor(
        MujocoJoint(robot, added), path=controller.path, encoder=controller.encoder, rng=rng
    )

    def law(reading: Reading) -> float:
        return sine.amplitude * math.sin(sine.omega * reading.time)

    with Bench(motor, clock=controller.clock, rng=rng) as bench:
        return bench.run(
            law, controller.duration, added_mass=added, excitation=sine, source="MuJoCo"
        )


def _together(
    batch: Sequence[tuple[tuple[AddedMass, Sine], np.random.Generator]],
    model: mujoco.MjModel,
    controller: Controller,
    robot: Robot,
    roll_out: Callable[[list[mujoco.MjModel], NDArray[np.float64]], NDArray[np.float64]],
) -> Iterator[Log]:
    """Simulate a batch of runs on a regular clock."""
    count = max(round(controller.duration / controller.clock.step), 1)
    time = np.asarray(controller.clock.step * np.arange(count + 1), dtype=np.float64)
    commands = [sine.amplitude * np.sin(sine.omega * time) for (_, sine), _ in batch]
    inputs = np.array([controller.path.shape_all(command) for command in commands])
    angles = roll_out([_loaded(model, added) for (added, _), _ in batch], inputs[:, :-1])
    if not np.isfinite(angles).all():
        raise InputError("MuJoCo", "angle", "a joint that diverged", "smaller commands")
    for ((added, sine), rng), command, true in zip(batch, inputs, angles, strict=True):
        angle = controller.encoder.read(true, rng)
        yield Log(
            time=time,
            input=command,
            angle=angle,
            velocity=filtered_difference(time, angle),
            input_kind=kind_of(robot.drive),
            intersample=Intersample.ZERO_ORDER_HOLD,
            added_mass=added,
            excitation=sine,
            source="MuJoCo",
        )


def _loaded(model: mujoco.MjModel, added: AddedMass) -> mujoco.MjModel:
    loaded = copy.copy(model)
    mount(loaded, added)
    return loaded
