"""The program: its commands, its start, and how it ends."""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, NamedTuple, NoReturn

from cyclopts import App, Group, Parameter
from cyclopts.exceptions import CycloptsError, UnknownCommandError, UnknownOptionError

from butterfly import __version__
from butterfly.cli.output import Asked, ExitCode, asked, write_json
from butterfly.cli.output import warn as print_warning
from butterfly.cli.progress import tell_no_more
from butterfly.errors import (
    ButterflyError,
    InputError,
    StoppedError,
    UnusableError,
    memory,
    size_text,
)


class Command(NamedTuple):
    """Where a command is, in `butterfly.cli`, what it does, and the kind of its answer."""

    path: str
    summary: str
    answer: str = ""


PANELS = {
    "Look at logs": {
        "inspect": Command(
            "logs:inspect",
            "Check logs, or tell the robot of an experiment or a saved result.",
            "inspection",
        ),
        "manifest": Command(
            "logs:manifest", "Draft a data-set manifest of the logs in a folder, to edit and keep."
        ),
        "fetch": Command(
            "logs:fetch", "Fetch the thesis's 41 public logs, 40 MB, and check each by its SHA-256."
        ),
    },
    "Identify": {
        "identify": Command(
            "estimate:identify", "Identify the robot from a data set.", "identification"
        ),
        "select": Command(
            "estimate:select",
            "Choose friction terms by how well they predict what was left out.",
            "selection",
        ),
    },
    "Judge": {
        "validate": Command(
            "estimate:validate",
            "Predict logs that an estimator has not seen; of several estimators, rank them.",
            "validation",
        ),
        "residual": Command(
            "estimate:residual",
            "Show the residuals of the identified model, and the term they look like.",
            "residual",
        ),
        "predict": Command(
            "predict:predict",
            "Predict logs, or an experiment that nobody has done, with given parameters.",
            "prediction",
        ),
        "compare": Command(
            "estimate:compare",
            "Compare MuJoCo, grey-box model and logs; or two saved results.",
            "comparison",
        ),
    },
    "Plan": {
        "design": Command(
            "estimate:design",
            "Rank candidate next experiments by how much they would tell.",
            "design",
        ),
    },
    "Experiments": {
        "run": Command(
            "experiments:run",
            "Simulate an experiment, identify the robot from its logs, and write a report.",
            "run",
        ),
        "simulate": Command(
            "experiments:simulate", "Simulate an experiment in MuJoCo and write its logs."
        ),
        "show": Command("robot:show", "Watch a run in a window or a browser, or draw it."),
        "export": Command(
            "robot:export",
            "Write the robot as one MJCF file that loads in plain MuJoCo and in its viewer.",
        ),
        "reproduce": Command(
            "thesis:reproduce",
            "Print the thesis's figures beside those obtained the same way, and the right ones.",
            "reproduction",
        ),
        "schema": Command(
            "experiments:schema",
            "Print the JSON Schema of experiment or manifest files, for editors.",
        ),
    },
}
RESULTS = {
    "list": Command(
        "results:list_sweeps",
        "List the sweeps whose results lie in a folder, and how many of their runs are done.",
        "results",
    ),
    "show": Command(
        "results:show_run",
        "Show one run: what it set, what it found, how long it took, and with which versions.",
        "run-record",
    ),
    "table": Command("results:table", "Print rows of a table, or write them.", "table"),
    "clean": Command(
        "results:clean",
        "Remove records that the sweep no longer has, and files that were never finished.",
    ),
}
COMMANDS = {name: each for panel in PANELS.values() for name, each in panel.items()}
COMMANDS |= {f"results {name}": each for name, each in RESULTS.items()}
"""All commands, by the words that call them."""

