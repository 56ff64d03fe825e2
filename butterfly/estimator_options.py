"""The estimators' own options on the command line: exactly those that each has."""

from __future__ import annotations

import inspect
import re
from dataclasses import MISSING, fields
from enum import Enum, StrEnum
from functools import wraps
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from butterfly.arguments import parse_terms
from butterfly.errors import InputError, nearest
from butterfly.experiment.methods import DEFAULT_METHOD, ESTIMATORS
from butterfly.model.terms import offered

if TYPE_CHECKING:
    from collections.abc import Callable
    from dataclasses import Field

    from butterfly.identify.estimators import Estimator

_NAMES = {name.replace("-", "_").upper(): name for name in ESTIMATORS}

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
        options = _options(leave_out)

        @wraps(command)
        def wrapped(**given: Any) -> Any:  # noqa: ANN401 - whatever the command returns
            told = {name: given.pop(name) for name in options}
            return command(estimator=built(given.pop("method").value, told), **given)

        own = inspect.signature(command, eval_str=True).parameters
        listing = " ".join(f"{name}: {each.summary}." for name, each in ESTIMATORS.items())
        method = _parameter("method", Method, typer.Option(help=listing), Method(default))
        chosen = [method, *options.values()]
        added = [p for name, p in own.items() if name != "estimator"]
        place = sum(p.default is inspect.Parameter.empty for p in added)
        parameters = [*added[:place], *chosen, *added[place:]]
        wrapped.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        wrapped.__annotations__ = {p.name: p.annotation for p in parameters}
        return wrapped

    return decorate


def built(method: str, told: dict[str, Any]) -> Estimator:
    """Make the estimator of a name with what it was told; None means its default.

    Raises
    ------
    InputError
        If it has no such option, or a value makes no sense.
    """
    kind = ESTIMATORS[method]
    own = {each.name for each in _own_fields(kind)}
    given = {name: value for name, value in told.items() if value is not None}
    for name in given:
        if name not in own:
            expected = nearest(name, sorted(own)) if own else "no option"
            raise InputError(
                f"--method {method}", f"--{_dashed(name)}", "an option it has not", expected
            )
    return kind(**{name: _read(value) for name, value in given.items()})


def _read(value: Any) -> Any:  # noqa: ANN401 - of any option
    """Turn a listing by commas into names; a choice is a text, too, and stays."""
    return parse_terms(value) if isinstance(value, str) and not isinstance(value, Enum) else value


def _own_fields(kind: type[Estimator]) -> list[Field[Any]]:
    return [each for each in fields(kind) if each.name != "method"]


def _options(leave_out: tuple[str, ...]) -> dict[str, inspect.Parameter]:
    """Return a parameter for every option that some estimator has, by its name."""
    owners: dict[str, list[str]] = {}
    first: dict[str, type[Estimator]] = {}
    for method, kind in ESTIMATORS.items():
        for each in _own_fields(kind):
            if each.name not in leave_out:
                owners.setdefault(each.name, []).append(method)
                first.setdefault(each.name, kind)
    return {name: _option(name, kind, owners[name]) for name, kind in first.items()}


def _option(name: str, kind: type[Estimator], owners: list[str]) -> inspect.Parameter:
    annotation = get_type_hints(kind)[name]
    text = f"{described(kind)[name]} Of {', '.join(owners)}."
    if name == "terms":
        valid = "; ".join(f"{method}: {', '.join(offered(method))}" for method in owners)
        text += f" Separated by commas, an empty text means none; {valid}."
    declared = typer.Option(help=text, show_default=_default_text(name, owners))
    wanted = str if annotation == tuple[str, ...] else annotation
    return _parameter(name, wanted | None, declared, None)


def _parameter(name: str, annotation: Any, declared: Any, default: Any) -> inspect.Parameter:  # noqa: ANN401
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(
        name, kind, default=default, annotation=Annotated[annotation, declared]
    )


def _default_text(name: str, owners: list[str]) -> str:
    """Say what holds if the option is not given, where estimators differ for each."""
    defaults = {}
    for method in owners:
        (own,) = [each for each in fields(ESTIMATORS[method]) if each.name == name]
        assert own.default is not MISSING  # noqa: S101 - an estimator needs to be told nothing
        value = own.default
        defaults[method] = ",".join(value) or "none" if isinstance(value, tuple) else str(value)
    if len(set(defaults.values())) == 1:
        return next(iter(defaults.values()))
    return "; ".join(f"{method}: {value}" for method, value in defaults.items())


def described(kind: type[Estimator]) -> dict[str, str]:
    """Return what the docstring of an estimator says of each of its options."""
    text = inspect.cleandoc(kind.__doc__ or "")
    _, _, listing = text.partition("Parameters\n----------\n")
    parts = re.split(r"^(\w+)\n", listing, flags=re.MULTILINE)[1:]
    return {n: " ".join(t.split()) for n, t in zip(parts[::2], parts[1::2], strict=True)}


def _dashed(name: str) -> str:
    return name.replace("_", "-")
