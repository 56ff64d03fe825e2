"""Compilation with numba, with a cache that knows when it is out of date.

numba caches compiled functions on disk and recompiles one when its own file has changed. It does
not see changes in other files whose functions or numbers it uses, and would run their old code. So
the name of a cached function includes a hash of all its sources; old ones stay in `__pycache__`
until somebody deletes them.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba.core import event
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager
from numba.core.registry import CPUDispatcher
from numba.core.types import unliteral

from butterfly import progress


def compiled(function: Callable[..., Any]) -> Any:  # noqa: ANN401 - numba infers the types
    """Compile a function on its first call, to run without the global interpreter lock.

    Division by zero gives infinity or NaN, as in NumPy, not an error. From other files it may only
    use functions with one of these decorators, numbers and types, imported at the top of its file.
    """
    return _made(function)


def inner(function: Callable[..., Any], **how: Any) -> Any:  # noqa: ANN401 - numba infers the types
    """Compile a function for other compiled functions only, which is faster than `compiled`.

    Called from Python it runs as Python.
    """
    how |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "cache": False}
    made = _made(function, pipeline_class=_InnerCompiler, **how)
    if isinstance(made, CPUDispatcher):  # numba can be switched off
        made.__class__ = _Inner
    return made


def inlined(function: Callable[..., Any]) -> Any:  # noqa: ANN401 - numba infers the types
    """Compile a function into each of its callers.

    numba counts references to every array argument, which costs more than a short function itself.
    """
    return inner(function, forceinline=True)


def pasted(function: Callable[..., Any]) -> Any:  # noqa: ANN401 - numba infers the types
    """Compile a function as if its lines were in its callers: for short ones, or few callers.

    That spares a compilation of its own. In a hot loop it is slower where it takes arrays, whose
    references are counted.
    """
    return inner(function, inline="always")


@contextmanager
def compiling_beside(rehearsal: Callable[[], None]) -> Iterator[None]:
    """Compile in another process what a module's function calls; the result is cached on disk."""
    if not sys.executable or _on_disk(rehearsal):
        yield
        return
    name = rehearsal.__name__
    code = f"import gc; gc.disable(); from {rehearsal.__module__} import {name}; {name}()"
    command = [sys.executable, "-c", code]
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
    """Whether a function runs without compiling anything."""
    try:
        with event.install_listener("numba:compile", _Compiling(_refuse)):
            rehearsal()
    except _MissingError:
        return False
    return True


class _MissingError(Exception):
    """Something needs compiling."""


def _refuse() -> None:
    raise _MissingError


@lru_cache
def _announce() -> None:
    """Report once that something is compiled."""
    progress.tell("Compiling (once after installation)")


class _Compiling(event.Listener):
    """Calls a function when compiling begins; the time it takes is none of a search's."""

    def __init__(self, do: Callable[[], None]) -> None:
        self._do, self._depth, self._begun = do, 0, 0.0  # under numba's lock, so of all threads

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002 - whatever is compiled
        self._do()
        if not self._depth:
            self._begun = time.monotonic()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:  # noqa: ARG002 - whatever was compiled
        self._depth -= 1
        if not self._depth:
            progress.current_search().excuse(time.monotonic() - self._begun)


event.register("numba:compile", _Compiling(_announce))  # type: ignore[no-untyped-call]


def _made(function: Callable[..., Any], **how: Any) -> Any:  # noqa: ANN401 - numba's own
    how = {"cache": True} | how | {"nogil": True, "error_model": "numpy"}
    return numba.njit(**how)(_stamped(function))


class _InnerCompiler(CompilerBase):
    """Leaves machine code, and its cache, to the functions that an inner one is linked into."""

    def define_pipelines(self) -> list[PassManager]:
        """Return numba's own passes."""
        codegen = self.state.targetctx.codegen()
        self.state.library = _InnerLibrary(codegen, "inner")  # type: ignore[no-untyped-call]
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]  # type: ignore[no-untyped-call]


class _InnerLibrary(JITCodeLibrary):
    """Is linked into others, which optimise it with themselves, and never runs itself."""

    @property
    def codegen(self) -> _InnerLibrary:
        """What `set_env` is asked of."""
        return self

    def set_env(self, name: str, env: object) -> None:
        """Set the environment of no machine code."""

    def _optimize_final_module(self) -> None:
        """Inline only what has to be, and take out references that are counted in vain."""
        managers = self._codegen._module_pass_manager(opt=0)  # type: ignore[no-untyped-call]  # noqa: SLF001
        passes, *builder = managers if isinstance(managers, tuple) else (managers,)  # numba < 0.62
        passes.run(self._final_module, *builder)

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
        self._finalized = True


class _Inner(CPUDispatcher):
    """Has no Python wrapper, and is not recompiled for each constant argument."""

    def get_call_template(self, args: Any, kws: Any) -> Any:  # noqa: ANN401 - numba's own
        return super().get_call_template(tuple(map(unliteral, args)), kws)

    def __call__(self, *args: Any) -> Any:  # noqa: ANN401 - whatever the function takes
        return self.py_func(*args)


def _stamped(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add a hash of a function's sources to the name of its cache file."""
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
    except OSError:  # shipped without sources, so unchangeable
        content = source.encode()
    return hashlib.sha256(content).digest()
