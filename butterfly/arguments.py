"""Arguments of public functions: one of another kind than annotated is an InputError."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import wraps
from inspect import signature
from numbers import Integral, Real
from os import PathLike, fspath
from typing import Any, NamedTuple, ParamSpec, TypeVar

import numpy as np

from butterfly.errors import InputError

_P = ParamSpec("_P")
_R = TypeVar("_R")

_MOST = 2**63  # that a whole number of a machine holds


class _Kind(NamedTuple):
    """What an annotation accepts, and how that is said."""

    holds: Callable[[Any], bool]
    expected: str


def _is_path(value: object) -> bool:
    text = fspath(value) if isinstance(value, PathLike) else value
    return isinstance(text, str) and "\0" not in text


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_whole(value: object) -> bool:
    return (
        isinstance(value, Integral) and not isinstance(value, bool) and -_MOST < int(value) < _MOST
    )


def _list_of(holds: Callable[[Any], bool]) -> Callable[[Any], bool]:
    """Return a check that a value is a collection whose entries all pass ``holds``."""

    def of_all(value: Any) -> bool:  # noqa: ANN401 - whatever was given
        several = isinstance(value, Collection) and not isinstance(value, str | bytes)
        return several and all(holds(entry) for entry in value)

    return of_all


_PATH = _Kind(_is_path, "a path: a text or a pathlib.Path")
_TEXTS = _Kind(_list_of(lambda text: isinstance(text, str)), "a list of texts, such as ['a', 'b']")
_KINDS = {
    "Named": _PATH,
    "str | PathLike[str]": _PATH,
    "str": _Kind(lambda value: isinstance(value, str), "a text"),
    "int": _Kind(_is_whole, "a whole number"),
    "bool": _Kind(lambda value: isinstance(value, bool | np.bool_), "True or False"),
    "float | str": _Kind(lambda value: isinstance(value, str) or _is_number(value), "a number"),
    "Sequence[str]": _TEXTS,
    "Collection[str]": _TEXTS,
    "Sequence[float]": _Kind(_list_of(_is_number), "a list of numbers, such as [0, 0.1]"),
    "Track": _Kind(callable, "a function of an iterable and a description, which returns it"),
    "MountMass": _Kind(callable, "a function of an added mass"),
}
"""Annotations of arguments that are checked here; others are checked where they are used."""

_OR_NONE = " | None"


def checked(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Have a public function raise InputError, naming it and the argument, before it begins."""
    asked = signature(function)
    kinds = {
        name: _KINDS[text]
        for name, parameter in asked.parameters.items()
        if (text := str(parameter.annotation).removesuffix(_OR_NONE)) in _KINDS
    }
    absent = {n for n, p in asked.parameters.items() if str(p.annotation).endswith(_OR_NONE)}

    @wraps(function)
    def called(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        given = asked.bind(*args, **kwargs).arguments
        for name in kinds.keys() & given.keys():
            value, kind = given[name], kinds[name]
            if not (kind.holds(value) or (value is None and name in absent)):
                raise InputError(function.__name__, name, value, kind.expected)
        return function(*args, **kwargs)

    return called
