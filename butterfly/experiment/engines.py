"""Where the runs of a sweep are done: in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TYPE_CHECKING, Any, Protocol

from butterfly.errors import ButterflyError, InputError
from butterfly.experiment.execution import FAILED, Outcome, execute

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from butterfly.experiment.plan import Task

_AHEAD = 4  # tasks handed out for each worker, which bounds the memory they take
_ATTEMPTS = 3  # at a task whose worker dies
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Engine(Protocol):
    """Does tasks, in any order."""

    def run(self, tasks: Iterable[Task]) -> Iterator[Outcome]:
        """Yield the outcome of each task as it is done."""
        ...


class LocalEngine:
    """Processes of this machine.

    Parameters
    ----------
    jobs
        How many; one per core if not given.
    """

    def __init__(self, jobs: int | None = None) -> None:
        if jobs is not None and jobs < 1:
            raise InputError("butterfly run", "--jobs", jobs, "a positive number")
        self._jobs = jobs or os.cpu_count() or 1

    def run(self, tasks: Iterable[Task]) -> Iterator[Outcome]:
        """Yield the outcome of each task as it is done; a task that kills its worker has failed."""
        pending = deque((task, 1) for task in tasks)
        while pending:
            yield from self._until_broken(pending)

    def _until_broken(self, pending: deque[tuple[Task, int]]) -> Iterator[Outcome]:
        """Work until nothing is pending, or a worker dies; what was under way is pending again."""
        context = multiprocessing.get_context("spawn")
        running: dict[Future[Outcome], tuple[Task, int]] = {}
        with _environment(_ONE_THREAD), ProcessPoolExecutor(self._jobs, context) as pool:
            while pending or running:
                while pending and len(running) < _AHEAD * self._jobs:
                    task, attempt = pending.popleft()
                    try:
                        running[pool.submit(execute, task)] = task, attempt
                    except BrokenProcessPool:
                        pending.appendleft((task, attempt))
                        if not running:
                            return
                        break
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    task, attempt = running.pop(future)
                    try:
                        yield future.result()
                    except BrokenProcessPool:
                        running[future] = task, attempt
                        yield from _set_back(running.values(), pending)
                        return


def _set_back(
    lost: Iterable[tuple[Task, int]], pending: deque[tuple[Task, int]]
) -> Iterator[Outcome]:
    """Make tasks of a dead pool pending again, but those that were tried often enough."""
    for task, attempt in lost:
        if attempt == _ATTEMPTS:
            yield Outcome(record=_died(task))
        else:
            pending.append((task, attempt + 1))


def _died(task: Task) -> dict[str, Any]:
    return {
        "key": task.key,
        "status": FAILED,
        "error": f"the worker died {_ATTEMPTS} times",
        "seed": task.content.get("seed", 0),
        "overrides": task.overrides,
        "repetition": task.repetition,
        "estimates": [],
    }


class DaskEngine:
    """A Dask cluster.

    Parameters
    ----------
    scheduler
        Its address; a cluster of processes on this machine, bound to loopback, if not given.
    jobs
        Processes of the latter; one per core if not given.
    """

    def __init__(self, scheduler: str | None = None, jobs: int | None = None) -> None:
        self._scheduler, self._jobs = scheduler, jobs or os.cpu_count() or 1

    def run(self, tasks: Iterable[Task]) -> Iterator[Outcome]:
        """Yield the outcome of each task as it is done; Dask repeats those whose worker dies.

        Raises
        ------
        ButterflyError
            If Dask is not installed, or the scheduler does not answer.
        """
        try:
            from distributed import Client, KilledWorker, LocalCluster, as_completed  # noqa: PLC0415 - an extra
        except ImportError:
            raise ButterflyError(
                "--engine dask needs the extra: pip install 'butterfly-testbed[dask]'"
            ) from None
        with _environment(_ONE_THREAD):
            if self._scheduler is None:
                target: Any = LocalCluster(
                    n_workers=self._jobs,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address=None,
                )
            else:
                target = self._scheduler
            try:
                client = Client(target, timeout="20s")
            except (OSError, ValueError) as error:
                raise InputError(
                    "butterfly run", "--scheduler", target, f"one that answers ({error})"
                ) from None
            with client:
                queue = iter(tasks)
                workers = max(len(client.scheduler_info()["workers"]), 1)
                futures = as_completed()
                known: dict[str, Task] = {}

                def hand_out() -> None:
                    task = next(queue, None)
                    if task is not None:
                        future = client.submit(execute, task, pure=False, retries=_ATTEMPTS)
                        known[future.key] = task
                        futures.add(future)

                for _ in range(_AHEAD * workers):
                    hand_out()
                for future in futures:
                    task = known.pop(future.key)
                    try:
                        outcome: Outcome = future.result()
                    except KilledWorker:
                        outcome = Outcome(record=_died(task))
                    future.release()
                    hand_out()
                    yield outcome
            if self._scheduler is None:
                target.close()


class _environment:  # noqa: N801 - used like a function
    """Set variables to 1 for processes that are started meanwhile."""

    def __init__(self, names: Iterable[str]) -> None:
        self._names = list(names)
        self._before: dict[str, str | None] = {}

    def __enter__(self) -> None:
        self._before = {name: os.environ.get(name) for name in self._names}
        os.environ.update(dict.fromkeys(self._names, "1"))

    def __exit__(self, *_: object) -> None:
        for name, value in self._before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
