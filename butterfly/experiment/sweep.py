"""A sweep: its runs, the addresses of their results, and workers that perform missing ones."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, nullcontext
from dataclasses import asdict, dataclass
from functools import cache, partial
from itertools import islice
from multiprocessing.context import BaseContext
from pathlib import Path
from typing import Any, TypeAlias

from pebble import ProcessExpired, ProcessPool

from butterfly.errors import ButterflyError, InputError, StoppedError
from butterfly.experiment.record import OK, SCHEMA, Outcome, SweepRecord, Task
from butterfly.experiment.run import execute
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import Source, signal_digest
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep_spec import Overrides, SweepSpec, apply
from butterfly.files import digest_of, shipped
from butterfly.progress import ONE_THREAD, Track, current_search, untracked
from butterfly.result import versions
from butterfly.signals.excitations import Table
from butterfly.yaml_files import place_of

Tables = Mapping[str, Table]
Work = Callable[[Task, Tables], Outcome]

_AHEAD = 4  # tasks handed out for each worker, which bounds the memory they take
_ANSWER = "20s"  # in which a scheduler has to answer
_ATTEMPTS = 3  # at a task whose worker dies, and at starting workers
_DIED = f"the worker died {_ATTEMPTS} times"
_GONE = "lost the scheduler; finished runs are kept, run the same command to continue"
_NEEDED = ["butterfly.experiment.worker_start", "butterfly.experiment.run"]
"""Modules of the workers, imported once for all."""


class LocalEngine:
    """Local processes, by default one per core."""

    def __init__(self, jobs: int | None = None) -> None:
        self._jobs = jobs or os.cpu_count() or 1

    def run(self, work: Work, tasks: Iterable[Task], tables: Tables) -> Generator[Outcome]:
        """Yield the outcome of each task, tried thrice if its worker dies; on closing, end all."""
        pending, attempts, stuck = deque(tasks), Counter[str](), 0
        with _one_thread_each():
            while pending:
                before = len(pending)
                yield from self._pooled(work, pending, attempts, dict(tables))
                stuck = stuck + 1 if len(pending) == before else 0
                if stuck == _ATTEMPTS:
                    raise ButterflyError("the worker processes exit at start")

    def _pooled(
        self, work: Work, pending: deque[Task], attempts: Counter[str], tables: dict[str, Table]
    ) -> Generator[Outcome]:
        """Work until nothing is pending, or the pool breaks; running tasks are then pending."""
        running: dict[Future[Outcome], Task] = {}
        workers = min(self._jobs, len(pending))
        pool = ProcessPool(workers, initializer=_begin, initargs=(tables,), context=_context())
        try:
            while pending or running:
                while pending and len(running) < _AHEAD * self._jobs:
                    running[_scheduled(pool, work, pending[0])] = pending[0]
                    pending.popleft()
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    task, outcome = running[future], None
                    try:
                        outcome = future.result()
                    except ProcessExpired:
                        attempts[task.key] += 1
                        if attempts[task.key] == _ATTEMPTS:
                            outcome = task.failed(_DIED)
                    del running[future]
                    if outcome is None:
                        pending.appendleft(task)
                    else:
                        yield outcome
        except BrokenProcessPool:
            pending.extend(running.values())
        finally:
            pool.stop()  # type: ignore[no-untyped-call]
            pool.join()


def _context() -> BaseContext:
    """Return how workers start: never forked from this process, whose libraries have threads."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_NEEDED)
    return context


_tables: Tables = {}
"""Signals of a worker's tasks."""


def _begin(tables: Tables) -> None:
    """Keep the tables, and end the worker with its parent."""
    global _tables  # noqa: PLW0603 - the one thing that a worker keeps between tasks
    _tables = tables
    threading.Thread(target=_end_with_owner, daemon=True).start()


def _end_with_owner() -> None:
    """End this process when its parent has ended in any way."""
    owner = multiprocessing.parent_process()
    if owner is not None:
        owner.join()
        os._exit(1)


def _work_here(work: Work, task: Task) -> Outcome:
    return work(task, _tables)


def _scheduled(pool: ProcessPool, work: Work, task: Task) -> Future[Outcome]:
    try:
        return pool.schedule(_work_here, (work, task))
    except RuntimeError:  # as pebble says that the pool is broken
        raise BrokenProcessPool from None


class DaskEngine:
    """A Dask cluster: that of a scheduler, or ``jobs`` local processes, bound to loopback."""

    def __init__(self, scheduler: str | None = None, jobs: int | None = None) -> None:
        self._scheduler, self._jobs = scheduler, jobs or os.cpu_count() or 1

    def run(self, work: Work, tasks: Iterable[Task], tables: Tables) -> Generator[Outcome]:
        """Yield the outcome of each finished task; Dask repeats those whose worker dies."""
        try:
            from distributed import Client, LocalCluster  # noqa: PLC0415 - an extra
        except ImportError:
            remedy = "pip install 'butterfly-testbed[dask]'"
            raise ButterflyError(f"--engine dask needs the extra: {remedy}") from None
        with _one_thread_each():
            cluster: Any = nullcontext(self._scheduler)
            if self._scheduler is None:
                loopback = {"host": "127.0.0.1", "dashboard_address": None}
                cluster = LocalCluster(n_workers=self._jobs, threads_per_worker=1, **loopback)
            with cluster as target:
                try:
                    client = Client(target, timeout=_ANSWER)
                except (OSError, ValueError) as error:
                    expected = f"the address of a running scheduler ({error})"
                    raise InputError("butterfly run", "--scheduler", target, expected) from None
                with client:
                    try:
                        yield from _on_cluster(client, work, iter(tasks), tables)
                    except (CancelledError, OSError):  # of futures whose scheduler has ended
                        raise ButterflyError(_GONE) from None


def _on_cluster(
    client: Any,  # noqa: ANN401 - distributed's
    work: Work,
    tasks: Iterator[Task],
    tables: Tables,
) -> Generator[Outcome]:
    """Keep a cluster supplied for its present number of workers."""
    from distributed import KilledWorker, as_completed  # noqa: PLC0415 - an extra

    # A task of its own, not scattered data: the scheduler can have it made again.
    shared = client.submit(dict, dict(tables), pure=False)
    futures, known = as_completed(), dict[str, Task]()

    def hand_out() -> None:
        wanted = _AHEAD * max(sum(client.nthreads().values()), 1)
        for task in islice(tasks, max(wanted - len(known), 0)):
            future = client.submit(work, task, shared, pure=False, retries=_ATTEMPTS)
            known[future.key] = task
            futures.add(future)

    hand_out()
    for future in futures:
        task = known.pop(future.key)
        try:
            outcome: Outcome = future.result()
        except KilledWorker:
            outcome = task.failed(_DIED)
        future.release()
        hand_out()
        yield outcome


Engine: TypeAlias = LocalEngine | DaskEngine
"""Performs tasks, in any order."""


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Make processes started within compute with one thread."""
    before = {name: os.environ[name] for name in ONE_THREAD if name in os.environ}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name in ONE_THREAD:
            del os.environ[name]
        os.environ.update(before)


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
