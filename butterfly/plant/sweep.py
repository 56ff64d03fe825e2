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
from butterfly.logs.log import Sine
from butterfly.plant.bench import Bench, recorded
from butterfly.plant.excitations import Excitation, initial_angle
from butterfly.plant.joints import Simulator, kind_of, steps_of
from butterfly.plant.mjcf import compile_model, mount
from butterfly.plant.motor import CommandPath, SimulatedMotor
from butterfly.plant.sensors import Clock, Encoder, Faults
from butterfly.progress import Track, untracked

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.model.parameters import AddedMass
    from butterfly.plant.robot import Robot

    _Job = tuple[tuple[AddedMass, Excitation], np.random.Generator]

_BAD_ACCELERATION = int(mujoco.mjtWarning.mjWARN_BADQACC)
_BATCH = 16  # runs simulated between two reports of progress, which bounds the memory they take


@dataclass(frozen=True, kw_only=True)
class Controller:
    """What applies the excitations and records, the duration of a run in s, and the simulator."""

    duration: float
    clock: Clock = Clock()
    encoder: Encoder = Encoder()
    path: CommandPath = CommandPath()
    faults: Faults = Faults()
    simulator: Simulator = Simulator.MUJOCO


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

    In MuJoCo and on a regular clock the runs share its compiled loop and its threads; on a jittered
    one, with a delayed command, a motor whose current is a state, friction that bends or weakens,
    or by the grey box, each goes through the motor wrapper. Both ways give the same log to within
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
    logs = _simulated(robot, jobs, controller, threads or os.cpu_count() or 1, track)
    for log, rng in zip(logs, generators, strict=True):
        yield controller.faults.apply(log, rng)


def _simulated(
    robot: Robot, jobs: Sequence[_Job], controller: Controller, workers: int, track: Track
) -> Iterator[Log]:
    irregular = controller.clock.jitter > 0 or controller.path.delay > 0
    friction = robot.friction
    if (
        irregular
        or controller.simulator is Simulator.GREY_BOX
        or robot.drive.time_constant > 0
        or friction.bristle_stiffness > 0
        or friction.sticks_harder
    ):
        for (added, excitation), rng in track(jobs, "Simulating"):
            yield through_wrapper(robot, added, excitation, controller, rng)
        return
    batches = [jobs[k : k + _BATCH] for k in range(0, len(jobs), _BATCH)]
    with Rollout(nthread=workers) as pool:
        loop = _CompiledLoop(robot, controller, pool, workers)
        for batch in track(batches, "Simulating"):
            yield from loop.logs(batch)


def through_wrapper(
    robot: Robot,
    added: AddedMass,
    excitation: Excitation,
    controller: Controller,
    rng: np.random.Generator,
) -> Log:
    """Simulate one run through the motor wrapper (see `sweep`)."""
    joint = controller.simulator.joint(robot, added, initial_angle(excitation))
    motor = SimulatedMotor(joint, path=controller.path, encoder=controller.encoder, rng=rng)
    with Bench(motor, clock=controller.clock, rng=rng) as bench:
        about = _about(added, excitation, controller.simulator)
        return bench.play(excitation.sample, controller.duration, **about)


def _about(
    added: AddedMass, excitation: Excitation, simulator: Simulator = Simulator.MUJOCO
) -> dict[str, Any]:
    """Return what a log says about its run."""
    sine = excitation if isinstance(excitation, Sine) else None
    source = "MuJoCo" if simulator is Simulator.MUJOCO else "grey box"
    return {"added_mass": added, "excitation": sine, "source": source}


class _CompiledLoop:
    """Simulates batches of runs on a regular clock in MuJoCo's own threads."""

    def __init__(self, robot: Robot, controller: Controller, pool: Rollout, workers: int) -> None:
        self._robot = robot
        self._controller = controller
        self._pool = pool
        self._model = compile_model(robot)
        self._substeps = steps_of(controller.clock.step)
        self._model.opt.timestep = controller.clock.step / self._substeps
        self._data = [mujoco.MjData(self._model) for _ in range(workers)]

    def logs(self, batch: Sequence[_Job]) -> Iterator[Log]:
        """Simulate a batch, and yield its logs in order."""
        controller = self._controller
        count = controller.clock.count(controller.duration)
        time = np.asarray(controller.clock.step * np.arange(count + 1), dtype=np.float64)
        excitations = [excitation for (_, excitation), _ in batch]
        inputs = np.array([controller.path.shape_all(each.sample(time)) for each in excitations])
        start = np.array([initial_angle(each) for each in excitations])
        angles = self._roll_out(
            [added for (added, _), _ in batch], start, controller.path.deliver(inputs[:, :-1])
        )
        for ((added, excitation), rng), command, true in zip(batch, inputs, angles, strict=True):
            angle = controller.encoder.read(time, true, rng)
            about = _about(added, excitation)
            yield recorded(time, command, angle, input_kind=kind_of(self._robot.drive), **about)

    def _roll_out(
        self, added: list[AddedMass], start: NDArray[np.float64], held: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the (runs, cycles + 1) angles under (runs, cycles) held commands."""
        models = [copy.copy(self._model) for _ in added]
        for model, mass in zip(models, added, strict=True):
            mount(model, self._robot, mass)
        controls = np.zeros((len(added), held.shape[1] * self._substeps, self._model.nu))
        controls[:, :, 0] = np.repeat(held, self._substeps, axis=1)
        size = mujoco.mj_stateSize(self._model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        states = np.zeros((len(added), size))
        states[:, 1] = start  # a state is time, angles, velocities
        reached, _ = self._pool.rollout(models, self._data, states, controls)
        if any(data.warning[_BAD_ACCELERATION].number for data in self._data):
            raise InputError("MuJoCo", "motion", "a joint that diverged", "smaller commands")
        return np.column_stack([start, reached[:, self._substeps - 1 :: self._substeps, 1]])
