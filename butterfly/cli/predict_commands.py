"""`butterfly predict`: what is to come, and how far that is known."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from butterfly.api.looking_ahead import draws as parameters_of
from butterfly.api.looking_ahead import predict
from butterfly.api.sources import is_data
from butterfly.cli.console import show_page
from butterfly.cli.data_options import DataOptions, takes_data_options
from butterfly.cli.exit_codes import end_with
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.options import DATA, FiguresOption, ReportOption, parse_pairs, require_report
from butterfly.cli.show_progress import show_progress
from butterfly.errors import InputError
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.identification.draws import COUNT, LEAST
from butterfly.report.page import write_page


@answers_in_json("prediction")
@takes_data_options
def predict_command(
    *,
    data: Annotated[
        Path,
        typer.Argument(
            help=f"What is predicted: {DATA}; or an experiment file, or a shipped one's name, of "
            "which the inputs count."
        ),
    ],
    given: Annotated[
        str,
        typer.Option(
            "--with",
            help="An identification that was saved (`butterfly identify --save FILE`); or "
            "parameters, p1=…,p3=… and whatever else is not 0 (p2, p4, coulomb, delay, …) and not "
            "known of the data; without p4 the best one is taken, without zero=… the encoder's is "
            "read off the logs.",
        ),
    ],
    bands: Annotated[
        bool,
        typer.Option("--bands", help="Say how far the prediction is known; a report always does."),
    ] = False,
    draws: Annotated[
        int, typer.Option(min=LEAST, help="Sets of parameters drawn, for bands and --out.")
    ] = COUNT,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Write the parameters drawn to this file (CSV), as for domain randomisation.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Fixes everything random.")] = 0,
    report: ReportOption = None,
    figures: FiguresOption = False,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Predict logs, or an experiment that nobody has done, with given parameters.

    Identifies nothing: simulates each log from its first sample and its input alone, and says
    whether these parameters move like this robot. With --bands it says of each
    instant where the angle is with 95 %: of the model, with whatever parameters the estimate
    leaves open; and of a new log, with what the model misses besides, as seen on the logs that the
    estimate was made from.

    Examples: `butterfly predict quickstart --with result.json --bands --report prediction.html`,
    `butterfly predict results/quickstart --with p1=0.0033,p2=0.0014,p3=0.05`
    """
    require_report(figures, report)
    named, result = locate(data), _result(given)
    found = predict(
        options.read(data) if is_data(named) else read_experiment(named),
        result,
        bands=bands or (report is not None and isinstance(result, Path)),
        draws=draws,
        seed=seed,
        track=show_progress,
    )
    page = found.page()
    show_page(page)
    if out is not None:
        if not isinstance(result, Path):
            raise InputError("butterfly predict", "--out", out, "an identification to draw from")
        drawn = found.drawn or parameters_of(result, draws, seed, track=show_progress)
        drawn.write_csv(out)
        typer.echo(f"Draws: {out}")
    if report is not None:
        write_page(page, report, figures=figures)
        typer.echo(f"Report: {report}")
    answer.give(found.told)
    end_with(found.judged.level if found.judged else None)


def _result(given: str) -> Path | dict[str, str]:
    """Return the file of an identification, or parameters."""
    if "=" in given and not Path(given).exists():
        return parse_pairs(given, "--with")
    return Path(given)
