"""Threads, progress, and how much a search may do: its work is counted, seconds are a wish."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, TypeVar

_T = TypeVar("_T")
_R = TypeVar("_R")

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of a process whose matrix library uses one thread, beside other workers."""

SILENT = 10.0
"""Seconds of a phase after which the program says what it is doing."""

SIMULATIONS, STEPS = 400, 400_000_000
"""Most simulations of all logs, and steps of these, of one identification."""


@dataclass(eq=False)
class Search:
    """What a search may cost, what it has cost, and what it skipped."""

    seconds: float = math.inf  # as a user wishes
    begun: float = field(default_factory=time.monotonic)
    counted: bool = False  # whether the work is limited too
    simulations: int = 0  # of all logs, so far
    steps: int = 0  # of simulations, so far: at least one for a sample
    left_out: list[str] = field(default_factory=list)

    def excuse(self, seconds: float) -> None:
        """Let some of the time that has passed not count."""
        self.begun += seconds

    def skip(self, parts: Iterable[str]) -> None:
        """Say that some parts were skipped, each once."""
        self.left_out += [part for part in parts if part not in self.left_out]

    @property
    def exhausted(self) -> bool:
        """Whether the work is done that one identification may take, on whatever machine."""
        return self.counted and (self.simulations >= SIMULATIONS or self.steps >= STEPS)

    @property
    def over(self) -> bool:
        """Whether it is to stop."""
        return self.exhausted or time.monotonic() - self.begun > self.seconds

    @property
    def sentence(self) -> str:
        """A sentence on what was skipped; empty if nothing."""
        seconds = math.inf if self.exhausted else self.seconds
        return stopped_text(seconds, self.left_out) if self.left_out else ""


def stopped_text(seconds: float, left_out: Iterable[str]) -> str:
    """Say that a search was stopped, by a budget in s or else by its work, and what it skipped."""
    skipped = ", ".join(left_out)
    if math.isfinite(seconds):
        return (
            f"Search stopped after {seconds:g} s. Skipped: {skipped}. Drop --budget to complete it."
        )
    return (
        f"Search stopped after {SIMULATIONS} simulations of all logs, or {STEPS / 1e6:g} million "
        f"steps. Skipped: {skipped}. Use fewer --terms."
    )


_NO_SEARCH = Search()
_SEARCH: ContextVar[Search] = ContextVar("search", default=_NO_SEARCH)


def current_search() -> Search:
    """Return the present search."""
    return _SEARCH.get()


@contextmanager
def budget(seconds: float) -> Iterator[Search]:
    """Stop all searches within after so many seconds; their results say what they skipped."""
    token = _SEARCH.set(Search(seconds))
    try:
        yield _SEARCH.get()
    finally:
        _SEARCH.reset(token)


@contextmanager
def counted() -> Iterator[Search]:
    """Limit the work of one identification too; what it skips, the present search skips."""
    outer = _SEARCH.get()
    begun = outer.begun if outer is not _NO_SEARCH else time.monotonic()
    search = Search(outer.seconds, begun, counted=True)
    token = _SEARCH.set(search)
    try:
        yield search
    finally:
        _SEARCH.reset(token)
        if outer is not _NO_SEARCH:
            outer.excuse(search.begun - begun)
            outer.simulations += search.simulations
            outer.steps += search.steps
            outer.skip(search.left_out)


def out_of_time(left_out: str) -> bool:
    """Whether the search is to stop; then the result says what was skipped."""
    search = _SEARCH.get()
    if search.over:
        search.skip([left_out])
    return search.over


Track = Callable[[Iterable[Any], str], Iterable[Any]]
"""Shows the progress of an iteration, given a description."""


def tell(sentence: str) -> None:
    """Say what is being done; here it is not shown."""


_TIMERS: set[threading.Timer] = set()


@contextmanager
def phase(description: str) -> Iterator[None]:
    """Tell a waiting user what is being done, if it takes long: nothing long is silent."""
    waiting = threading.Timer(SILENT, lambda: tell(f"{description} …"))
    waiting.daemon = True
    _TIMERS.add(waiting)
    waiting.start()
    try:
        yield
    finally:
        waiting.cancel()
        _TIMERS.discard(waiting)


def end_phases() -> None:
    """Tell nothing of what is done no longer, where an error ended it."""
    while _TIMERS:
        _TIMERS.pop().cancel()


def untracked(items: Iterable[_T], description: str) -> Iterable[_T]:  # noqa: ARG001 - a Track
    """Show no progress."""
    return items


def tracked(track: Track, description: str, work: Callable[..., _R], *arguments: object) -> _R:
    """Return the result of one piece of work, with progress."""
    for _ in track([None], description):  # an error ends the loop, and what shows its progress
        result = work(*arguments)
    return result


def threads(count: int | None) -> ThreadPoolExecutor:
    """Return threads whose searches share the present budget."""
    return ThreadPoolExecutor(count, initializer=_SEARCH.set, initargs=(_SEARCH.get(),))


def in_threads(
    work: Callable[[_T], _R], items: Sequence[_T], track: Track, description: str
) -> list[_R]:
    """Return the result of work on each item, one thread per core, with progress."""
    with threads(os.cpu_count()) as pool:
        done = pool.map(work, items)
        return [next(done) for _ in track(items, description)]
