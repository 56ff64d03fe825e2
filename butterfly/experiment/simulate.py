"""Simulate the runs of an experiment, and write their logs as a data set."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from butterfly.experiment.schema import Experiment
from butterfly.files import write_file
from butterfly.identification.data import DataSet
from butterfly.identification.segments import driven
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.logs.manifest import (
    MANIFEST_NAME,
    LogEntry,
    Manifest,
    manifest_text,
    own_units,
    write_manifest,
)
from butterfly.logs.mat import write_mat
from butterfly.logs.parquet import parquet_bytes
from butterfly.model.prior import Prior
from butterfly.outputs import require_free
from butterfly.plant.rig import Simulator
from butterfly.plant.robot import Shape
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Faults
from butterfly.progress import Track, untracked


def simulate(
    experiment: Experiment, *, threads: int | None = None, track: Track = untracked
) -> Iterator[Log]:
    """Simulate every run of an experiment, each with its own random stream."""
    rig, runs, seeds = experiment.plant.rig, experiment.runs(), experiment.seeds()
    for log in simulate_runs(rig, runs, experiment.duration, seeds, threads=threads, track=track):
        yield replace(log, source=log.name)


def data_set_of(experiment: Experiment, logs: Sequence[Log], track: Track = untracked) -> DataSet:
    """Return the data set of an experiment's logs, as read from `write_logs`."""
    data = DataSet.of(
        logs,
        name=experiment.name,
        description=experiment.description,
        known=Prior.of(experiment.known),
        track=track,
    )
    return data.holding_out(experiment.holdout)


def planned_logs(experiment: Experiment) -> list[Log]:
    """Return a log per run: timestamps, the open-loop input, and the initial state."""
    plain = replace(
        experiment.plant.rig,
        robot=replace(experiment.plant.robot, clutch=None),
        simulator=Simulator.GREY_BOX,
        faults=Faults(),
    )
    runs = experiment.runs()
    logs = simulate_runs(plain, runs, experiment.duration, experiment.seeds())
    planned = []
    for log, run in zip(logs, runs, strict=True):
        angle, velocity = plain.start(*run)
        course = log.angle if velocity else np.full(log.time.size, angle)
        planned.append(driven(replace(log, angle=course, velocity=None, source=log.name)))
    return planned


def write_logs(experiment: Experiment, logs: Iterable[Log], folder: Path) -> Path:
    """Write logs like the real ones, none over a foreign one; return the path of the manifest."""
    require_free(folder / MANIFEST_NAME)
    logs = list(logs)  # only now are they simulated
    for log in logs:
        require_free(folder / file_of(log))
    entries = []
    for log in logs:
        entries.append(LogEntry.carrying(file_of(log), log.added_mass, log.excitation))
        path = folder / entries[-1].file
        if log.servo is None:
            write_mat(log, path)
        else:
            write_file(path, parquet_bytes(log))
    path = folder / MANIFEST_NAME
    write_manifest(_manifest(experiment, entries), path)
    return path


def packed(experiment: Experiment, logs: Sequence[Log]) -> dict[str, bytes]:
    """Return the contents of the files of a data set, by name: logs as Parquet, and a manifest."""
    entries = [
        LogEntry.carrying(f"{log.name}.parquet", log.added_mass, log.excitation) for log in logs
    ]
    files = {entry.file: parquet_bytes(log) for entry, log in zip(entries, logs, strict=True)}
    return files | {MANIFEST_NAME: manifest_text(_manifest(experiment, entries)).encode()}


def file_of(log: Log) -> str:
    """Return the name of the file that `write_logs` writes a log to; a servo's has more columns."""
    return f"{log.name}.{'mat' if log.servo is None else 'parquet'}"


def _manifest(experiment: Experiment, entries: list[LogEntry]) -> Manifest:
    loop = experiment.plant.loop or {}
    return Manifest(
        name=experiment.name,
        description=experiment.description,
        input=InputKind.SETPOINT if loop else experiment.input_kind,
        loop=loop,
        units={} if loop else own_units(experiment.input_kind),
        shape="butterfly" if experiment.plant.robot.shape is Shape.BUTTERFLY else "bar",
        intersample=Intersample.ZERO_ORDER_HOLD,
        arm=next((entry.arm for entry in entries if entry.arm), None),
        holdout=list(experiment.holdout),
        known=experiment.known,
        logs=entries,
    )
