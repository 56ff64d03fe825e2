"""The program: its commands, its start, and how it ends."""

from __future__ import annotations

import gc
import io
import math
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from inspect import BoundArguments
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, NamedTuple, NoReturn, TypeAlias

from cyclopts import App, Group, Parameter
from cyclopts.exceptions import CycloptsError, UnknownCommandError, UnknownOptionError

from butterfly import __version__, outputs, progress
from butterfly.cli import output
from butterfly.cli.command_texts import DESCRIPTIONS, SUMMARIES
from butterfly.cli.output import ExitCode, OutputOptions, asked, put, write_json
from butterfly.cli.output import check as check_outputs
from butterfly.cli.output import warn as print_warning
from butterfly.errors import (
    ButterflyError,
    InputError,
    StoppedError,
    UnusableError,
    memory,
    size_text,
    visible,
)

Function: TypeAlias = Callable[..., ExitCode | None]


def _verbs() -> dict[str, Function]:
    """Import the verbs' commands."""
    from butterfly.cli import verbs  # noqa: PLC0415 - when one is called

    return {
        "inspect": verbs.inspect,
        "identify": verbs.identify,
        "select": verbs.select,
        "design": verbs.design,
        "validate": verbs.validate,
        "residual": verbs.residual,
        "predict": verbs.predict,
        "compare": verbs.compare,
        "run": verbs.run,
        "simulate": verbs.simulate,
        "campaign": verbs.campaign,
    }


def _beside_verbs() -> dict[str, Function]:
    """Import commands beside the verbs."""
    from butterfly.cli import commands  # noqa: PLC0415 - when one is called

    return {
        "manifest": commands.manifest,
        "fetch": commands.fetch,
        "schema": commands.schema,
        "reproduce": commands.reproduce,
        "report": commands.report,
        "export": commands.export,
        "show": commands.show,
    }


def _library() -> dict[str, Function]:
    """Import commands of the library of motors."""
    from butterfly.cli import library  # noqa: PLC0415 - when one is called

    return {
        "library list": library.list_motors,
        "library show": library.show_motor,
        "library draft": library.draft_motor,
    }


def _results() -> dict[str, Function]:
    """Import commands of results."""
    from butterfly.cli import results  # noqa: PLC0415 - when one is called

    return {
        "results clean": results.clean,
    }


class Command(NamedTuple):
    """The group that lists it in the help, what imports its function, its kinds of answer."""

    panel: str
    functions: Callable[[], dict[str, Function]]
    answer: str = ""
    also: tuple[str, ...] = ()  # kinds of other answers


COMMANDS = {
    "inspect": Command("Logs", _verbs, "inspection", ("model", "results", "run", "sweep")),
    "manifest": Command("Logs", _beside_verbs),
    "fetch": Command("Logs", _beside_verbs),
    "identify": Command("Identify", _verbs, "identification"),
    "select": Command("Identify", _verbs, "selection"),
    "design": Command("Identify", _verbs, "design"),
    "validate": Command("Check a result", _verbs, "validation", ("leaderboard",)),
    "residual": Command("Check a result", _verbs, "residual"),
    "predict": Command("Check a result", _verbs, "prediction"),
    "compare": Command("Check a result", _verbs, "comparison", ("change", "runs")),
    "export": Command("Use a result", _beside_verbs),
    "show": Command("Use a result", _beside_verbs),
    "run": Command("Simulated experiments", _verbs, "run", ("sweep",)),
    "simulate": Command("Simulated experiments", _verbs),
    "campaign": Command("Use a robot", _verbs, "campaign"),
    "schema": Command("Simulated experiments", _beside_verbs),
    "reproduce": Command("Simulated experiments", _beside_verbs, "reproduction"),
    "report": Command("If it fails", _beside_verbs),
    "library list": Command("Commands", _library, "motors"),
    "library show": Command("Commands", _library, "motor"),
    "library draft": Command("Commands", _library),
    "results clean": Command("Commands", _results),
}
"""All commands, by the words that call them, in the order of help."""

