"""Commands that put things side by side: compare, leaderboard."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from butterfly.api.usable import require_possible
from butterfly.cli.console import show_page
from butterfly.cli.data_options import DataOptions, takes_data_options
from butterfly.cli.estimator_options import takes_estimator
from butterfly.cli.exit_codes import end_with
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.options import (
    DATA,
    SPLITS,
    DataArgument,
    FiguresOption,
    HandMassOption,
    HoldoutOption,
    LogOption,
    ReportOption,
    parse_names,
    picked,
    require_report,
)
from butterfly.cli.show_progress import show_progress
from butterfly.comparison.leaderboard import leaderboard
from butterfly.comparison.three_way import compare_three
from butterfly.errors import InputError, nearest
from butterfly.experiment.methods import ESTIMATORS
from butterfly.files import locate
from butterfly.identification.diagnostics.misfit import judge_misfit
from butterfly.identification.estimators import Estimator
from butterfly.identification.identify import judged
from butterfly.identification.splits import Split
from butterfly.report.numbers.comparison_numbers import told_comparison
from butterfly.report.page import Page, write_page
from butterfly.report.ranking_pages import leaderboard_page
from butterfly.report.three_way_page import three_way_page


@answers_in_json("comparison")
@takes_data_options
@takes_estimator()
def compare_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    which: LogOption = None,
    hand_mass: HandMassOption = None,
    holdout: HoldoutOption = None,
    report: ReportOption = None,
    figures: FiguresOption = False,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Compare MuJoCo, grey-box model and logs for the same input.

    The robot is identified from the data set; both simulators get its parameters and each log's
    input. Prints FIT, amplitude and phase error of each, and what the model leaves over; the report
    draws time, frequency, phase plane, correlations of the errors and residual torque.

    Example: `butterfly compare real-logs --report compare.html`
    """
    require_report(figures, report)
    read = options.read(data).holding_out(parse_names(holdout))
    logs = picked(which, len(read.logs))
    chosen = estimator.suited(read)
    found = judged(read, chosen.unchecked())
    require_possible(found)
    compared = compare_three(read, found, logs, mass=hand_mass, track=show_progress)
    misfit = judge_misfit(read, found)
    told = told_comparison(read, chosen, compared, misfit, found)
    _show(three_way_page(read, compared, misfit, told), report, figures, answer)


@answers_in_json("leaderboard")
@takes_data_options
def leaderboard_command(
    *,
    data: Annotated[list[Path], typer.Argument(help=f"The data, each {DATA}.")],
    methods: Annotated[
        str, typer.Option("--method", help="Estimators, by commas.")
    ] = "harmonic-balance, weak-form, output-error, linear, thesis",
    split: Annotated[Split, typer.Option(help=SPLITS)] = Split.AUTO,
    holdout: HoldoutOption = None,
    report: ReportOption = None,
    figures: FiguresOption = False,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Rank estimators by how well they predict what they have not seen.

    Example: `butterfly leaderboard results/quickstart real-logs`
    """
    require_report(figures, report)
    names = [part.strip() for part in methods.split(",")]
    for name in names:
        if name not in ESTIMATORS:
            raise InputError("butterfly leaderboard", "--method", name, nearest(name, ESTIMATORS))
    out = parse_names(holdout)
    sets = [_own_root(options, path).read(path).holding_out(out) for path in data]
    entries = leaderboard(
        sets, [ESTIMATORS[name]() for name in names], split=split, track=show_progress
    )
    _show(leaderboard_page(entries), report, figures, answer)


def _show(page: Page, report: Path | None, figures: bool, answer: JsonAnswer) -> None:
    show_page(page)
    if report is not None:
        write_page(page, report, figures=figures)
        typer.echo(f"Report: {report}")
    answer.write(page.numbers)
    end_with(None if page.verdict is None else page.verdict.level)


def _own_root(options: DataOptions, data: Path) -> DataOptions:
    """Return the options for one of several data sets: a folder of logs is its own root."""
    return replace(options, root=None) if locate(data).is_dir() else options
