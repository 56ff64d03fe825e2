"""Commands that put things side by side: compare, leaderboard."""

from __future__ import annotations

from pathlib import Path  # noqa: TC003 - typer reads annotations
from typing import Annotated

import typer

from butterfly.arguments import (  # noqa: TC001 - typer reads annotations
    DataArgument,
    ReportOption,
    RootOption,
)
from butterfly.compare.leaderboard import leaderboard
from butterfly.compare.three_way import compare_three
from butterfly.console import read_data, show_page, show_progress
from butterfly.errors import InputError, nearest
from butterfly.estimator_options import takes_estimator
from butterfly.experiment.methods import ESTIMATORS
from butterfly.identify.estimators import Estimator  # noqa: TC001 - typer reads annotations
from butterfly.plant.twin import MASS
from butterfly.report.leaderboard import leaderboard_page
from butterfly.report.page import Page, write_page
from butterfly.report.three_way import three_way_page
from butterfly.resources import locate


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("compare")(compare_command)
    app.command("leaderboard")(leaderboard_command)


@takes_estimator()
def compare_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    logs: Annotated[
        str | None,
        typer.Option(help="Numbers of the logs, from 0 on, by commas.", show_default="all"),
    ] = None,
    mass: Annotated[
        float, typer.Option(help="Mass of the hand in kg, for MuJoCo; the motion does not tell it.")
    ] = MASS,
    report: ReportOption = None,
    root: RootOption = None,
) -> None:
    """Compare MuJoCo, grey-box model and logs for the same input.

    The robot is identified from the data set; both simulators get its parameters and each log's
    input. Prints FIT, amplitude and phase error of each, and what the torque left over looks like;
    the report draws time, frequency, phase plane and residual torque.

    Example: `butterfly compare real-logs --root LOGS --report compare.html`
    """
    read = read_data(data, _root_of(data, root))
    found = estimator.unchecked()(read)
    numbers = range(len(read.logs)) if logs is None else _numbers(logs, len(read.logs))
    compared = compare_three(read, found, list(numbers), mass=mass, track=show_progress)
    _show(three_way_page(read.name, read.description, compared), report)


def leaderboard_command(
    *,
    data: Annotated[
        list[Path], typer.Argument(help="Data sets: manifests, folders or shipped names.")
    ],
    methods: Annotated[
        str, typer.Option(help="Estimators, separated by commas.")
    ] = "harmonic-balance,weak-form,output-error,linear,thesis",
    report: ReportOption = None,
    root: RootOption = None,
) -> None:
    """Rank estimators by how well they predict added masses that they have not seen.

    Example: `butterfly leaderboard results/quickstart real-logs --root LOGS`
    """
    names = [part.strip() for part in methods.split(",")]
    for name in names:
        if name not in ESTIMATORS:
            raise InputError("butterfly leaderboard", "--methods", name, nearest(name, ESTIMATORS))
    sets = [read_data(path, _root_of(path, root)) for path in data]
    entries = leaderboard(sets, [ESTIMATORS[name]() for name in names], track=show_progress)
    _show(leaderboard_page(entries), report)


def _show(page: Page, report: Path | None) -> None:
    show_page(page)
    if report is not None:
        write_page(page, report)
        typer.echo(f"Report: {report}")


def _numbers(text: str, count: int) -> list[int]:
    numbers = []
    for part in text.split(","):
        if not (part.strip().isdigit() and int(part) < count):
            raise InputError("butterfly compare", "--logs", part, f"numbers from 0 to {count - 1}")
        numbers.append(int(part))
    return numbers


def _root_of(data: Path, root: Path | None) -> Path | None:
    """Return the root for a manifest; a folder of logs is its own."""
    return None if locate(data).is_dir() else root