FORMER_COMMANDS = {
    "leaderboard": "validate -m METHOD,METHOD",
    "calibrate-orbit": "run",
    "view": "show",
    "video": "show --out FILM",
    "logs": "fetch",
    "logs fetch": "fetch",
    "model": "inspect, show or export",
    "model show": "inspect",
    "model render": "show --out PICTURE",
    "model export": "export",
    "results export": "results table --out FILE",
    "results compare": "compare",
}
FORMER_OPTIONS = {
    "--count": "--limit",
    "--logs": "--log",
    "--mass": "--hand-mass",
    "--methods": "--method",
}
FORMER_OPTIONS_OF_COMPARE = dict.fromkeys(
    ("--against", "--other-results"), "RESULTS/RUN in place of a run's number"
)
_DATA = ("root", "arm", "input", "intersample", "columns", "units", "repair", "known", "zero")
OF_DATA = {f"--{name}" for name in (*_DATA, "joint", "gravity", "from", "to", "restarts")}
"""Options that only commands take that read data of which no manifest tells."""

_EVERYWHERE = Group("Any command", sort_key=9)


def program(called: Sequence[str] = ()) -> App:
    """Return the program; of the command that is called, its docstring tells all in its help."""
    words = [word for word in called if not word.startswith("-")]
    plain = Parameter(negative=(), show_default=_worth_showing)
    app = App(
        name="butterfly",
        version=f"butterfly {__version__}",
        help="Simulate and identify the Butterfly robot's hand: MuJoCo, grey-box model, real logs.",
        help_format="markdown",
        help_epilogue="Start with: butterfly run quickstart" if not words else "",
        default_parameter=plain,
        group_commands=_EVERYWHERE,
        group_parameters=Group("Options", sort_key=1),
        print_error=False,
        exit_on_error=False,
        suppress_keyboard_interrupt=False,
        result_action="return_value",
    )
    results = App(name="results", help="List, show, tabulate and clean the results of sweeps.")
    results.group = Group("Results", sort_key=8)
    results.group_commands = Group("Commands", sort_key=0)
    for number, (panel, commands) in enumerate(PANELS.items()):
        group = Group(panel, sort_key=number)
        for name, command in commands.items():
            _add(app, name, command, called=words[:1] == [name], group=group)
    for name, command in RESULTS.items():
        _add(results, name, command, called=words[:2] == ["results", name])
    app.command(results)
    app.register_install_completion_command(help="Have the shell complete commands and options.")
    app.meta.default(_launch(app))
    return app


def _worth_showing(default: object) -> str | None:
    """Return a default as help shows it: switches and empty lists have none."""
    return None if default is None or isinstance(default, bool | tuple) else str(default)


def _add(
    app: App, name: str, command: Command, *, called: bool, group: Group | None = None
) -> None:
    """Add a command whose module is imported when it is called, and not before."""
    path = f"butterfly.cli.{command.path}"
    app.command(path, name=name, group=group, help=None if called else command.summary)


def _launch(app: App) -> Callable[..., ExitCode | None]:
    def launch(
        *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
        quiet: Annotated[bool, Parameter(name=("--quiet", "-q"), group=_EVERYWHERE)] = False,
        json: Annotated[
            Path | None,
            Parameter(metavar="FILE", group=_EVERYWHERE, allow_leading_hyphen=True),
        ] = None,
        help_all: Annotated[bool, Parameter(group=_EVERYWHERE)] = False,
    ) -> ExitCode | None:
        """Call a command.

        Parameters
        ----------
        quiet
            Print the verdict alone, if there is one, and no progress.
        json
            Write the answer as JSON to this file; - prints it alone.
        help_all
            Show all options of a command.
        """
        if help_all:
            tokens = (*tokens, "--help")
        name = _name_of(tokens)
        if json is not None and not (name in COMMANDS and COMMANDS[name].answer):
            raise InputError("butterfly", "--json", name, "a command that has an answer")
        asked.quiet, asked.json = quiet, json
        try:
            with _gathering_nothing():
                command, bound, _ = app.parse_args(tokens)
            ended: ExitCode | None = command(*bound.args, **bound.kwargs)
        except UnusableError as refused:
            _write_refusal(COMMANDS[name].answer, refused.reasons)
            raise
        return ended

    return launch