GROUPS = {
    "library": (
        "Motors",
        "Motors that others measured, whose values can be known values of yours.",
    ),
    "results": ("Results", "Clean up the results of sweeps."),
}
"""Commands that have commands of their own: the panel that lists each, and its help."""

EXAMPLES = {
    "inspect": "butterfly inspect logs/ --units time=ms; "
    "butterfly inspect Data_52__8__002.mat --report log.html; "
    "butterfly inspect results; butterfly inspect results/large-sweep/0",
    "manifest": "butterfly manifest logs --units time=ms,angle=deg",
    "identify": "butterfly identify real-logs --report report.html --save result.json; "
    "butterfly identify arm.csv --model arm.xml --of elbow",
    "select": "butterfly select real-logs --candidates drag,stribeck",
    "design": "butterfly design result.json --goal 0.5% --swing 0.5",
    "validate": "butterfly validate real-logs --split mass; "
    "butterfly validate real-logs --method harmonic-balance,output-error",
    "residual": "butterfly residual result.json --log 2 --report residual.html",
    "predict": "butterfly predict new-logs --with result.json --bands --report prediction.html; "
    "butterfly predict results/quickstart --with p1=0.0033,p2=0.0014,p3=0.05",
    "compare": "butterfly compare spring.json autumn.json; "
    "butterfly compare real-logs --report compare.html; "
    "butterfly compare results/large-sweep/0 results/large-sweep/1",
    "export": "butterfly export result.json --out twin.xml --timestep 0.002; "
    "butterfly export servo.json --to bam --out servo-bam.json",
    "show": "butterfly show quickstart --web; "
    "butterfly show quickstart --run 5 --out hand.mp4; "
    "butterfly show result.json --added-mass 0.05 --out hand.png; "
    "butterfly show result.json --log 3 --out log.gif",
    "run": "butterfly run experiments/quickstart.yaml",
    "simulate": "butterfly simulate quickstart --out logs",
    "campaign": "butterfly campaign quickstart --out campaign; "
    "butterfly campaign my_robot:motor --command 6 --masses 0,0.1 --arm 0.1 --out campaign",
    "schema": "butterfly schema experiment --out experiment.schema.json",
    "reproduce": "butterfly reproduce thesis --out figures",
    "report": "butterfly report logs --with result.json --bundle report.zip",
    "library show": "butterfly library show xl330",
    "library draft": "butterfly library draft servo.json --out my-servo.yaml",
    "results clean": "butterfly results clean results/large-sweep --failed",
}
"""Calls that help shows last, by command."""

_DATA = "root arm input intersample columns units repair known zero joint gravity interval from to"
OF_DATA = {f"--{name}" for name in (*_DATA.split(), "restarts")}
"""Options of the commands that read logs without a manifest."""

_MOVED = {
    "results list": "butterfly inspect FOLDER",
    "results show": "butterfly inspect FOLDER/NUMBER",
    "results table": "butterfly inspect FOLDER; all rows are in its runs.parquet and "
    "estimates.parquet",
}
"""Former commands, and what does the same."""

_SEARCHING = {"Identify", "Check a result"}
"""Groups of the commands that search, for as long as --budget says."""

_EVERYWHERE = Group("Any command", sort_key=9)


