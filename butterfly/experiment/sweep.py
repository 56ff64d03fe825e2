"""A sweep: its runs with the addresses of their results, and performing the missing ones."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from butterfly.errors import InputError, StoppedError
from butterfly.experiment.perform import execute
from butterfly.experiment.record import OK, SCHEMA, SweepRecord, Task
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import Source, signal_digest
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep_spec import Overrides, SweepSpec, apply
from butterfly.experiment.workers import Engine
from butterfly.files import digest_of, shipped
from butterfly.progress import Track, current_search, untracked
from butterfly.result import versions
from butterfly.signals.excitations import Table
from butterfly.yaml_files import place_of

_NOT_ASKED = {"name", "description", "sweep", "report", "extends"}  # a result does not depend on it
_ASKED_OTHERWISE = {"method", "terms", "estimators", "signals"}

_PACKAGE = Path(__file__).parents[1]
_COMPUTING = (  # subpackages that a run computes with
    *("model", "plant", "signals", "logs", "identification", "thesis", "orbit", "experiment"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class SweepPlan:
    """A sweep: its base experiment, and its runs."""

    experiment: Experiment  # the one without overrides
    fields: tuple[str, ...]  # paths of those that vary
    tasks: tuple[Task, ...]  # in order
    tables: Mapping[str, Table]  # signals read from files, by their digests


def plan_sweep(source: Source, *, track: Track = untracked) -> SweepPlan:
    """List and validate the runs of an experiment file; one without ``sweep`` has one."""
    experiment = source.experiment()
    sweep = experiment.sweep
    fields = () if sweep is None else tuple(sweep.fields)
    for field in fields:
        if field.split(".")[0] in {"sweep", "extends", "name"}:
            raise InputError(source.path, f"sweep: {field}", field, "a field of the experiment")
    base = {key: value for key, value in source.content.items() if key != "sweep"}
    points: Iterable[tuple[Overrides, int, int]] = [({}, 0, experiment.seed)]
    if sweep is not None:
        points = track(sweep.points(experiment.seed, source.path), "Planning")
    tasks = []
    for number, (overrides, repetition, seed) in enumerate(points):
        content = source.with_digests(apply(base, overrides | {"seed": seed}, source.path))
        asked = _varied(source, sweep, content, overrides)
        tasks.append(
            Task(
                number=number,
                key=address(asked, content),
                overrides=overrides,
                repetition=repetition,
                seed=asked.seed,
                content=content,
            )
        )
    return SweepPlan(experiment=experiment, fields=fields, tasks=tuple(tasks), tables=source.tables)


def _varied(
    source: Source, sweep: SweepSpec | None, content: dict[str, Any], overrides: Overrides
) -> Experiment:
    """Validate the content of a run; an error in what the sweep sets names its place there."""
    try:
        return source.experiment(content)
    except InputError as error:
        for path, value in overrides.items():
            set_here = f"{error.field}.".startswith(f"{path}.")
            if sweep is not None and (set_here or f"{path}.".startswith(f"{error.field}.")):
                where = place_of(source.documents, sweep.way_to(path, value), source.path)
                raise InputError(where, error.field, error.value, error.expected) from None
        raise


def address(experiment: Experiment, content: Mapping[str, Any]) -> str:
    """Return the hash of all that a result depends on: defaults, code and versions."""
    asked = experiment.model_dump(mode="json", exclude=_NOT_ASKED | _ASKED_OTHERWISE)
    asked["estimators"] = [
        {name: value for name, value in asdict(estimator).items() if name != "workers"}
        for estimator in experiment.all_estimators  # no result depends on their number
    ]
    named = content.get("signals", [])
    asked["signals"] = [
        signal_digest(signal) or spec.model_dump(mode="json")
        for signal, spec in zip(named, experiment.signals, strict=True)
    ]
    text = json.dumps([SCHEMA, fingerprint(), versions(), asked], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


@cache
def fingerprint() -> str:
    """Return a hash over `computing_sources`, cached for the process."""
    return hash_of(computing_sources())


def computing_sources() -> dict[str, Path]:
    """Return the files that a run depends on, by name: sources and shipped robots."""
    models = shipped("models")
    sources = [path for name in _COMPUTING for path in (_PACKAGE / name).rglob("*.py")]
    return {path.relative_to(_PACKAGE).as_posix(): path for path in sources} | {
        path.relative_to(models).as_posix(): path for path in models.rglob("*.xml")
    }


def hash_of(files: dict[str, Path]) -> str:
    """Return a hash over the names and contents of files, in any order."""
    total = hashlib.sha256()
    for name, path in sorted(files.items()):
        total.update(f"{name} {digest_of(path.read_bytes())}\n".encode())
    return total.hexdigest()


@dataclass(frozen=True, kw_only=True)
class SweepSummary:
    """Numbers of runs of a sweep: in all, done now, already done, and without a result."""

    runs: int
    done: int
    reused: int
    unsuccessful: int


def run_sweep(
    plan: SweepPlan,
    folder: Path,
    engine: Engine,
    *,
    force: bool = False,
    only: str | None = None,
    track: Track = untracked,
) -> SweepSummary:
    """Perform the runs without a lasting result, and write the tables, or raise StoppedError."""
    store = ResultStore(folder)
    chosen = chosen_of(plan.tasks, only)
    unique = {task.key: task for task in chosen}
    looked = () if force else track(unique.values(), "Checking finished runs")
    records = (store.complete(task.key) for task in looked)
    statuses = {record.key: record.status for record in records if record is not None}
    pending = [task for task in unique.values() if task.key not in statuses]
    sweep = sweep_record(plan)
    store.begin_sweep(sweep)
    work = partial(execute, seconds=current_search().seconds)
    try:
        with closing(engine.run(work, pending, plan.tables)) as outcomes:
            for _, outcome in zip(track(range(len(pending)), "Running"), outcomes, strict=False):
                store.write(outcome)
                statuses[outcome.record.key] = outcome.record.status
    except KeyboardInterrupt:
        raise StoppedError(
            f"stopped: {len(statuses)} of {len(unique)} runs are done; run the same command to "
            "continue"
        ) from None
    store.end_sweep(sweep, track=track)
    return SweepSummary(
        runs=len(chosen),
        done=len(pending),
        reused=len(unique) - len(pending),
        unsuccessful=sum(statuses.get(task.key) != OK for task in chosen),
    )


def sweep_record(plan: SweepPlan) -> SweepRecord:
    """Return the record of the plan."""
    return SweepRecord(
        name=plan.experiment.name,
        description=plan.experiment.description,
        seed=plan.experiment.seed,
        worst=plan.experiment.report.worst,
        fields=plan.fields,
        versions=versions(),
        runs=plan.tasks,
    )


def chosen_of(tasks: Sequence[Task], only: str | None) -> Sequence[Task]:
    """Return the tasks of some numbers such as ``0,3,10-19``; InputError if none."""
    if only is None:
        return tasks
    numbers: set[int] = set()
    for part in only.split(","):
        first, _, last = part.partition("-")
        if not (first.isdigit() and (last or first).isdigit()):
            raise InputError("butterfly run", "--only", part, "a number or a range such as 10-19")
        numbers |= set(range(int(first), int(last or first) + 1))
    chosen = [task for task in tasks if task.number in numbers]
    if not chosen:
        raise InputError("butterfly run", "--only", only, f"numbers from 0 to {len(tasks) - 1}")
    return chosen