def _name_of(tokens: Sequence[str]) -> str:
    """Return the words that call a command."""
    words = [token for token in tokens if not token.startswith("-")]
    return " ".join(words[: 2 if words[:1] == ["results"] else 1])


@contextmanager
def _gathering_nothing() -> Iterator[None]:
    """Import the command without looking through what stays, again and again, for garbage."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def main() -> None:
    """Run the command line; bad input ends in one line on stderr (see `ExitCode`)."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # asked to end, as by Ctrl-C
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # what a terminal cannot show is no reason to end
    tokens = sys.argv[1:]
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            _refuse_former(tokens)
            ended = program(tokens).meta(tokens)
        sys.stdout.flush()
        sys.exit(ended or ExitCode.DONE)
    except (StoppedError, KeyboardInterrupt) as stopped:
        print(str(stopped) or "stopped", file=sys.stderr)
        sys.exit(ExitCode.STOPPED)
    except CycloptsError as error:
        _end(_said(error, tokens), ExitCode.BAD_INPUT)
    except ButterflyError as error:
        unusable = isinstance(error, UnusableError)
        _end(str(error), ExitCode.NOT_TO_BE_USED if unusable else ExitCode.BAD_INPUT)
    except MemoryError:
        _end(f"more memory is needed than there is ({size_text(memory())})", ExitCode.BAD_INPUT)
    except BrokenPipeError:
        _leave_stdout()
        sys.exit(ExitCode.UNREAD)
    except OSError as error:
        _leave_stdout()
        _end(str(error), ExitCode.BAD_INPUT)
    finally:
        asked.__dict__.update(vars(Asked()))
        tell_no_more()


def _refuse_former(tokens: Sequence[str]) -> None:
    """Raise InputError, naming the present one, if a command is called by a former name."""
    words = [token for token in tokens if not token.startswith("-")]
    for count in (2, 1):
        name = " ".join(words[:count])
        if name in FORMER_COMMANDS:
            raise InputError("butterfly", name, "its former name", FORMER_COMMANDS[name])


def _said(error: CycloptsError, tokens: Sequence[str]) -> str:
    """Say in one line what is wrong with what was typed."""
    if isinstance(error, UnknownOptionError):
        option = (error.token.keyword or error.token.value).partition("=")[0]
        name = _name_of(tokens)
        if option in OF_DATA:
            expected = "it said to `butterfly manifest` or `butterfly identify --save`, and "
            expected += "what they write in place of the data"
            return str(InputError(f"butterfly {name}", option, "an option of data", expected))
        former = FORMER_OPTIONS | (FORMER_OPTIONS_OF_COMPARE if name == "compare" else {})
        if option in former:
            return str(InputError("butterfly", option, "its former name", former[option]))
    if isinstance(error, UnknownCommandError) and error.unused_tokens:
        # its own message lists all commands after the one that is meant
        return str(error).partition(" Available commands")[0]
    return str(error)


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print_warning(str(message))


def _write_refusal(kind: str, reasons: tuple[str, ...]) -> None:
    """Write the verdict on values that no joint has, as the answer."""
    from butterfly.result import document  # noqa: PLC0415 - slow to import
    from butterfly.verdict import Level, Verdict  # noqa: PLC0415

    verdict = Verdict(Level.WARNING, reasons)
    title = "Nothing is made of values that no joint has"
    write_json(document(kind, title, {}, verdict=verdict, summary=(verdict.sentence,)))


def _end(why: str, code: ExitCode) -> NoReturn:
    red, plain = ("\033[31m", "\033[0m") if sys.stderr.isatty() else ("", "")
    print(f"{red}error: {' '.join(why.split())}{plain}", file=sys.stderr)
    sys.exit(code)


def _leave_stdout() -> None:
    """Write no more where nothing can be written, or nobody reads: the end would try again."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