def program(tokens: Sequence[str] | None = None) -> App:
    """Return the program, of which only the called command has its options; all without a call."""
    call = _name_of(tokens or ())
    whole = tokens is None or "--install-completion" in tokens
    app = App(
        **_HOW,
        version=f"butterfly {__version__}",
        help="Identify and simulate a motor-driven joint from its logs.",
        help_format="markdown",
        help_epilogue="Start: butterfly run quickstart. Help: butterfly COMMAND --help."
        * (not call),
        group_commands=_EVERYWHERE,
        group_parameters=Group("Options", sort_key=1),
    )
    parts = {}
    for number, (name, (panel, about)) in enumerate(GROUPS.items()):
        parts[name] = App(name=name, help=about)
        parts[name].group = Group(panel, sort_key=7 + number)
        app.command(parts[name])  # its commands have the names of groups of `app`
    panels = dict.fromkeys(command.panel for command in COMMANDS.values())
    groups = {panel: Group(panel, sort_key=number) for number, panel in enumerate(panels)}
    for words, command in COMMANDS.items():
        part, _, name = words.rpartition(" ")
        called = words == call
        parts.get(part, app).command(
            command.functions()[words] if called or whole else _not_called,
            name=name,
            group=groups[command.panel],
            help=DESCRIPTIONS.get(words) if called else SUMMARIES[words],
            help_epilogue=f"For example: {EXAMPLES[words]}" if words in EXAMPLES else None,
        )
    app.register_install_completion_command(help="Install shell completion.")
    app.meta.default(launch)
    return app


def _not_called() -> None:
    """Stand for a command that is listed and not called."""


_NO_COMMAND = Command("", dict)


def _worth_showing(default: object) -> str | None:
    """Return a default as help shows it: switches and empty lists have none."""
    return None if default is None or isinstance(default, bool | tuple) else str(default)


_HOW: dict[str, Any] = {"name": "butterfly", "result_action": "return_value"}
_HOW |= dict.fromkeys(("print_error", "exit_on_error", "suppress_keyboard_interrupt"), False)
_HOW["default_parameter"] = Parameter(negative=(), show_default=_worth_showing)


def launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    quiet: Annotated[bool, Parameter(name=("--quiet", "-q"), group=_EVERYWHERE)] = False,
    verbose: Annotated[bool, Parameter(name=("--verbose", "-v"), group=_EVERYWHERE)] = False,
    json: Annotated[
        Path | None, Parameter(metavar="FILE", group=_EVERYWHERE, allow_leading_hyphen=True)
    ] = None,
    budget: Annotated[
        float | None, Parameter(metavar="s", group=_EVERYWHERE, allow_leading_hyphen=True)
    ] = None,
    overwrite: Annotated[bool, Parameter(group=_EVERYWHERE)] = False,
    help_all: Annotated[bool, Parameter(group=_EVERYWHERE)] = False,
) -> ExitCode | None:
    """Call a command.

    Parameters
    ----------
    quiet
        Print only the verdict, and no progress.
    verbose
        Print all findings, not only the three gravest.
    json
        Write the answer as JSON to this file; - prints only the JSON.
    budget
        Time limit of the search. Default: none.
    overwrite
        Replace existing files (CSV, C, films, logs, manifests).
    help_all
        Show all options of a command, including the rare ones.
    """
    if help_all:
        tokens = (*tokens, "--help")
    name = _name_of(tokens)
    if name in _MOVED:
        raise InputError("butterfly", "command", name, _MOVED[name])
    called = COMMANDS.get(name, _NO_COMMAND)
    if json is not None and not called.answer:
        raise InputError("butterfly", "--json", name, "a command with a JSON answer")
    if budget is not None and not (called.panel in _SEARCHING or name == "run"):
        raise InputError("butterfly", "--budget", name, "a command that searches")
    if budget is not None and not budget >= 0:
        raise InputError("butterfly", "--budget", budget, "0 s or more")
    asked.quiet, asked.verbose, asked.json, asked.words = quiet, verbose, json, tokens
    search = progress.current_search()
    with outputs.call(overwrite=overwrite):
        try:
            command, bound = _parsed(tokens)
            if command.__module__.startswith(__package__):  # not the help
                check_outputs(command, bound.arguments, json, (called.answer, *called.also))
            with progress.budget(math.inf if budget is None else budget) as search:
                ended: ExitCode | None = command(*bound.args, **bound.kwargs)
        except UnusableError as refused:
            from butterfly.result import document  # noqa: PLC0415 - slow to import
            from butterfly.verdict import Level, Verdict  # noqa: PLC0415

            verdict = Verdict(Level.WARNING, refused.reasons)
            head = called.answer, "No answer: the values are physically impossible"
            write_json(document(*head, {}, verdict=verdict, summary=verdict.lines))
            raise
        except ButterflyError:
            if search.left_out:
                print_warning(search.sentence)
            raise
        return ended


