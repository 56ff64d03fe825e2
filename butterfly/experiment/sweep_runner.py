"""Run a sweep: what is not done yet, on an engine, into a store."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from butterfly.errors import InputError, StoppedError
from butterfly.experiment.perform import execute
from butterfly.experiment.plan import SweepPlan, Task
from butterfly.experiment.provenance import versions
from butterfly.experiment.record import FAILED, OK, SweepRecord
from butterfly.experiment.store import ResultStore
from butterfly.experiment.workers import Engine
from butterfly.progress import Track, untracked


@dataclass(frozen=True, kw_only=True)
class SweepSummary:
    """How a sweep went: numbers of runs in all, done now, found done, and without a result."""

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
    """Do the runs of a sweep that have no result yet, and write the tables.

    Killed at any moment, it goes on where it stopped. A run that was refused (bad input, not
    identifiable) would be refused again and is left; one that failed unexpectedly is tried again.
    Interrupted, it raises StoppedError.
    """
    store = ResultStore(folder)
    chosen = chosen_of(plan.tasks, only)
    unique = {task.key: task for task in chosen}
    kept = {} if force else {task.key: kept_status(store, task) for task in unique.values()}
    statuses = {key: status for key, status in kept.items() if status is not None}
    pending = [task for task in unique.values() if task.key not in statuses]
    sweep = sweep_record(plan)
    store.begin_sweep(sweep)
    try:
        with closing(engine.run(execute, pending, plan.tables)) as outcomes:
            for _, outcome in zip(track(range(len(pending)), "Running"), outcomes, strict=False):
                store.write(outcome)
                statuses[outcome.record.key] = outcome.record.status
    except KeyboardInterrupt:
        raise StoppedError(
            f"stopped: {len(statuses)} of {len(unique)} runs are done; the same command goes on "
            "with the others"
        ) from None
    store.end_sweep(sweep)
    return SweepSummary(
        runs=len(chosen),
        done=len(pending),
        reused=len(unique) - len(pending),
        unsuccessful=sum(statuses.get(task.key) != OK for task in chosen),
    )


def sweep_record(plan: SweepPlan) -> SweepRecord:
    """Return the record of what is asked."""
    return SweepRecord(
        name=plan.experiment.name,
        description=plan.experiment.description,
        seed=plan.experiment.seed,
        worst=plan.experiment.report.worst,
        fields=plan.fields,
        versions=versions(),
        runs=tuple(task.planned for task in plan.tasks),
    )


def kept_status(store: ResultStore, task: Task) -> str | None:
    """Return the status of a result that stays; None if the task is to be done.

    It is if it has no result, failed unexpectedly, or lacks logs that were kept.
    """
    record = store.read(task.key)
    if record is None or record.status == FAILED or not store.holds(record):
        return None
    return record.status


def chosen_of(tasks: Sequence[Task], only: str | None) -> Sequence[Task]:
    """Return the tasks whose numbers are named, as ``0,3,10-19``; InputError if none is."""
    if only is None:
        return tasks
    numbers: set[int] = set()
    for part in only.split(","):
        first, _, last = part.partition("-")
        if not (first.isdigit() and (last or first).isdigit()):
            raise InputError("butterfly run", "--only", part, "a number, or two as 10-19")
        numbers |= set(range(int(first), int(last or first) + 1))
    chosen = [task for task in tasks if task.number in numbers]
    if not chosen:
        raise InputError("butterfly run", "--only", only, f"numbers from 0 to {len(tasks) - 1}")
    return chosen
