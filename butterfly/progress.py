"""How long work shares the cores, and tells how far it has come."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

_T = TypeVar("_T")
_R = TypeVar("_R")

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of a process whose matrix library computes with one thread: others have work."""

Track = Callable[[Iterable[Any], str], Iterable[Any]]
"""Shows the progress of an iteration, given a description."""


def tell(sentence: str) -> None:
    """Tell whoever waits for what: nobody."""


def untracked(items: Iterable[_T], description: str) -> Iterable[_T]:  # noqa: ARG001 - a Track
    """Show no progress."""
    return items


def in_threads(
    work: Callable[[_T], _R], items: Sequence[_T], track: Track, description: str
) -> list[_R]:
    """Return what work makes of each item, one thread per core, and track what is done."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        done = pool.map(work, items)
        return [next(done) for _ in track(items, description)]
