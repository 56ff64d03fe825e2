"""Open-loop sweeps: many runs of one robot in MuJoCo."""

from __future__ import annotations

import copy
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from butterfly.errors import InputError
from butterfly.logs.log import Intersample, Log, Sine
from butterfly.plant.bench import Bench
from butterfly.plant.excitations import Excitation, initial_angle
from butterfly.plant.joints import MujocoJoint, kind_of, steps_of
from butterfly.plant.mjcf import compile_model, mount
from butterfly.plant.motor import CommandPath, SimulatedMotor
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
    """What applies the excitations: clock, encoder, command path, and duration of a run in s."""

    duration: float
    clock: Clock = Clock()
    encoder: Encoder = Encoder()
    path: CommandPath = CommandPath()


def sweep(
    robot: Robot,
    runs: Sequence[tuple[AddedMass, Excitation]],
    controller: Controller,
    seeds: Sequence[np.random.SeedSequence],
    *,
    threads: int | None = None,
    track: Track = untracked,
) -> Iterator[Log]:
    """Simulate each run from rest, hanging down, its excitation applied through a zero-order hold.

    On a regular clock the runs share MuJoCo's compiled loop and its threads; on a jittered one, or
    with a delayed command, each goes through the motor wrapper. Both give the same log to within
    rounding.

    Parameters
    ----------
    robot
        The robot.
    runs
        What it carries and its excitation, for each run.
    controller
        What applies the excitations and records.
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
        for (added, excitation), rng in track(jobs, "Simulating in MuJoCo"):
            yield through_wrapper(robot, added, excitation, controller, rng)
        return
    model = compile_model(robot)
    substeps = steps_of(controller.clock.step)
    model.opt.timestep = controller.clock.step / substeps
    batches = [jobs[k : k + _BATCH] for k in range(0, len(jobs), _BATCH)]
    workers = [mujoco.MjData(model) for _ in range(threads or os.cpu_count() or 1)]
    with Rollout(nthread=len(workers)) as pool:

        def roll_out(
            models: list[mujoco.MjModel],
            angles: NDArray[np.float64],
            held: NDArray[np.float64],
        ) -> NDArray[np.float64]:
            """Return the (runs, cycles + 1) angles under (runs, cycles) held commands."""
            controls = np.repeat(held, substeps, axis=1)[:, :, None]
            size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
            start = np.zeros((len(models), size))
            start[:, 1] = angles  # the state is time, angle, velocity
            states, _ = pool.rollout(models, workers, start, controls)
            return np.column_stack([angles, states[:, substeps - 1 :: substeps, 1]])

        for batch in track(batches, "Simulating in MuJoCo"):
            yield from _together(batch, model, controller, robot, roll_out)


def through_wrapper(
    robot: Robot,
    added: AddedMass,
    excitation: Excitation,
    controller: Controller,
    rng: np.random.Generator,
) -> Log:
    """Simulate one run through the motor wrapper (see `sweep`)."""
    joint = MujocoJoint(robot, added, angle=initial_angle(excitation))
    motor = SimulatedMotor(joint, path=controller.path, encoder=controller.encoder, rng=rng)
    with Bench(motor, clock=controller.clock, rng=rng) as bench:
        return bench.play(excitation.sample, controller.duration, **_about(added, excitation))


def _about(added: AddedMass, excitation: Excitation) -> dict[str, Any]:
    """Return what a log says about its run."""
    sine = excitation if isinstance(excitation, Sine) else None
    return {"added_mass": added, "excitation": sine, "source": "MuJoCo"}


def _together(
    batch: Sequence[tuple[tuple[AddedMass, Excitation], np.random.Generator]],
    model: mujoco.MjModel,
    controller: Controller,
    robot: Robot,
    roll_out: Callable[..., NDArray[np.float64]],
) -> Iterator[Log]:
    """Simulate a batch of runs on a regular clock."""
    count = controller.clock.count(controller.duration)
    time = np.asarray(controller.clock.step * np.arange(count + 1), dtype=np.float64)
    excitations = [excitation for (_, excitation), _ in batch]
    inputs = np.array([controller.path.shape_all(each.sample(time)) for each in excitations])
    models = [_loaded(model, added) for (added, _), _ in batch]
    angles = roll_out(models, np.array(list(map(initial_angle, excitations))), inputs[:, :-1])
    if not np.isfinite(angles).all():
        raise InputError("MuJoCo", "angle", "a joint that diverged", "smaller commands")
    for ((added, excitation), rng), command, true in zip(batch, inputs, angles, strict=True):
        angle = controller.encoder.read(true, rng)
        yield Log(
            time=time,
            input=command,
            angle=angle,
            velocity=filtered_difference(time, angle),
            input_kind=kind_of(robot.drive),
            intersample=Intersample.ZERO_ORDER_HOLD,
            **_about(added, excitation),
        )


def _loaded(model: mujoco.MjModel, added: AddedMass) -> mujoco.MjModel:
    loaded = copy.copy(model)
    mount(loaded, added)
    return loaded
