"""`butterfly calibrate-orbit`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from butterfly.cli.console import show_page
from butterfly.cli.exit_codes import end_with
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.options import FiguresOption, ResultsOption
from butterfly.cli.show_progress import show_progress
from butterfly.experiment.orbit import calibrate_orbit
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.report.orbit_page import orbit_page
from butterfly.report.page import write_page


@answers_in_json("orbit")
def calibrate_orbit_command(
    *,
    experiment: Annotated[
        Path, typer.Argument(help="An experiment file with control:, or a shipped one's name.")
    ],
    out: ResultsOption = None,
    figures: FiguresOption = False,
    answer: JsonAnswer,
) -> None:
    """Hold a large orbit, re-calibrate the model next to it, and hold it better.

    Rounds of control, log and re-calibration on the simulated robot, until the amplitude is within
    its bound. Writes the logs and a report: amplitude per round, invariant, parameters with
    intervals, free-run error of the model it began with and of the re-calibrated one.

    Example: `butterfly calibrate-orbit experiments/orbit-recalibration.yaml`
    """
    plan = read_experiment(locate(experiment))
    folder = out or Path("results") / plan.name
    study = calibrate_orbit(plan, folder, show_progress)
    carried = study.calibration.rounds[0].logs[0].added_mass
    truth = plan.plant.robot.lumped.with_added_mass(carried)
    page = orbit_page(study, truth)
    show_page(page)
    write_page(page, folder / "report.html", figures=figures)
    typer.echo(f"Report: {folder / 'report.html'}")
    answer.write(page.numbers)
    end_with(study.estimate.level)
