"""The estimators' own options on the command line: exactly those that each has."""

from __future__ import annotations

import inspect
import re
from dataclasses import MISSING, fields
from enum import Enum, StrEnum
from itertools import chain
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from butterfly.cli.options import parse_terms
from butterfly.cli.signature import option, with_options
from butterfly.experiment.methods import DEFAULT_METHOD, ESTIMATORS, kind_of, options_of
from butterfly.model.terms import offered

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from butterfly.identification.estimators import Estimator

_NAMES = {name.replace("-", "_").upper(): name for name in ESTIMATORS}

_FEW = 2  # methods that are named beside an option of theirs

_NAMES_BY_COMMAS = (tuple[str, ...], tuple[str, ...] | None)

Method = StrEnum("Method", _NAMES)  # type: ignore[misc]
"""Names of the estimators."""


def takes_estimator(
    default: str = DEFAULT_METHOD, *, leave_out: tuple[str, ...] = ()
) -> Callable[..., Any]:
    """Give a command ``--method`` and every estimator's options, for its argument ``estimator``.

    Parameters
    ----------
    default
        The estimator if none is named.
    leave_out
        Options that the command settles itself.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        listing = "\n".join(f"- {name}: {each.summary}." for name, each in ESTIMATORS.items())
        declared = Annotated[Method, typer.Option(help=listing)]
        method = option("method", declared, Method(default))
        chosen = [method, *_options(leave_out)]

        def make(given: dict[str, Any]) -> Estimator:
            return built(given.pop("method").value, given)

        return with_options(command, "estimator", chosen, make)

    return decorate


def built(method: str, told: dict[str, Any]) -> Estimator:
    """Make the estimator of a name with what it was told; None means its default.

    Raises
    ------
    InputError
        If it has no such option, or a value makes no sense.
    """
    given = {name: _read(value) for name, value in told.items() if value is not None}
    return kind_of(method, given, written=_written)(**given)


def _read(value: Any) -> Any:  # noqa: ANN401 - of any option
    """Turn a listing by commas into names; a choice is a text, too, and stays."""
    return parse_terms(value) if isinstance(value, str) and not isinstance(value, Enum) else value


def _options(leave_out: tuple[str, ...]) -> list[inspect.Parameter]:
    """Return a parameter for every option that some estimator has."""
    owners: dict[str, list[str]] = {}
    first: dict[str, type[Estimator]] = {}
    for method, kind in ESTIMATORS.items():
        for name in options_of(kind):
            if name not in leave_out:
                owners.setdefault(name, []).append(method)
                first.setdefault(name, kind)
    return [_option(name, kind, owners[name]) for name, kind in first.items()]


def _option(name: str, kind: type[Estimator], owners: list[str]) -> inspect.Parameter:
    annotation = get_type_hints(kind)[name]
    text = _first_sentence(described(kind)[name])
    if len(owners) <= _FEW:
        text += f" Of {' and '.join(owners)}."
    if name == "terms":
        text += f" By commas, an empty text for none: {_offers(owners)}."
    text += f" Default: {_default_text(name, owners)}."
    declared = typer.Option(help=text, show_default=False)
    wanted = str if annotation in _NAMES_BY_COMMAS else annotation
    return option(name, Annotated[wanted | None, declared], None)


def _first_sentence(text: str) -> str:
    return re.split(r"(?<=\.) ", text, maxsplit=1)[0]


def _offers(methods: Sequence[str]) -> str:
    """List the terms that methods offer, and which methods do, where not all of them."""
    told = {method: offered(method) for method in methods if offered(method)}
    groups: dict[tuple[str, ...], list[str]] = {}
    for name in dict.fromkeys(chain(*told.values())):
        groups.setdefault(tuple(each for each in told if name in told[each]), []).append(name)
    return "; ".join(
        ", ".join(names) + ("" if len(own) == len(told) else f" ({' and '.join(own)})")
        for own, names in groups.items()
    )


def _default_text(name: str, owners: list[str]) -> str:
    """Say what holds if the option is not given, where estimators differ for each."""
    defaults = {}
    for method in owners:
        (own,) = [each for each in fields(ESTIMATORS[method]) if each.name == name]
        assert own.default is not MISSING  # noqa: S101 - an estimator needs to be told nothing
        defaults[method] = _default_words(own.default)
    if len(set(defaults.values())) == 1:
        return next(iter(defaults.values()))
    return "; ".join(f"{method}: {value}" for method, value in defaults.items())


def _default_words(value: Any) -> str:  # noqa: ANN401 - of any option
    if value is None:
        return "chosen from the data"
    return ",".join(value) or "none" if isinstance(value, tuple) else str(value)


def described(kind: type[Estimator]) -> dict[str, str]:
    """Return what the docstring of an estimator says of each of its options."""
    text = inspect.cleandoc(kind.__doc__ or "")
    _, _, listing = text.partition("Parameters\n----------\n")
    parts = re.split(r"^(\w+)\n", listing, flags=re.MULTILINE)[1:]
    return {n: " ".join(t.split()) for n, t in zip(parts[::2], parts[1::2], strict=True)}


def _written(name: str) -> str:
    return f"--{name.replace('_', '-')}"
