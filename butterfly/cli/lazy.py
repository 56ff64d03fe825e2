"""Commands whose modules are imported when they are called, and not before.

A table tells their names and what they do, so that help and slips need no module of a command.
"""

from __future__ import annotations

import gc
import inspect
import sys
from functools import wraps
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

from butterfly.cli.help_layout import ArrangedCommand, arranged
from butterfly.cli.loudness import be_quiet

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import ModuleType

MARKUP: Any = "markdown"
"""What docstrings of commands are written in."""

QUIETLY = "Print the verdict alone, and no progress; where there is no verdict, nothing but errors."
"""What ``--quiet`` does, before a command's name or after it."""


class Command(NamedTuple):
    """Where a command is, and what it does.

    Parameters
    ----------
    module
        Of `butterfly.cli`.
    function
        Of the module.
    summary
        First line of the function's docstring.
    panel
        Heading under which help lists it; that of all commands if empty.
    """

    module: str
    function: str
    summary: str
    panel: str = ""

    def load(self) -> Callable[..., Any]:
        """Import the function."""
        function: Callable[..., Any] = getattr(_imported(self.module), self.function)
        return function


def _imported(name: str) -> ModuleType:
    """Return a module of `butterfly.cli`.

    What numpy, scipy and numba make when they are imported stays: to look through it for garbage
    again and again takes a tenth of the time until a command is done.
    """
    path = f"butterfly.cli.{name}"
    if path in sys.modules:
        return sys.modules[path]
    gc.disable()
    try:
        return import_module(path)
    finally:
        gc.freeze()
        gc.enable()


class LazyGroup(TyperGroup):
    """Commands of a ``table``; one that is only listed has no more than its name and summary."""

    table: ClassVar[Mapping[str, Command]] = {}

    def __init__(self, **settings: Any) -> None:  # noqa: ANN401 - typer's
        super().__init__(**settings)
        listed = {
            name: TyperCommand(
                name,
                help=command.summary,
                rich_markup_mode=MARKUP,
                rich_help_panel=command.panel or None,
            )
            for name, command in self.table.items()
        }
        self.commands = {**listed, **self.commands}

    def get_params(self, ctx: Any) -> list[Any]:  # noqa: ANN401 - typer's
        """Return its own options."""
        return arranged(super().get_params(ctx))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401 - typer's
        """Find the command that is called, and import it."""
        name, listed, rest = super().resolve_command(ctx, args)
        if name is None or name not in self.table:
            return name, listed, rest
        return name, _made(name, self.table[name]), rest


def _made(name: str, command: Command) -> Any:  # noqa: ANN401 - typer's
    app = typer.Typer(add_completion=False, rich_markup_mode=MARKUP)
    app.command(name, cls=ArrangedCommand)(_with_quiet(command.load()))
    return typer.main.get_command(app)


def _with_quiet(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command that takes ``--quiet`` after its name, as the program does before it."""

    @wraps(command)
    def wrapped(*, quiet: bool, **given: Any) -> Any:  # noqa: ANN401 - whatever the command returns
        if quiet:
            be_quiet()
        return command(**given)

    declared = Annotated[bool, typer.Option("--quiet", "-q", help=QUIETLY)]
    last = inspect.Parameter(
        "quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=declared
    )
    parameters = [*inspect.signature(command, eval_str=True).parameters.values(), last]
    wrapped.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {each.name: each.annotation for each in parameters}
    return wrapped
