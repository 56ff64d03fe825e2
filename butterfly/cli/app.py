"""The program: its commands, its start, and how it ends."""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
from contextlib import suppress
from typing import Annotated, Any, NoReturn

import typer

from butterfly import __version__
from butterfly.cli.command_table import (
    COMMANDS,
    LOGS_COMMANDS,
    MODEL_COMMANDS,
    RESULTS_COMMANDS,
)
from butterfly.cli.exit_codes import ExitCode
from butterfly.cli.lazy import MARKUP, QUIETLY, LazyGroup
from butterfly.cli.loudness import be_quiet, one_command, standard_output
from butterfly.cli.show_progress import tell_no_more
from butterfly.errors import ButterflyError, StoppedError, UnusableError
from butterfly.sizes import memory, said

_PANEL_OF_LOGS, _PANEL_OF_MODELS, _PANEL_OF_RESULTS = "Look at logs", "Simulate", "Results"


class _Commands(LazyGroup):
    table = COMMANDS

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 - typer's
        """Call a command; end without a word where nobody reads on, as after `| head`."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            _leave_stdout()
            raise typer.Exit(ExitCode.UNREAD) from None


class _LogsCommands(LazyGroup):
    table = LOGS_COMMANDS


class _ModelCommands(LazyGroup):
    table = MODEL_COMMANDS


class _ResultsCommands(LazyGroup):
    table = RESULTS_COMMANDS


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=MARKUP,
    help="Simulate and identify the Butterfly robot's hand: MuJoCo, grey-box model, real logs.",
    epilog="Start with: `butterfly run quickstart`",
)
app.add_typer(
    typer.Typer(cls=_LogsCommands, no_args_is_help=True, rich_markup_mode=MARKUP),
    name="logs",
    rich_help_panel=_PANEL_OF_LOGS,
    help="Fetch the thesis's public logs.",
)
app.add_typer(
    typer.Typer(cls=_ModelCommands, no_args_is_help=True, rich_markup_mode=MARKUP),
    name="model",
    rich_help_panel=_PANEL_OF_MODELS,
    help="Show, draw or export the robot of an experiment, or the identified twin of a data set.",
)
app.add_typer(
    typer.Typer(cls=_ResultsCommands, no_args_is_help=True, rich_markup_mode=MARKUP),
    name="results",
    rich_help_panel=_PANEL_OF_RESULTS,
    help="List, filter, tabulate, export, compare and clean the results of sweeps.",
)


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help=QUIETLY)] = False,
) -> None:
    if quiet:
        be_quiet()
    if version:
        typer.echo(f"butterfly {__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command line; bad input ends in one line on stderr (see `ExitCode`)."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # asked to end, as by Ctrl-C
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # what a terminal cannot show is no reason to end
    try:
        with one_command():
            app()
        sys.stdout.flush()
    except (StoppedError, KeyboardInterrupt) as stopped:
        typer.echo(str(stopped) or "stopped", err=True)
        sys.exit(ExitCode.STOPPED)
    except ButterflyError as error:
        unusable = isinstance(error, UnusableError)
        _end(str(error), ExitCode.NOT_TO_BE_USED if unusable else ExitCode.BAD_INPUT)
    except MemoryError:
        _end(f"more memory is needed than there is ({said(memory())})", ExitCode.BAD_INPUT)
    except BrokenPipeError:
        _leave_stdout()
        sys.exit(ExitCode.UNREAD)
    except OSError as error:
        _leave_stdout()
        _end(str(error), ExitCode.BAD_INPUT)
    finally:
        tell_no_more()


def _end(why: str, code: ExitCode) -> NoReturn:
    typer.secho(f"error: {' '.join(why.split())}", fg="red", err=True)
    sys.exit(code)


def _leave_stdout() -> None:
    """Write no more where nothing can be written, or nobody reads: the end would try again."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), standard_output().fileno())
