"""Do one run: simulate, identify, validate, hold the orbit, compare with the truth."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

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
from butterfly.experiment.simulate import data_set_of, packed, simulate
from butterfly.experiment.source import filled
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import Estimator, OutputError
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identification import Identification
from butterfly.identification.identify import identify, judged
from butterfly.identification.validate import cross_validate
from butterfly.logs.log import Log
from butterfly.orbit.loop import OrbitStudy, study_orbit
from butterfly.progress import Track, untracked
from butterfly.result import versions
from butterfly.signals.excitations import Table


@dataclass(frozen=True, kw_only=True, eq=False)
class RunResult:
    """What a run gave: the record to keep, and the whole of it to look at."""

    record: RunRecord
    error: Exception | None  # what ended it early, or why there is no result
    logs: tuple[Log, ...]  # simulated, in order
    identifications: dict[str, Identification]  # of estimators that gave one, by their labels
    orbit: OrbitStudy | None  # if one was held


def perform(
    experiment: Experiment, *, threads: int | None = None, track: Track = untracked
) -> RunResult:
    """Do one run; whatever goes wrong is recorded with what there was until then.

    The ``threads`` of the simulation are one per core if not given; no result depends on them.
    """
    run = _Run(experiment, threads, track)
    error: Exception | None = None
    with run.timed("total"):
        try:
            run.do()
        except Exception as ending:
            error = ending
    status, reason = OK, ""
    if error is not None:
        refused = isinstance(error, ButterflyError)
        status = REFUSED if refused else FAILED
        reason = str(error) if refused else f"{type(error).__name__}: {error}"
    record = RunRecord(
        status=status,
        error=reason,
        seed=experiment.seed,
        logs=len(run.logs),
        estimates=tuple(run.estimates),
        orbit=None if run.orbit is None else OrbitRecord.of(run.orbit),
        versions=versions(),
        seconds=run.seconds,
    )
    return RunResult(
        record=record,
        error=error,
        logs=tuple(run.logs),
        identifications=run.identifications,
        orbit=run.orbit,
    )


def execute(task: Task, tables: Mapping[str, Table]) -> Outcome:
    """Do a task, on any worker, with one thread."""
    try:
        experiment = Experiment.model_validate(filled(task.content, tables))
    except ValueError as error:
        return task.failed(f"not planned by this version: {error}")
    return outcome_of(task, experiment, perform(experiment, threads=1))


def outcome_of(task: Task, experiment: Experiment, result: RunResult) -> Outcome:
    """Return what is kept of a task's result."""
    record = replace(
        result.record, key=task.key, overrides=task.overrides, repetition=task.repetition
    )
    keep = experiment.keep_signals and result.logs
    return Outcome(record=record, files=packed(experiment, result.logs) if keep else {})


class _Run:
    """A run under way, and what it has given so far."""

    def __init__(self, experiment: Experiment, threads: int | None, track: Track) -> None:
        self._experiment, self._threads, self._track = experiment, threads, track
        self._truth = experiment.plant.robot.lumped
        self.seconds: dict[str, float] = {}
        self.logs: list[Log] = []
        self.estimates: list[EstimateRecord] = []
        self.identifications: dict[str, Identification] = {}
        self.orbit: OrbitStudy | None = None

    def do(self) -> None:
        experiment, data = self._experiment, None
        if experiment.runs():
            with self.timed("simulate"):
                self.logs.extend(simulate(experiment, threads=self._threads, track=self._track))
            with self.timed("identify"):
                data = data_set_of(experiment, self.logs, self._track)
                for spec in experiment.all_estimators:
                    self._identify(data, spec)
        if experiment.control is not None:
            with self.timed("orbit"):
                self.orbit = self._hold_orbit(experiment.control, data)
        elif not self.identifications:
            raise IdentifiabilityError(self.estimates[0].error)

    @contextmanager
    def timed(self, part: str) -> Iterator[None]:
        """Note how long a part takes."""
        begun = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[part] = time.perf_counter() - begun

    def _hold_orbit(self, control: ControlSpec, data: DataSet | None) -> OrbitStudy:
        """Hold an orbit with what is believed, or what the first estimator found in ``data``."""
        experiment, believed, zero = self._experiment, control.believed, 0.0
        small_swings = None
        if believed is None:
            assert data is not None  # noqa: S101 - the schema asks for logs then
            first = experiment.all_estimators[0]
            known = self.identifications.get(first.label)
            small_swings = known.estimate if known else judged(data, first)
            believed = small_swings.parameters
            of_mass = data.equilibria
            zero = of_mass.get(control.added_masses[0], float(np.mean(list(of_mass.values()))))
        rng = np.random.default_rng(experiment.orbit_seed)
        return study_orbit(
            partial(experiment.plant.rig.run, rng=rng),
            believed,
            zero,
            control,
            control.recalibration,
            amplitudes=control.cross_check,
            small_swings=small_swings,
            rng=rng,
            name=experiment.name,
            description=experiment.description,
            track=self._track,
        )

    def _identify(self, data: DataSet, spec: Estimator) -> None:
        """Add what an estimator gives, or why it refuses."""
        try:
            estimator = self._threaded(spec.suited(data))
            identification = identify(data, estimator, track=self._track)
        except ButterflyError as error:
            self.estimates.append(EstimateRecord(estimator=spec.label, error=str(error)))
            return
        found = identification.estimate
        self.identifications[spec.label] = identification
        held_out = np.array(list(identification.held_out.values()))
        record = EstimateRecord(
            estimator=spec.label,
            estimate=found,
            truth={
                name: float(getattr(self._truth, name))
                for name in (*found.names, *found.known.fixed)
            },
            fit=identification.fit,
            holdout=FitSummary.of(held_out) if held_out.size else None,
        )
        self.estimates.append(self._validated(record, data, spec))

    def _threaded(self, spec: Estimator) -> Estimator:
        """Return an estimator that takes no more threads than it may."""
        if self._threads is not None and isinstance(spec, OutputError) and spec.workers == 0:
            return replace(spec, workers=self._threads)
        return spec

    def _validated(self, record: EstimateRecord, data: DataSet, spec: Estimator) -> EstimateRecord:
        """Add how well logs that were left out are predicted, if that was asked for."""
        validation = self._experiment.validation
        if validation is None:
            return record
        try:
            held = cross_validate(
                data,
                self._threaded(spec),
                validation.split,
                folds=validation.folds,
                track=self._track,
            )
        except ButterflyError as error:
            return replace(record, error=f"nothing could be left out: {error}")
        return replace(record, held_out=held.summary)
