"""`butterfly identify`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from butterfly.cli.data_options import DataOptions, takes_data_options
from butterfly.cli.estimator_options import takes_estimator
from butterfly.cli.exit_codes import end_with
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.options import (
    DataArgument,
    FiguresOption,
    HoldoutOption,
    ReportOption,
    parse_names,
    parse_pairs,
    require_report,
)
from butterfly.cli.show_identification import show_identification
from butterfly.cli.show_progress import show_progress
from butterfly.identification.estimators import Estimator
from butterfly.identification.identify import identify
from butterfly.identification.other_parameters import told_parameters


@answers_in_json("identification")
@takes_data_options
@takes_estimator()
def identify_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    report: ReportOption = None,
    figures: FiguresOption = False,
    against: Annotated[
        list[str] | None,
        typer.Option(
            help="Other parameters to simulate the same logs with: p1=…, p2=…, p3=…, by commas, "
            "and more if wanted; without p4 the best one is taken. May be repeated.",
            show_default=False,
        ),
    ] = None,
    holdout: HoldoutOption = None,
    save: Annotated[
        Path | None,
        typer.Option(
            help="Save the identification to this file (.json), to be read again by `butterfly "
            "predict`, `results compare` and from Python: what --json writes, and where the logs "
            "lie on this machine.",
            show_default=False,
        ),
    ] = None,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Identify the robot from a data set.

    Prints the verdict, how well a free-run simulation follows the logs (FIT), and the parameters
    with standard errors and intervals. A folder without manifest.yaml needs --arm, and files named
    like Data_120_5__3_5__0015.mat (120.5 g, 3.5 rad/s, amplitude 0.015).

    Exit code 3 says that the values are not to be used; the verdict says why.

    Try `butterfly identify results/quickstart` after `butterfly run quickstart`, or
    `butterfly identify real-logs --report report.html` after `butterfly logs fetch`.
    """
    require_report(figures, report)
    others = {
        text: told_parameters(parse_pairs(text, "--against"), "--against") for text in against or []
    }
    logs = options.read(data).holding_out(parse_names(holdout))
    chosen = estimator.suited(logs)
    result = identify(logs, chosen, against=others, track=show_progress)
    show_identification(result)
    if report is not None:
        from butterfly.report.identification_page import write_report  # noqa: PLC0415 - slow to import

        write_report(result, report, figures=figures)
        typer.echo(f"Report: {report}")
    answer.give(result.told)
    if save is not None:
        result.save(save)
        typer.echo(f"Saved: {save}")
    end_with(result.estimate.level)
