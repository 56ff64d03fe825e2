"""Commands of verbs: what the command line has besides."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

import butterfly as bf
from butterfly.cli.command_texts import ARGUMENTS
from butterfly.cli.estimator_options import (
    FIT_OF_ONE,
    FIT_OF_SEVERAL,
    FIT_OF_TERMS,
    FitOfOne,
    FitOfSeveral,
    FitOfTerms,
)
from butterfly.cli.options import (
    ALL,
    NO_REPORT,
    OUT,
    SILENT,
    WRITTEN,
    DataOptions,
    Report,
    parse_names,
    parse_pairs,
    parse_positions,
)
from butterfly.cli.output import (
    FOLDER,
    SAVED,
    ExitCode,
    OutputFile,
    asked,
    put,
    say,
    show,
    show_progress,
    warn,
)
from butterfly.cli.verb_options import (
    CAMPAIGN,
    COMPARE,
    DESIGN,
    IDENTIFY,
    INSPECT,
    PREDICT,
    RESIDUAL,
    RUN,
    SELECT,
    VALIDATE,
    OptionsOfCampaign,
    OptionsOfCompare,
    OptionsOfDesign,
    OptionsOfIdentify,
    OptionsOfInspect,
    OptionsOfPredict,
    OptionsOfResidual,
    OptionsOfRun,
    OptionsOfSelect,
    OptionsOfValidate,
)
from butterfly.errors import InputError, StoppedError
from butterfly.outputs import require_free


def _says(argument: str) -> Parameter:
    """Return the help that a verb has for a parameter that its command declares."""
    return Parameter(help=ARGUMENTS[argument])


_Pairs = Annotated[str, Parameter(metavar="PAIRS")]
_AGAINST = Parameter(help=f"{ARGUMENTS['identify.against']} Repeatable.")
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


def inspect(
    data: Annotated[Path, _says("inspect.source")],
    /,
    *,
    options: OptionsOfInspect = INSPECT,
    page: Report = NO_REPORT,
    facts: DataOptions = SILENT,
) -> ExitCode:
    """Show what `butterfly.inspect` answers, and the command after it."""
    from butterfly.api.inspected import require_usable, unusable_logs  # noqa: PLC0415 - slow to import

    answer = bf.inspect(
        data, **options.keywords(), track=show_progress, root=facts.root, **facts.description()
    )
    if answer.kind != "inspection":
        return show(answer, **vars(page))
    forecasts, unusable = answer.content["before_fit"], unusable_logs(answer)
    identifiable = any(forecast["half_width"] is not None for forecast in forecasts)
    # options that `identify` has too
    plain = identifiable and not unusable and page.report is None
    words = [*asked.words]
    words[words.index("inspect")] = "identify"
    ended = show(answer, **vars(page), after=f"butterfly {shlex.join(words)}" if plain else "")
    require_usable(answer)
    return ended


def identify(
    data: Annotated[Path, _says("identify.data")],
    /,
    *more: _More,
    against: Annotated[tuple[_Pairs, ...], _AGAINST] = (),
    options: OptionsOfIdentify = IDENTIFY,
    save: _Save = None,
    page: Report = NO_REPORT,
    facts: DataOptions = SILENT,
    fit: FitOfOne = FIT_OF_ONE,
) -> ExitCode:
    """Show what `butterfly.identify` answers, and the command after it."""
    from butterfly.cli.next_command import next_command  # noqa: PLC0415 - slow to import

    keywords = fit.keywords()
    others = {text: parse_pairs(text, "--against") for text in against}
    paths = [data, *more]
    if facts.names_joints:
        if against:
            expected = "one joint (--of JOINT), to compare it with other parameters"
            raise InputError("butterfly identify", "--against", against[0], expected)
        return _identify_joints(paths, facts, keywords, save, page)
    logs = bf.read(paths, root=facts.root, track=show_progress, **facts.description())
    answer = bf.identify(
        logs, against=others, **options.keywords(), track=show_progress, **keywords
    )
    ended = show(answer, **vars(page), save=save)
    if not asked.silent:  # whole, however long: to be pasted
        put(f"Next: {next_command(answer, asked.words, [*paths, *facts.words()], save)}")
    return ended


def _identify_joints(
    paths: list[Path],
    facts: DataOptions,
    keywords: Mapping[str, Any],
    save: Path | None,
    page: Report,
) -> ExitCode:
    """Show a table of joints, and save the result of each beside the others."""
    description = facts.description()
    model, names = description.pop("model", None), description.pop("of")
    if model is None:
        expected = "--model FILE as well: the MJCF or URDF that has these joints"
        raise InputError("butterfly identify", "--of", names, expected)
    answer = bf.identify_joints(
        paths,
        model=model,
        of=names if names == ALL else parse_names(names),
        root=facts.root,
        description=description,
        track=show_progress,
        **keywords,
    )
    files, answers = dict[str, Path](), answer.identifications
    if save is not None:
        files = {joint: save.with_stem(f"{save.stem}_{joint}") for joint in answers}
    for joint, file in files.items():
        require_free(file, *(SAVED.documents), option="--save")
        answers[joint].save(file)
    ended = show(answer, **vars(page))
    for file in files.values():
        say(f"Saved: {file}")
    if files and not asked.silent:
        good = [file for joint, file in files.items() if answers[joint].standing == "good"]
        saved, out = shlex.join(map(str, good)), model.with_stem(f"{model.stem}_identified").name
        ready = f"export {saved} --into {shlex.quote(str(model))} --out {out}"
        worst = next(iter(files.values()))
        put(f"Next: butterfly {ready if good else f'design {shlex.quote(str(worst))}'}")
    return ended


def select(
    data: Annotated[Path, _says("select.data")],
    /,
    *,
    options: OptionsOfSelect = SELECT,
    page: Report = NO_REPORT,
    fit: FitOfTerms = FIT_OF_TERMS,
) -> ExitCode:
    """Show what `butterfly.select` answers."""
    answer = bf.select(data, **options.keywords(), track=show_progress, **fit.keywords())
    return show(answer, **vars(page))


def design(
    data: Annotated[Path, _says("design.data")],
    /,
    *,
    options: OptionsOfDesign = DESIGN,
    limit: _Limit = 12,
    page: Report = NO_REPORT,
) -> ExitCode:
    """Show what `butterfly.design` answers."""
    answer = bf.design(data, **options.keywords(), track=show_progress)
    return show(answer, **vars(page), rows=limit)


def validate(
    data: Annotated[Path, _says("validate.data")],
    /,
    *more: _More,
    options: OptionsOfValidate = VALIDATE,
    page: Report = NO_REPORT,
    fit: FitOfSeveral = FIT_OF_SEVERAL,
) -> ExitCode:
    """Show what `butterfly.validate` answers."""
    answer = bf.validate(
        data, others=more, **options.keywords(), track=show_progress, **fit.keywords()
    )
    return show(answer, **vars(page))


def residual(
    data: Annotated[Path, _says("residual.data")],
    /,
    *,
    options: OptionsOfResidual = RESIDUAL,
    page: Report = NO_REPORT,
    fit: FitOfOne = FIT_OF_ONE,
) -> ExitCode:
    """Show what `butterfly.residual` answers."""
    return show(bf.residual(data, **options.keywords(), **fit.keywords()), **vars(page))


def predict(
    data: Annotated[Path, _says("predict.data")],
    /,
    *,
    result: Annotated[str, Parameter(name="--with", metavar="RESULT"), _says("predict.result")],
    bands: Annotated[bool, Parameter(help="Compute 95 % bands (always in a report).")] = False,
    options: OptionsOfPredict = PREDICT,
    out: Annotated[Path | None, OUT, _DRAWS, OutputFile(("", ".csv", ".parquet"))] = None,
    page: Report = NO_REPORT,
) -> ExitCode:
    """Show what `butterfly.predict` answers, and write what it drew."""
    pairs = "=" in result and not Path(result).exists()
    if out is not None and pairs:
        raise InputError("butterfly predict", "--out", out, "an identification to draw from")
    given = parse_pairs(result, "--with") if pairs else Path(result)
    banded = bands or (page.report is not None and not pairs)
    chosen = options.draws, options.seed
    drawn = bf.draws(result, *chosen) if out is not None and not banded else None
    answer = bf.predict(data, given, bands=banded, **options.keywords(), track=show_progress)
    ended = show(answer, **vars(page))
    drawn = drawn or answer.drawn
    if out is not None and drawn is not None:
        drawn.write(out)
        say(f"Draws: {out}")
    return ended


def compare(
    data: Path,
    other: Path | None = None,
    /,
    *,
    options: OptionsOfCompare = COMPARE,
    page: Report = NO_REPORT,
    fit: FitOfOne = FIT_OF_ONE,
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
    chosen = fit.keywords()
    if other is None:
        answer = bf.compare(data, **options.keywords(), track=show_progress, **chosen)
        return show(answer, **vars(page))
    from butterfly.api.sources import is_run, names_result  # noqa: PLC0415 - slow to import
    from butterfly.api.verbs import options_text  # noqa: PLC0415
    from butterfly.cli.results import compare_runs  # noqa: PLC0415

    plain: Mapping[str, object] = COMPARE.keywords()
    given = [name for name, value in options.keywords().items() if value != plain[name]]
    if given or chosen:
        expected = "no such option with two results"
        text = options_text([*given, *chosen])
        raise InputError("butterfly compare", "option", text, expected)
    if is_run(data) and is_run(other):
        if page.report is not None:
            expected = "no report: two runs of sweeps have none"
            raise InputError("butterfly compare", "--report", page.report, expected)
        return compare_runs(data, other)
    for field, path in {"DATA": data, "OTHER": other}.items():
        if not names_result(path):
            expected = "a saved identification (.json), or two runs of sweeps (results/NAME/NUMBER)"
            raise InputError("butterfly compare", field, path, expected)
    return show(bf.changed(data, other), **vars(page))


_KNOWN = "Known value: NAME=VALUE; or of a motor of the library: from=MOTOR. Repeatable."
_POSE = "Positions of the other joints of --model: NAME=VALUE, by commas. Default: its keyframe."


def campaign(
    robot: Annotated[Path, _says("campaign.robot")],
    /,
    *,
    options: OptionsOfCampaign = CAMPAIGN,
    known: Annotated[tuple[str, ...], Parameter(help=_KNOWN)] = (),
    pose: Annotated[str | None, Parameter(metavar="PAIRS", help=_POSE)] = None,
    yes: Annotated[
        bool,
        Parameter(negative="", help="Begin without waiting for Enter, also without a keyboard."),
    ] = False,
) -> ExitCode:
    """Show what `butterfly.campaign` does and answers; ask for masses, and before a motor moves."""
    from butterfly.api.campaigns import names_motor  # noqa: PLC0415 - slow to import
    from butterfly.campaigns.drive import LeftOnError, SafetyStop  # noqa: PLC0415
    from butterfly.cli.campaign_terminal import CampaignTerminal  # noqa: PLC0415

    keywords = options.keywords()
    pairs = parse_pairs(",".join(known), "--known") if known else None
    places = None if pose is None else parse_positions(pose)
    moves, keyboard = names_motor(str(robot)), sys.stdin.isatty()
    if moves and not keyboard:
        if not yes:
            expected = "a terminal, where Enter starts the motor; or --yes, to start without it"
            raise InputError("butterfly campaign", "standard input", "no keyboard", expected)
        if len(keywords["masses"] or ()) > 1:
            expected = "one mass: without a keyboard nobody can be asked to change it"
            raise InputError("butterfly campaign", "--masses", keywords["masses"], expected)
    terminal = CampaignTerminal(asks=moves and not yes, moves=moves)
    change = terminal.mount if keyboard else None
    folder = shlex.quote(str(options.out or "campaign"))
    state = f"the drive is off; finished runs are kept in {folder}, and the same command continues"
    try:
        answer = bf.campaign(
            robot, **keywords, known=pairs, pose=places, change=change, callbacks=terminal
        )
    except KeyboardInterrupt:
        raise StoppedError(f"stopped: {state}") from None
    except LeftOnError:
        raise
    except SafetyStop as stop:
        raise SafetyStop(f"{stop}; {state}") from stop
    finally:
        terminal.clear()
    ended = show(answer)
    _say_reports(answer)
    return ended


def run(
    experiment: Annotated[Path, _says("run.experiment")],
    /,
    *,
    options: OptionsOfRun = RUN,
) -> ExitCode:
    """Simulate an experiment or a sweep, identify the joint, and write a report.

    Compares true and estimated parameters. Finished runs are reused unless the experiment or
    butterfly's code has changed; an interrupted or extended sweep resumes where it stopped. Exit
    code 1: some runs of a sweep failed; 3: do not use the estimate.
    """
    _warn_of_wide_swings(experiment)
    answer = bf.run(experiment, **options.keywords(), track=show_progress)
    ended = show(answer)
    _say_reports(answer)
    return ExitCode.NO_RESULT if answer.content.get("unsuccessful") else ended


def _say_reports(answer: bf.Answer) -> None:
    for page in answer.reports:
        say(f"Report: {page}")


def simulate(
    experiment: Annotated[Path, _says("simulate.experiment")],
    /,
    *,
    out: Annotated[Path, OUT, _says("simulate.out"), FOLDER],
) -> ExitCode:
    """Simulate as `butterfly.simulate` does, and write the logs."""
    from butterfly.experiment.run import simulate, write_logs  # noqa: PLC0415 - slow to import

    _warn_of_wide_swings(experiment)
    plan = bf.read_experiment(experiment)
    say(f"Logs: {write_logs(plan, simulate(plan, track=show_progress), out)}")
    return ExitCode.DONE


def _warn_of_wide_swings(experiment: Path) -> None:
    for added, sine, swing in bf.read_experiment(experiment).wide_swings():
        warn(
            f"{added}, {sine.omega:g} rad/s: predicted swing {swing:.2g} rad; "
            "reduce the amplitude to stay at small angles"
        )
