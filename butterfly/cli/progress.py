"""How far long work has come, told on standard error: results alone go to standard output."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Sized
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from butterfly.cli.output import asked

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

_T = TypeVar("_T")

EVERY = 10.0
"""Seconds between the lines that tell of work where there is no terminal."""

_telling: set[threading.Event] = set()  # by which lines that are told end


def show_progress(items: Iterable[_T], description: str) -> Iterable[_T]:
    """Show a bar on terminals, and elsewhere a plain line every `EVERY` seconds."""
    if asked.quiet:
        return items
    if not sys.stderr.isatty():
        return _told(items, description)
    from rich.console import Console  # noqa: PLC0415 - slow to import
    from rich.progress import track  # noqa: PLC0415

    console = Console(stderr=True, markup=False, emoji=False)
    return track(items, description, console=console, transient=True)


def _told(items: Iterable[_T], description: str) -> Iterator[_T]:
    done = 0
    of = f" of {len(items)}" if isinstance(items, Sized) else ""
    with _from_time_to_time(lambda: f"{description}: {done}{of} done"):
        for item in items:
            yield item
            done += 1


@contextmanager
def _from_time_to_time(line: Callable[[], str]) -> Iterator[None]:
    """Print a line every `EVERY` seconds while a block runs."""
    begin, over = time.monotonic(), threading.Event()
    _telling.add(over)

    def tell() -> None:
        while not over.wait(EVERY):
            print(f"{line()}, {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)

    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield
    finally:
        over.set()
        _telling.discard(over)


def tell_no_more() -> None:
    """End all lines: what was under way may have been left by an error."""
    while _telling:
        _telling.pop().set()
