"""Run an experiment: simulate, write the logs, read them back as anybody's, identify."""

from __future__ import annotations

from typing import TYPE_CHECKING

from butterfly.identify.data import read_data_set
from butterfly.identify.identification import Identification, identify
from butterfly.logs.log import Intersample
from butterfly.logs.manifest import (
    MANIFEST_NAME,
    LogEntry,
    Manifest,
    read_manifest,
    write_manifest,
)
from butterfly.logs.mat import write_mat
from butterfly.plant.sweep import sweep
from butterfly.progress import Track, untracked

if TYPE_CHECKING:
    from pathlib import Path

    from butterfly.experiment.schema import Experiment
    from butterfly.logs.log import Log


def simulate(experiment: Experiment, folder: Path, track: Track = untracked) -> Path:
    """Simulate every run of an experiment and write logs and manifest into ``folder``.

    Each run draws from its own random stream, so its log depends on the seed and its place in the
    experiment only.

    Returns
    -------
    Path of the manifest, which is written last.
    """
    runs, seeds = experiment.runs(), experiment.seeds()
    entries = []
    for log in sweep(experiment.plant.setup, runs, experiment.duration, seeds, track=track):
        entry = entry_of(log, "mat")
        write_mat(log, folder / entry.file)
        entries.append(entry)
    path = folder / MANIFEST_NAME
    write_manifest(manifest_of(experiment, entries), path)
    return path


def entry_of(log: Log, suffix: str) -> LogEntry:
    """Name a file for one log of an experiment, and say what it holds."""
    sine, added = log.excitation, log.added_mass
    return LogEntry(
        file=f"{log.name}.{suffix}",
        added_mass=added.mass,
        arm=added.arm,
        omega=sine.omega if sine else None,
        amplitude=sine.amplitude if sine else None,
    )


def manifest_of(experiment: Experiment, entries: list[LogEntry]) -> Manifest:
    """Return the manifest of an experiment's logs."""
    return Manifest(
        name=experiment.name,
        description=experiment.description,
        input=experiment.input_kind,
        intersample=Intersample.ZERO_ORDER_HOLD,
        arm=entries[0].arm or 0.0,
        logs=entries,
    )


def run(experiment: Experiment, folder: Path, track: Track = untracked) -> Identification:
    """Simulate an experiment into ``folder`` and identify the robot from the files written."""
    manifest = simulate(experiment, folder, track)
    data = read_data_set(read_manifest(manifest), track)
    return identify(data, experiment.all_estimators[0], track=track)