def _parsed(tokens: Sequence[str]) -> tuple[Function, BoundArguments]:
    """Return the called command and its arguments."""
    gc.disable()  # while modules are imported it would look through them again and again
    try:
        command, bound, _ = program(tokens).parse_args(tokens)
        if "fit" in bound.signature.parameters:
            import butterfly.api.verbs  # noqa: F401, PLC0415 - slow, and now called
    finally:
        gc.freeze()
        gc.enable()
    return command, bound


def _name_of(tokens: Sequence[str]) -> str:
    """Return the words that call a command."""
    words = [token for token in tokens if not token.startswith("-")]
    return " ".join(words[: 2 if words and words[0] in GROUPS else 1])


def main() -> None:
    """Run the command line; bad input gives one line on stderr (see `ExitCode`)."""
    try:
        _run()
    except KeyboardInterrupt:  # asked again while it says that it stopped
        sys.exit(ExitCode.STOPPED)


def _run() -> None:
    """Run the command line, unless it is asked to stop once more than it answers."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _stop)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # what a terminal cannot show is no reason to end
    tokens = sys.argv[1:]
    progress.tell = output.note
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: print_warning(str(message))
            # the program's own `meta` would read the command's options too, before the command does
            general = App(**_HOW, help_flags=(), version_flags=(), end_of_options_delimiter="\0")
            general.default(launch)
            ended = general(tokens)
        sys.stdout.flush()
        sys.exit(ended or ExitCode.DONE)
    except (StoppedError, KeyboardInterrupt) as stopped:
        put(str(stopped) or "stopped", file=sys.stderr)
        sys.exit(ExitCode.STOPPED)
    except CycloptsError as error:
        _end(_said(error, tokens), ExitCode.BAD_INPUT)
    except ButterflyError as error:
        unusable = isinstance(error, UnusableError)
        _end(str(error), ExitCode.NOT_TO_BE_USED if unusable else ExitCode.BAD_INPUT)
    except MemoryError:
        _end(f"not enough memory ({size_text(memory())} available)", ExitCode.BAD_INPUT)
    except BrokenPipeError:
        _leave_stdout()
        sys.exit(ExitCode.UNREAD)
    except OSError as error:
        _leave_stdout()
        _end(str(error), ExitCode.BAD_INPUT)
    finally:
        progress.end_phases()
        asked.__dict__.update(vars(OutputOptions()))


def _stop(number: int, frame: FrameType | None) -> NoReturn:  # noqa: ARG001 - a handler
    """End as by Ctrl-C; who asks again waits for what is being ended."""
    signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _said(error: CycloptsError, tokens: Sequence[str]) -> str:
    """Say in one line what is wrong with what was typed."""
    if isinstance(error, UnknownOptionError):
        option = (error.token.keyword or error.token.value).partition("=")[0]
        name = _name_of(tokens)
        if option in OF_DATA:
            expected = (
                "a manifest or a saved result in place of the logs; give this option to "
                "`butterfly manifest` or `butterfly identify --save`, which write them"
            )
            expected = "from and to in the manifest's logs" if name == "manifest" else expected
            return str(InputError(f"butterfly {name}", option, "not an option here", expected))
    if isinstance(error, UnknownCommandError) and error.unused_tokens:
        # its own message lists all commands after the one that is meant
        return str(error).partition(" Available commands")[0]
    return str(error)


def _end(why: str, code: ExitCode) -> NoReturn:
    line = visible(f"error: {' '.join(why.split())}")
    print(f"\033[31m{line}\033[0m" if sys.stderr.isatty() else line, file=sys.stderr)
    sys.exit(code)


def _leave_stdout() -> None:
    """Discard further output: closing a broken standard output would raise again."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
