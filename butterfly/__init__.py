"""Simulate, identify and control the first degree of freedom of the Butterfly robot.

`import butterfly as bf`; then `bf.read`, `bf.identify`, `bf.simulate`, `bf.validate`, `bf.design`,
`bf.compare`, `bf.predict`, `bf.draws`, `bf.changed` and `bf.load` do what their names say. What is
used is loaded when it is used.
"""

import importlib
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

import lazy_loader

__version__ = "0.2.0"

_ROOMS = ("compare", "identify")  # packages that bear the name of a verb

_attached, _listed, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever is asked for
    if name in _ROOMS:
        return importlib.import_module(f"{__name__}.{name}")
    return _attached(name)


def __dir__() -> list[str]:
    return sorted({*_listed(), *_ROOMS, "__version__"})


class _Room(ModuleType):
    """A package that does, when called, what its name says."""

    @property
    def _verb(self) -> Callable[..., Any]:
        verbs = importlib.import_module("butterfly.api.verbs")
        verb: Callable[..., Any] = getattr(verbs, self.__name__.rpartition(".")[2])
        return verb

    @property
    def __signature__(self) -> Any:  # noqa: ANN401 - an inspect.Signature, which is slow to import
        return importlib.import_module("inspect").signature(self._verb)

    def __call__(self, *arguments: Any, **options: Any) -> Any:  # noqa: ANN401 - of any verb
        return self._verb(*arguments, **options)


class _Face(ModuleType):
    """The package as users see it: `identify` is a package of it, and a verb."""

    def __setattr__(self, name: str, value: Any) -> None:  # noqa: ANN401 - whatever is set
        if name in _ROOMS and isinstance(value, ModuleType):
            value.__class__ = _Room
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Face
