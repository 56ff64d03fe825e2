"""How numba compiles what must be fast, so that its cache knows when it is out of date.

numba keeps compiled functions on disk, and compiles one again when its own file has changed. It
does not see that a file has changed whose functions or numbers it uses, and would run their old
code. So a function's name on disk carries a stamp of all of that; what has an earlier stamp stays
in `__pycache__` until somebody deletes it.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba.core import event
from numba.core.registry import CPUDispatcher
from numba.core.types import unliteral

from butterfly import progress


def compiled(function: Callable[..., Any]) -> Any:  # noqa: ANN401 - numba infers the types
    """Compile a function when it is first called, to run without Python's lock.

    A division by zero gives an infinity or NaN, as NumPy's does, and no error. What the function
    uses of other files must be imported at the top of its own, and be a function made by one of
    these decorators, a number, or what the types of arguments tell.
    """
    return _made(function)


def inner(function: Callable[..., Any], **how: bool) -> Any:  # noqa: ANN401 - numba infers the types
    """Compile a function as `compiled` does, for other compiled functions alone: that takes less.

    Called from Python it runs as Python.
    """
    made = _made(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, **how)
    if isinstance(made, CPUDispatcher):  # numba can be switched off
        made.__class__ = _Inner
    return made


def inlined(function: Callable[..., Any]) -> Any:  # noqa: ANN401 - numba infers the types
    """Compile a function as `inner` does, into each of its callers.

    numba counts references to every array that a call takes; for a short function that costs more
    than what it does.
    """
    return inner(function, forceinline=True)


@contextmanager
def compiling_beside(rehearsal: Callable[[], None]) -> Iterator[None]:
    """Have another process compile what a function of a module calls; in the end it is on disk."""
    if not sys.executable or _on_disk(rehearsal):
        yield
        return
    name = rehearsal.__name__
    command = [sys.executable, "-c", f"from {rehearsal.__module__} import {name}; {name}()"]
    paths = {"PYTHONPATH": os.pathsep.join(sys.path)}
    none = subprocess.DEVNULL
    with subprocess.Popen(  # noqa: S603 - our own
        command, env=os.environ | paths, stdin=none, stdout=none, stderr=none
    ) as other:
        try:
            yield
        except BaseException:
            other.kill()
            raise


def _on_disk(rehearsal: Callable[[], None]) -> bool:
    """Tell whether a function runs without compiling anything."""
    try:
        with event.install_listener("numba:compile", _Compiling(_refuse)):
            rehearsal()
    except _MissingError:
        return False
    return True


class _MissingError(Exception):
    """Something would have to be compiled."""


def _refuse() -> None:
    raise _MissingError


@lru_cache
def _announce() -> None:
    """Say once that something is compiled."""
    progress.tell("Compiling, once after an installation")


class _Compiling(event.Listener):
    """Does something as compiling begins."""

    def __init__(self, do: Callable[[], None]) -> None:
        self._do = do

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002 - whatever is compiled
        self._do()

    def on_end(self, event: event.Event) -> None:
        """Do nothing."""


event.register("numba:compile", _Compiling(_announce))  # type: ignore[no-untyped-call]


def _made(function: Callable[..., Any], **how: Any) -> Any:  # noqa: ANN401 - numba's own
    how |= {"cache": True, "nogil": True, "error_model": "numpy"}
    return numba.njit(**how)(_stamped(function))


class _Inner(CPUDispatcher):
    """Has no way in from Python, and is not compiled anew for each constant that it is given."""

    def get_call_template(self, args: Any, kws: Any) -> Any:  # noqa: ANN401 - numba's own
        return super().get_call_template(tuple(map(unliteral, args)), kws)

    def __call__(self, *args: Any) -> Any:  # noqa: ANN401 - whatever the function takes
        return self.py_func(*args)


def _stamped(function: Callable[..., Any]) -> Callable[..., Any]:
    """Put a stamp of a function's sources into the name by which numba files it."""
    stamp = hashlib.sha256(_digest(function.__code__.co_filename))
    for name, value in sorted(function.__globals__.items()):
        if isinstance(value, (int, float)):
            stamp.update(f"{name} {value!r}\n".encode())
        elif hasattr(value, "py_func"):
            stamp.update(f"{name} {value.py_func.__qualname__}\n".encode())
    stamped = FunctionType(function.__code__, function.__globals__, function.__name__)
    stamped.__doc__, stamped.__module__ = function.__doc__, function.__module__
    stamped.__qualname__ = f"{function.__qualname__}_{stamp.hexdigest()[:16]}"
    return stamped


@lru_cache
def _digest(source: str) -> bytes:
    try:
        content = Path(source).read_bytes()
    except OSError:  # shipped without sources, which nobody can change then
        content = source.encode()
    return hashlib.sha256(content).digest()
