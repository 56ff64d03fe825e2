"""One run: simulate, identify, validate, hold the orbit, compare with the truth."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.compiled import compiling_beside
from butterfly.errors import ButterflyError, IdentifiabilityError
from butterfly.experiment.record import (
    FAILED,
    OK,
    REFUSED,
    EstimateRecord,
    OrbitRecord,
    Outcome,
    RunRecord,
    Task,
)
from butterfly.experiment.schema import ControlSpec, Experiment
from butterfly.experiment.source import filled
from butterfly.files import write_file
from butterfly.identification.consistency import with_scale
from butterfly.identification.data import DataSet
from butterfly.identification.derived_quantities import implied
from butterfly.identification.estimators import Estimator, OutputError
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identified import Identified
from butterfly.identification.identify import identify, judged
from butterfly.identification.segments import driven
from butterfly.identification.simulation import rehearse
from butterfly.identification.validate import cross_validate
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
from butterfly.orbit.loop import OrbitStudy, study_orbit
from butterfly.outputs import require_free
from butterfly.plant.rig import Simulator
from butterfly.plant.robot import Shape
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Faults
from butterfly.progress import Track, budget, current_search, phase, untracked
from butterfly.result import versions
from butterfly.signals.excitations import Table


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


def perform(
    experiment: Experiment,
    *,
    task: Task | None = None,
    threads: int | None = None,
    track: Track = untracked,
) -> Outcome:
    """Perform one run (by default with a thread per core); errors are recorded too.

    The record tells the place of the ``task`` in its sweep.
    """
    run = _Run(experiment, threads, track)
    with run.timed("total"):
        try:
            run.do()
        except Exception as error:
            run.error = error
    return run.outcome(task)


def execute(task: Task, tables: Mapping[str, Table], seconds: float = math.inf) -> Outcome:
    """Perform a task on any worker, with one thread; search for some seconds."""
    try:
        experiment = Experiment.model_validate(filled(task.content, tables))
    except ValueError as error:
        return task.failed(f"the experiment is invalid in this version: {error}")
    with budget(seconds):
        return perform(experiment, task=task, threads=1).sent


class _Run:
    """A run while it is performed."""

    def __init__(self, experiment: Experiment, threads: int | None, track: Track) -> None:
        self._experiment, self._threads, self._track = experiment, threads, track
        self._truth = experiment.plant.robot.lumped
        self._seconds: dict[str, float] = {}
        self._estimates: list[EstimateRecord] = []
        self._stopped_after: float | None = None  # s of searching
        self.error: Exception | None = None  # what ended it early, or why there is no result
        self.logs: list[Log] = []  # simulated, in order
        self.identifications: dict[str, Identified] = {}  # by the labels of their estimators
        self.orbit: OrbitStudy | None = None

    def outcome(self, task: Task | None) -> Outcome:
        """Return what came of it."""
        place: dict[str, Any] = {}
        if task is not None:
            names = ("key", "overrides", "repetition")
            place = {name: getattr(task, name) for name in names}
        keep = self._experiment.keep_signals and self.logs
        return Outcome(
            record=replace(self._record, **place),
            files=packed(self._experiment, self.logs) if keep else {},
            logs=tuple(self.logs),
            identifications=self.identifications,
            orbit=self.orbit,
            error=self.error,
        )

    @property
    def _record(self) -> RunRecord:
        status, reason = OK, ""
        if self.error is not None:
            refused = isinstance(self.error, ButterflyError)
            status = REFUSED if refused else FAILED
            reason = str(self.error) if refused else f"{type(self.error).__name__}: {self.error}"
        return RunRecord(
            status=status,
            error=reason,
            seed=self._experiment.seed,
            logs=len(self.logs),
            estimates=tuple(self._estimates),
            orbit=None if self.orbit is None else OrbitRecord.of(self.orbit),
            stopped_after=self._stopped_after,
            versions=versions(),
            seconds=self._seconds,
        )

    def do(self) -> None:
        """Perform the run; raise the error that ends it early."""
        experiment, data = self._experiment, None
        if experiment.runs():
            self._refuse_without_scale()
            compilation = nullcontext() if self._threads == 1 else compiling_beside(rehearse)
            with self.timed("simulate"), phase("Simulating"), compilation:
                self.logs.extend(simulate(experiment, threads=self._threads, track=self._track))
            with self.timed("identify"), phase("Identifying"):
                data = data_set_of(experiment, self.logs, self._track)
                for spec in experiment.all_estimators:
                    with self._searching():
                        self._identify(data, spec)
        if experiment.control is not None:
            with self.timed("orbit"), self._searching():
                self.orbit = self._hold_orbit(experiment.control, data)
        elif not self.identifications:
            raise IdentifiabilityError(self._estimates[0].error)

    def _refuse_without_scale(self) -> None:
        """Raise IdentifiabilityError before any simulation if added masses leave the scale open."""
        experiment, specs = self._experiment, self._experiment.all_estimators
        if experiment.control is not None or any(spec.method == "thesis" for spec in specs):
            return
        known = implied(Prior.of(experiment.known), experiment.input_kind)
        try:
            with_scale(experiment.added_masses, known)
        except IdentifiabilityError as error:
            self._estimates += [EstimateRecord(estimator=s.label, error=str(error)) for s in specs]
            raise

    @contextmanager
    def timed(self, part: str) -> Iterator[None]:
        """Record the duration of a part."""
        begun = time.perf_counter()
        try:
            yield
        finally:
            self._seconds[part] = time.perf_counter() - begun

    @contextmanager
    def _searching(self) -> Iterator[None]:
        """Limit the search of a part to its budget, and record whether it was stopped."""
        whole = current_search()
        with budget(whole.seconds) as search:
            yield
        if search.left_out:
            self._stopped_after = search.seconds
            whole.skip(search.left_out)

    def _hold_orbit(self, control: ControlSpec, data: DataSet | None) -> OrbitStudy:
        """Hold an orbit with the believed parameters, or the first estimate from ``data``."""
        experiment, believed, zero = self._experiment, control.believed, 0.0
        small_swings = None
        if believed is None:
            assert data is not None  # noqa: S101 - the schema asks for logs then
            first = experiment.all_estimators[0]
            known = self.identifications.get(first.label)
            small_swings = known.estimate if known else judged(data, first)[1]
            believed = small_swings.parameters
            of_mass = data.equilibria
            zero = of_mass.get(control.added_masses[0], float(np.mean(list(of_mass.values()))))
        rng, rig = np.random.default_rng(experiment.orbit_seed), experiment.plant.rig
        return study_orbit(
            partial(rig.run, rng=rng),
            believed,
            zero,
            control,
            small_swings=small_swings,
            plants=rig.rough_and_fine(experiment.orbit_seed),
            path=rig.path,
            rng=rng,
            name=experiment.name,
            description=experiment.description,
            track=self._track,
        )

    def _identify(self, data: DataSet, spec: Estimator) -> None:
        """Add the estimate of an estimator, or its error."""
        try:
            identified = identify(data, self._threaded(spec), track=self._track)
        except ButterflyError as error:
            self._estimates.append(EstimateRecord(estimator=spec.label, error=str(error)))
            return
        self.identifications[spec.label] = replace(identified, truth=self._truth)
        estimate = identified.estimate
        held_out = np.array(list(identified.held_out.values()))
        names, how = (*estimate.names, *estimate.known.fixed), self._experiment.validation
        record = EstimateRecord(
            estimator=spec.label,
            estimate=estimate,
            truth={name: float(getattr(self._truth, name)) for name in names},
            fit=identified.fit,
            holdout=FitSummary.of(held_out) if held_out.size else None,
        )
        if how is not None:
            plain, track, seen = self._threaded(spec), self._track, identified.data
            try:
                held = cross_validate(seen, plain, how.split, folds=how.folds, track=track)
                record = replace(record, held_out=held.summary)
            except ButterflyError as error:
                record = replace(record, error=f"no cross-validation: {error}")
        self._estimates.append(record)

    def _threaded(self, spec: Estimator) -> Estimator:
        """Return an estimator limited to the allowed threads."""
        if self._threads is not None and isinstance(spec, OutputError) and spec.workers == 0:
            return replace(spec, workers=self._threads)
        return spec
