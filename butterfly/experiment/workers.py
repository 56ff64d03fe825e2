"""Workers for the runs of a sweep: local processes, or a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from itertools import islice
from multiprocessing.context import BaseContext
from typing import Any, TypeAlias

from pebble import ProcessExpired, ProcessPool

from butterfly.errors import ButterflyError, InputError
from butterfly.experiment.record import Outcome, Task
from butterfly.progress import ONE_THREAD
from butterfly.signals.excitations import Table

Tables = Mapping[str, Table]
Work = Callable[[Task, Tables], Outcome]

_AHEAD = 4  # tasks handed out for each worker, which bounds the memory they take
_ANSWER = "20s"  # in which a scheduler has to answer
_ATTEMPTS = 3  # at a task whose worker dies, and at starting workers
_DIED = f"the worker died {_ATTEMPTS} times"
_GONE = "lost the scheduler; finished runs are kept, run the same command to continue"
_NEEDED = ["butterfly.experiment.worker_start", "butterfly.experiment.perform"]
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
