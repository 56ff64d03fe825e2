"""Options that stand for one argument of a command."""

from __future__ import annotations

import inspect
from functools import wraps
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


def option(name: str, annotation: Any, default: Any) -> inspect.Parameter:  # noqa: ANN401
    """Return an option as a command's signature has it."""
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=annotation)


def with_options(
    command: Callable[..., Any],
    argument: str,
    options: Sequence[inspect.Parameter],
    make: Callable[[dict[str, Any]], Any],
) -> Callable[..., Any]:
    """Return a command that takes options in the place of one of its arguments.

    Parameters
    ----------
    command
        All its arguments by keyword.
    argument
        The one that the options stand for.
    options
        The options.
    make
        Makes the argument of the options' values, by name.
    """

    @wraps(command)
    def wrapped(**given: Any) -> Any:  # noqa: ANN401 - whatever the command returns
        told = {each.name: given.pop(each.name) for each in options}
        return command(**given, **{argument: make(told)})

    own = list(inspect.signature(command, eval_str=True).parameters.values())
    place = [each.name for each in own].index(argument)
    parameters = [*own[:place], *options, *own[place + 1 :]]
    wrapped.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {each.name: each.annotation for each in parameters}
    return wrapped
