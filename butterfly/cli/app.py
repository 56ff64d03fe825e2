"""The table of all commands, and the program that runs them."""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
from contextlib import suppress
from typing import Annotated, NoReturn

import typer

from butterfly import __version__
from butterfly.cli.exit_codes import ExitCode
from butterfly.cli.lazy import MARKUP, Command, LazyGroup
from butterfly.errors import ButterflyError, StoppedError, UnusableError
from butterfly.sizes import memory, said

COMMANDS = {
    "run": Command(
        "run_commands",
        "run_command",
        "Simulate an experiment, identify the robot from its logs, and write a report.",
    ),
    "simulate": Command(
        "run_commands",
        "simulate_command",
        "Simulate an experiment in MuJoCo and write its logs.",
    ),
    "schema": Command(
        "run_commands",
        "schema_command",
        "Print the JSON Schema of experiment or manifest files, for editors.",
    ),
    "inspect": Command(
        "log_commands",
        "inspect_command",
        "Check logs: clock, gaps, saturation, clipping, turns, and the dominant frequency.",
    ),
    "manifest": Command(
        "log_commands",
        "manifest_command",
        "Draft a data-set manifest of the logs in a folder, to edit and keep.",
    ),
    "identify": Command(
        "identify_commands",
        "identify_command",
        "Identify the robot from a data set.",
    ),
    "validate": Command(
        "judge_commands",
        "validate_command",
        "Predict logs that the estimator has not seen, and compare with those it has.",
    ),
    "predict": Command(
        "predict_commands",
        "predict_command",
        "Predict logs, or an experiment that nobody has done, with given parameters.",
    ),
    "select": Command(
        "judge_commands",
        "select_command",
        "Choose friction terms by how well they predict what was left out: added masses, or logs.",
    ),
    "residual": Command(
        "judge_commands",
        "residual_command",
        "Show what the identified model, all its terms, leaves over of the logs.",
    ),
    "design": Command(
        "design_commands",
        "design_command",
        "Rank candidate next experiments by how much they would tell.",
    ),
    "compare": Command(
        "compare_commands",
        "compare_command",
        "Compare MuJoCo, grey-box model and logs for the same input.",
    ),
    "leaderboard": Command(
        "compare_commands",
        "leaderboard_command",
        "Rank estimators by how well they predict what they have not seen.",
    ),
    "calibrate-orbit": Command(
        "orbit_commands",
        "calibrate_orbit_command",
        "Hold a large orbit, re-calibrate the model next to it, and hold it better.",
    ),
    "reproduce": Command(
        "thesis_commands",
        "reproduce_command",
        "Print the thesis's figures beside those obtained the same way, and the right ones.",
    ),
    "view": Command(
        "view_commands",
        "view_command",
        "Watch a run in MuJoCo's viewer, in real time; `--web` needs no display.",
    ),
    "video": Command(
        "view_commands",
        "video_command",
        "Draw a run as a film; needs no display where EGL is installed.",
    ),
}

MODEL_COMMANDS = {
    "show": Command(
        "model_commands", "show_command", "Print the robot's physical and lumped parameters."
    ),
    "render": Command(
        "model_commands",
        "render_command",
        "Draw the robot; needs no display where EGL is installed.",
    ),
    "export": Command(
        "model_commands",
        "export_command",
        "Write the robot as one MJCF file that loads in plain MuJoCo and in its viewer.",
    ),
}

RESULTS_COMMANDS = {
    "list": Command(
        "results_commands",
        "list_command",
        "List the sweeps whose results lie in a folder, and how many of their runs are done.",
    ),
    "show": Command(
        "results_commands",
        "show_command",
        "Show one run: what it set, what it found, how long it took, and with which versions.",
    ),
    "table": Command("results_commands", "table_command", "Print rows of a table."),
    "export": Command(
        "results_commands", "export_command", "Write rows of a table to a CSV or Parquet file."
    ),
    "compare": Command(
        "results_commands",
        "compare_command",
        "Tell whether a robot has changed between two identifications, or compare two runs.",
    ),
    "clean": Command(
        "results_commands",
        "clean_command",
        "Remove records that the sweep no longer has, and files that were never finished.",
    ),
}


class _Commands(LazyGroup):
    table = COMMANDS


class _ModelCommands(LazyGroup):
    table = MODEL_COMMANDS


class _ResultsCommands(LazyGroup):
    table = RESULTS_COMMANDS


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=MARKUP,
    help="Simulate and identify the Butterfly robot's hand: MuJoCo, grey-box model, real logs.",
    epilog="Start with: `butterfly run quickstart`",
)
app.add_typer(
    typer.Typer(cls=_ModelCommands, no_args_is_help=True, rich_markup_mode=MARKUP),
    name="model",
    help="Show, draw or export the robot of an experiment, or the identified twin of a data set.",
)
app.add_typer(
    typer.Typer(cls=_ResultsCommands, no_args_is_help=True, rich_markup_mode=MARKUP),
    name="results",
    help="List, filter, tabulate, export, compare and clean the results of sweeps.",
)


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
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
    except OSError as error:
        _leave_stdout()
        _end(str(error), ExitCode.BAD_INPUT)


def _end(why: str, code: ExitCode) -> NoReturn:
    typer.secho(f"error: {' '.join(why.split())}", fg="red", err=True)
    sys.exit(code)


def _leave_stdout() -> None:
    """Write no more where nothing can be written, as to a full disk: the end would try again."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
