"""The runs of a sweep, each with the address of its result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from butterfly.errors import InputError
from butterfly.experiment.provenance import fingerprint, versions
from butterfly.experiment.record import FAILED, SCHEMA, Outcome, PlannedRun, RunRecord
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import Source, digest_of
from butterfly.experiment.sweeps import Overrides, apply
from butterfly.identification.estimators import Estimator
from butterfly.plant.excitations import Table

_NOT_ASKED = {"name", "description", "sweep", "report", "extends"}  # a result does not depend on it
_ASKED_OTHERWISE = {"method", "terms", "estimators", "signals"}


@dataclass(frozen=True, kw_only=True)
class Task:
    """One run of a sweep: all that a worker needs but the tables, wherever it is."""

    number: int  # in the sweep's order, from 0 on
    key: str  # address of its result
    overrides: Overrides  # fields that it sets, by their paths
    repetition: int  # from 0 on
    seed: int
    content: dict[str, Any]  # the experiment without its sweep; digests stand for tables of files

    @property
    def planned(self) -> PlannedRun:
        """What the record of the sweep says of it."""
        return PlannedRun(
            number=self.number,
            key=self.key,
            repetition=self.repetition,
            seed=self.seed,
            overrides=self.overrides,
        )

    def failed(self, error: str) -> Outcome:
        """Return the outcome if nothing came back."""
        record = RunRecord(
            key=self.key,
            status=FAILED,
            error=error,
            seed=self.seed,
            overrides=self.overrides,
            repetition=self.repetition,
        )
        return Outcome(record=record)


@dataclass(frozen=True, kw_only=True, eq=False)
class SweepPlan:
    """A sweep: the experiment it starts from, and its runs."""

    experiment: Experiment  # the one without overrides
    fields: tuple[str, ...]  # paths of those that vary
    tasks: tuple[Task, ...]  # in order
    tables: Mapping[str, Table]  # signals read from files, by their digests


def plan_sweep(source: Source) -> SweepPlan:
    """List the runs of an experiment file; one without ``sweep`` has one.

    Every run is validated here, so that a slip shows before anything is simulated.
    """
    experiment = source.experiment()
    sweep = experiment.sweep
    fields = () if sweep is None else tuple(sweep.fields)
    for field in fields:
        if field.split(".")[0] in {"sweep", "extends", "name"}:
            raise InputError(source.path, f"sweep: {field}", field, "a field of the experiment")
    tasks = tuple(_tasks(source, experiment))
    return SweepPlan(experiment=experiment, fields=fields, tasks=tasks, tables=source.tables)


def _tasks(source: Source, experiment: Experiment) -> Iterator[Task]:
    base = {key: value for key, value in source.content.items() if key != "sweep"}
    points = (
        [({}, 0, experiment.seed)]
        if experiment.sweep is None
        else experiment.sweep.points(experiment.seed, source.path)
    )
    for number, (overrides, repetition, seed) in enumerate(points):
        content = source.with_digests(apply(base, overrides | {"seed": seed}, source.path))
        asked = source.experiment(content)
        yield Task(
            number=number,
            key=address(asked, content),
            overrides=overrides,
            repetition=repetition,
            seed=asked.seed,
            content=content,
        )


def address(experiment: Experiment, content: Mapping[str, Any]) -> str:
    """Return where the result of an experiment lies.

    It covers all that the result depends on: defaults, the code, and the versions it ran with.
    """
    asked = experiment.model_dump(mode="json", exclude=_NOT_ASKED | _ASKED_OTHERWISE)
    asked["estimators"] = [_options(each) for each in experiment.all_estimators]
    named = content.get("signals", [])
    asked["signals"] = [
        digest_of(signal) or spec.model_dump(mode="json")
        for signal, spec in zip(named, experiment.signals, strict=True)
    ]
    text = json.dumps([SCHEMA, fingerprint(), versions(), asked], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def _options(estimator: Estimator) -> dict[str, object]:
    """Return the options of an estimator that its result depends on."""
    return {name: value for name, value in asdict(estimator).items() if name != "workers"}
