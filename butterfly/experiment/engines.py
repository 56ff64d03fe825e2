"""Where the runs of a sweep are done: in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext, suppress
from itertools import islice
from typing import TYPE_CHECKING, Any, Protocol

from butterfly.errors import ButterflyError, InputError
from butterfly.experiment.execution import FAILED, Outcome, execute

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Iterator

    from butterfly.experiment.plan import Task

_AHEAD = 4  # tasks handed out for each worker, which bounds the memory they take
_ATTEMPTS = 3  # at a task whose worker dies
_CONTEXT = multiprocessing.get_context("spawn")  # simulators and compilers have threads
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
        pending = deque(tasks)
        with _environment(_ONE_THREAD):
            while pending:
                lost = yield from self._together(pending)
                for task in lost:
                    yield _alone(task)

    def _together(self, pending: deque[Task]) -> Generator[Outcome, None, list[Task]]:
        """Work until nothing is pending, or a worker dies; return what was then under way."""
        running: dict[Future[Outcome], Task] = {}
        with ProcessPoolExecutor(self._jobs, _CONTEXT) as pool:
            while pending or running:
                try:
                    while pending and len(running) < _AHEAD * self._jobs:
                        running[pool.submit(execute, pending[0])] = pending[0]
                        pending.popleft()
                    done, _ = wait(running, return_when=FIRST_COMPLETED)
                    outcomes = [(future, future.result()) for future in done]
                except BrokenProcessPool:
                    return list(running.values())
                for future, outcome in outcomes:
                    del running[future]
                    yield outcome
        return []


def _alone(task: Task) -> Outcome:
    """Do a task in a process of its own, a few times if that dies."""
    for _ in range(_ATTEMPTS):
        with suppress(BrokenProcessPool), ProcessPoolExecutor(1, _CONTEXT) as pool:
            return pool.submit(execute, task).result()
    return Outcome(record=_died(task))


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
            cluster: Any = nullcontext(self._scheduler)
            if self._scheduler is None:
                loopback = {"host": "127.0.0.1", "dashboard_address": None}
                cluster = LocalCluster(n_workers=self._jobs, threads_per_worker=1, **loopback)
            with cluster as target:
                try:
                    client = Client(target, timeout="20s")
                except (OSError, ValueError) as error:
                    expected = f"one that answers ({error})"
                    raise InputError("butterfly run", "--scheduler", target, expected) from None
                with client:
                    yield from _on_cluster(client, as_completed(), iter(tasks), KilledWorker)


def _on_cluster(
    client: Any,  # noqa: ANN401 - distributed's
    futures: Any,  # noqa: ANN401
    tasks: Iterator[Task],
    killed: type[Exception],
) -> Iterator[Outcome]:
    """Keep a cluster supplied, however many workers it has at the moment."""
    known: dict[str, Task] = {}

    def hand_out() -> None:
        wanted = _AHEAD * max(sum(client.nthreads().values()), 1) - len(known)
        for task in islice(tasks, max(wanted, 0)):
            future = client.submit(execute, task, pure=False, retries=_ATTEMPTS)
            known[future.key] = task
            futures.add(future)

    hand_out()
    for future in futures:
        task = known.pop(future.key)
        try:
            outcome: Outcome = future.result()
        except killed:
            outcome = Outcome(record=_died(task))
        future.release()
        hand_out()
        yield outcome


@contextmanager
def _environment(names: Iterable[str]) -> Iterator[None]:
    """Set variables to 1 for processes that are started meanwhile."""
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(before, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
