"""`butterfly design`: what to measure next."""

from __future__ import annotations

from functools import cache, partial
from typing import Annotated

import typer

from butterfly.api.usable import require_possible
from butterfly.cli.console import say, say_verdict, show_table
from butterfly.cli.data_options import DataOptions, takes_data_options
from butterfly.cli.estimator_options import takes_estimator
from butterfly.cli.exit_codes import end_with
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.options import (
    DataArgument,
    FiguresOption,
    HoldoutOption,
    LimitOption,
    ReportOption,
    parse_names,
    require_report,
)
from butterfly.cli.show_progress import show_progress
from butterfly.identification.design import next_experiments
from butterfly.identification.estimators import Estimator
from butterfly.identification.identify import judged
from butterfly.model.harmonic import LARGEST_SWING
from butterfly.report.numbers.table_numbers import told_design
from butterfly.report.summary import best_experiment_text


@answers_in_json("design")
@takes_data_options
@takes_estimator()
def design_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    swing: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="Largest swing allowed, in rad; on a slide in m.",
            show_default=f"{LARGEST_SWING:g}, or what a slide's logs have shown",
        ),
    ] = None,
    limit: LimitOption = 12,
    holdout: HoldoutOption = None,
    report: ReportOption = None,
    figures: FiguresOption = False,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Rank candidate next experiments by how much they would tell.

    Sines, multisines and free decays with each added mass of the data set and with none; each is
    simulated with the estimate, of which the verdict stands first. Values that no joint has are
    refused.
    """
    require_report(figures, report)
    logs = options.read(data).holding_out(parse_names(holdout))
    chosen = estimator.suited(logs)
    found = judged(logs, chosen)
    say_verdict(require_possible(found).sentence)
    ranked = next_experiments(logs, found, largest_swing=swing, track=show_progress)
    say(best_experiment_text(ranked[0]))
    show_table(
        f"{logs.name}: standard errors after one more run, over those now",
        ("", "added mass", "input", f"swing in {logs.joint.way}", "mean", *found.names, "warning"),
        [
            (
                str(rank),
                str(candidate.added_mass),
                candidate.what,
                f"{candidate.swing:.2f}",
                f"{candidate.score:.2f}",
                *(f"{error:.2f}" for error in candidate.errors),
                candidate.warning,
            )
            for rank, candidate in enumerate(ranked[:limit], start=1)
        ],
    )
    tell = cache(partial(told_design, logs, chosen, found, ranked))
    if report is not None:
        from butterfly.api.tabulated import Designed  # noqa: PLC0415 - slow to import

        Designed.of_told(tell()).report(report, figures=figures)
        typer.echo(f"Report: {report}")
    answer.give(tell)
    end_with(found.level)
