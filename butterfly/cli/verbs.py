"""Commands of verbs: what the command line has besides."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

import butterfly as bf
from butterfly.cli.derived import Ask, command, verb_named
from butterfly.cli.options import NO_REPORT, OUT, SILENT, WRITTEN, DataOptions, Report, parse_pairs
from butterfly.cli.output import ExitCode, asked, put, say, show, show_progress, warn
from butterfly.cli.written import FOLDER, SAVED, OutputFile
from butterfly.errors import InputError, StoppedError

_DRAWS = Parameter(help="Write the parameter draws: .csv, .parquet, or a folder of MJCF.")
_More = Annotated[Path, Parameter(show=False)]
_Save = Annotated[
    Path | None,
    Parameter(group=WRITTEN, metavar="FILE", help="Save the result (.json) for other commands."),
    SAVED,
]
_Limit = Annotated[
    int, Parameter(metavar="N", validator=Number(gte=1), help="Number of candidates to print.")
]

_WITHOUT = {
    "select": ("terms",),
    "validate": ("others",),
    **dict.fromkeys(("compare", "inspect"), ("hand_mass",)),
    "campaign": ("callbacks", "change", "known", "step"),
}
"""Parameters of verbs, or options of their methods, that are no options of their commands."""


def __getattr__(name: str) -> Callable[..., ExitCode]:
    """Return the command of a verb; only the module of that verb is imported."""
    if name not in dir(bf):
        raise AttributeError(name)
    return command(verb_named(name), globals().get(f"_{name}", _shown), _WITHOUT.get(name, ()))


def _shown(ask: Ask, *, page: Report = NO_REPORT) -> ExitCode:
    return show(ask(), **vars(page))


def _design(ask: Ask, *, limit: _Limit = 12, page: Report = NO_REPORT) -> ExitCode:
    return show(ask(), **vars(page), rows=limit)


def _validate(ask: Ask, /, *more: _More, page: Report = NO_REPORT) -> ExitCode:
    return show(ask(others=more), **vars(page))


def _inspect(ask: Ask, *, page: Report = NO_REPORT, facts: DataOptions = SILENT) -> ExitCode:
    answer = ask(root=facts.root, **facts.description())
    if not isinstance(answer, bf.Inspection):
        return show(answer, **vars(page))
    identifiable = any(forecast.half_width is not None for forecast in answer.before_fit)
    # options that `identify` has too
    plain = identifiable and not answer.unusable and page.report is None
    words = [*asked.words]
    words[words.index("inspect")] = "identify"
    ended = show(answer, **vars(page), after=f"butterfly {shlex.join(words)}" if plain else "")
    answer.require_usable()
    return ended


def _identify(
    ask: Ask,
    data: Path,
    /,
    *more: _More,
    against: tuple[Annotated[str, Parameter(metavar="PAIRS")], ...] = (),
    save: _Save = None,
    page: Report = NO_REPORT,
    facts: DataOptions = SILENT,
) -> ExitCode:
    from butterfly.cli.next_command import next_command  # noqa: PLC0415 - slow to import

    others = {text: parse_pairs(text, "--against") for text in against}
    paths = [data, *more]
    logs = bf.read(paths, root=facts.root, track=show_progress, **facts.description())
    answer = ask(data=logs, against=others)
    ended = show(answer, **vars(page), save=save)
    if not asked.silent:  # whole, however long: to be pasted
        put(f"Next: {next_command(answer, asked.words, [*paths, *facts.words()], save)}")
    return ended


def _predict(
    ask: Ask,
    *,
    result: Annotated[str, Parameter(name="--with", metavar="RESULT")],
    bands: Annotated[bool, Parameter(help="Compute 95 % bands (always in a report).")] = False,
    out: Annotated[Path | None, OUT, _DRAWS, OutputFile(("", ".csv", ".parquet"))] = None,
    page: Report = NO_REPORT,
) -> ExitCode:
    pairs = "=" in result and not Path(result).exists()
    if out is not None and pairs:
        raise InputError("butterfly predict", "--out", out, "an identification to draw from")
    given = parse_pairs(result, "--with") if pairs else Path(result)
    banded = bands or (page.report is not None and not pairs)
    chosen = ask.keywords["draws"], ask.keywords["seed"]
    drawn = bf.draws(result, *chosen) if out is not None and not banded else None
    answer = ask(result=given, bands=banded)
    ended = show(answer, **vars(page))
    if out is not None:
        (drawn or answer.drawn).write(out)
        say(f"Draws: {out}")
    return ended


def _compare(
    ask: Ask, data: Path, other: Path | None = None, /, *, page: Report = NO_REPORT
) -> ExitCode:
    """Compare two saved results; or MuJoCo, the model and the logs.

    Two saved results: tests which parameters have changed (5 % significance, all tests together).
    One data set: simulates every log in MuJoCo and with the model, and prints FIT, amplitude and
    phase errors. Two runs of a sweep: lists their settings and estimates.

    Parameters
    ----------
    data
        The earlier saved result; a run of a sweep, such as results/NAME/0; or one data set.
    other
        The later saved result, or the other run.
    """
    if other is None:
        return _shown(ask, page=page)
    from butterfly.api.sources import names_result  # noqa: PLC0415 - slow to import
    from butterfly.api.verbs import options_text  # noqa: PLC0415
    from butterfly.cli.results import compare_runs, is_run  # noqa: PLC0415

    unasked = {"data": data, "logs": None, "holdout": (), "track": show_progress}
    given = [name for name, value in ask.keywords.items() if (name, value) not in unasked.items()]
    if given:
        expected = "no such option with two results"
        raise InputError("butterfly compare", "option", options_text(given), expected)
    if is_run(data) and is_run(other):
        if page.report is not None:
            expected = "no report: two runs of sweeps have none"
            raise InputError("butterfly compare", "--report", page.report, expected)
        return compare_runs(data, other)
    for field, path in {"DATA": data, "OTHER": other}.items():
        if not names_result(path):
            expected = "a saved identification (.json), or two runs of sweeps (results/NAME/NUMBER)"
            raise InputError("butterfly compare", field, path, expected)
    return _shown(partial(bf.changed, data, other), page=page)


def _campaign(
    ask: Ask,
    *,
    known: Annotated[tuple[str, ...], Parameter(help="Known value: NAME=VALUE. Repeatable.")] = (),
    yes: Annotated[
        bool,
        Parameter(negative="", help="Begin without waiting for Enter, also without a keyboard."),
    ] = False,
) -> ExitCode:
    from butterfly.api.campaigns import names_motor  # noqa: PLC0415 - slow to import
    from butterfly.campaigns.drive import LeftOnError, SafetyStop  # noqa: PLC0415
    from butterfly.cli.campaign_terminal import CampaignTerminal  # noqa: PLC0415

    pairs = parse_pairs(",".join(known), "--known") if known else None
    moves, keyboard = names_motor(str(ask.keywords["robot"])), sys.stdin.isatty()
    if moves and not keyboard:
        if not yes:
            expected = "a terminal, where Enter lets the motor move; or --yes, which does without"
            raise InputError("butterfly campaign", "standard input", "no keyboard", expected)
        if len(ask.keywords["masses"] or ()) > 1:
            expected = "one mass: without a keyboard nobody can be asked to change it"
            raise InputError("butterfly campaign", "--masses", ask.keywords["masses"], expected)
    terminal = CampaignTerminal(asks=moves and not yes, moves=moves)
    change = terminal.mount if keyboard else None
    folder = shlex.quote(str(ask.keywords["out"] or "campaign"))
    state = f"the drive is off; finished runs are kept in {folder}, and the same command goes on"
    try:
        answer = ask(known=pairs, change=change, callbacks=terminal)
    except KeyboardInterrupt:
        raise StoppedError(f"stopped: {state}") from None
    except LeftOnError:
        raise
    except SafetyStop as stop:
        raise SafetyStop(f"{stop}; {state}") from stop
    finally:
        terminal.clear()
    ended = show(answer)
    say(f"Report: {answer.page_path}")
    return ended


def _run(ask: Ask) -> ExitCode:
    """Simulate an experiment or a sweep, identify the joint, and write a report.

    Compares true and estimated parameters. Finished runs are reused unless the experiment or
    butterfly's code has changed; an interrupted or extended sweep resumes where it stopped. Exit
    code 1: some runs of a sweep failed; 3: do not use the estimate.
    """
    _warn_of_wide_swings(ask)
    answer = ask()
    ended = show(answer)
    for page in answer.reports:
        say(f"Report: {page}")
    return ExitCode.NO_RESULT if isinstance(answer, bf.Sweep) and answer.unsuccessful else ended


def _simulate(ask: Ask, *, out: Annotated[Path, OUT, FOLDER]) -> ExitCode:
    from butterfly.experiment.simulate import simulate, write_logs  # noqa: PLC0415 - slow to import

    _warn_of_wide_swings(ask)
    plan = bf.read_experiment(ask.keywords["experiment"])
    say(f"Logs: {write_logs(plan, simulate(plan, track=show_progress), out)}")
    return ExitCode.DONE


def _warn_of_wide_swings(ask: Ask) -> None:
    for added, sine, swing in bf.read_experiment(ask.keywords["experiment"]).wide_swings():
        warn(
            f"{added}, {sine.omega:g} rad/s: predicted swing {swing:.2g} rad; "
            "reduce the amplitude to stay at small angles"
        )
