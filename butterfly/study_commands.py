"""Commands that judge an identification, or plan the next: validate, select, residual, design."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from butterfly.arguments import DataArgument, RootOption, parse_terms
from butterfly.console import CONSOLE, new_table, read_data, show_page, show_progress
from butterfly.errors import InputError
from butterfly.estimator_options import takes_estimator
from butterfly.experiment.orbit import calibrate_orbit
from butterfly.experiment.reading import read_experiment
from butterfly.experiment.thesis_robot import thesis_robot
from butterfly.identify.design import LARGEST_SWING, rank_experiments
from butterfly.identify.estimators import Estimator  # noqa: TC001 - typer reads annotations
from butterfly.identify.judgement.bootstrap import bootstrap
from butterfly.identify.judgement.residual_torque import residual_torque
from butterfly.identify.judgement.term_selection import select_terms
from butterfly.identify.judgement.validation import Split, hold_out
from butterfly.identify.predict import FitSummary, Predictor
from butterfly.model.parameters import NO_ADDED_MASS
from butterfly.report.orbit import orbit_page
from butterfly.report.page import write_page
from butterfly.report.residual_torque import write_residual
from butterfly.resources import locate
from butterfly.thesis.figure_data import write_figure_data
from butterfly.thesis.tables import has_real_logs, reproduce


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("validate")(validate_command)
    app.command("select")(select_command)
    app.command("residual")(residual_command)
    app.command("design")(design_command)
    app.command("reproduce")(reproduce_command)
    app.command("calibrate-orbit")(calibrate_orbit_command)


@takes_estimator()
def validate_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    split: Annotated[
        Split, typer.Option(help="What is left out together: one added mass, or some frequencies.")
    ] = Split.MASS,
    repetitions: Annotated[
        int,
        typer.Option(
            "--bootstrap", min=0, help="Also estimate so often from logs drawn with replacement."
        ),
    ] = 0,
    root: RootOption = None,
) -> None:
    """Predict logs that the estimator has not seen, and compare with those it has.

    Example: `butterfly validate results/quickstart --method output-error`
    """
    logs = read_data(data, root)
    quick = estimator.unchecked()
    held = hold_out(logs, quick, split, track=show_progress)
    whole = quick(logs)
    seen = FitSummary.of(Predictor(logs).fits(whole))
    table = new_table(f"{logs.name}: FIT in %", "", "median", "mean", "worst")
    for name, fit in (("in sample", seen), (f"one {split} left out", held.summary)):
        table.add_row(name, *_fit(fit))
    CONSOLE.print(table)
    typer.echo(f"{int(np.sum(held.fits > 90))} of {held.fits.size} logs left out are above 90 %.")  # noqa: PLR2004
    for name, found in held.estimates.items():
        values = ", ".join(
            f"{key} {value:.4g}" for key, value in zip(found.names, found.values, strict=True)
        )
        typer.echo(f"Without {name}: {values}")
    if repetitions:
        drawn = bootstrap(logs, quick, repetitions=repetitions, track=show_progress)
        table = new_table("95 % intervals by bootstrap over logs", "", "estimate", "lower", "upper")
        rows = zip(whole.names, whole.values, drawn.lower, drawn.upper, strict=True)
        for name, *numbers in rows:
            table.add_row(str(name), *(f"{number:.4g}" for number in numbers))
        CONSOLE.print(table)


@takes_estimator("output-error", leave_out=("terms",))
def select_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    candidates: Annotated[
        str, typer.Option(help="Terms to choose from, separated by commas.")
    ] = "drag,load,bias,p3_offset,stribeck",
    root: RootOption = None,
) -> None:
    """Choose friction terms by how well they predict added masses that were left out.

    Terms are added one by one, the most helpful first, until none helps. With output-error and
    forty logs this takes minutes.
    """
    logs = read_data(data, root)
    terms = parse_terms(candidates) or ()
    passed = select_terms(logs, estimator.unchecked(), terms, track=show_progress)
    headers = [f"{kind} {what}" for kind in ("in sample", *Split) for what in ("median", "mean")]
    table = new_table(f"{logs.name}: FIT in %, in sample and left out", "terms", *headers)
    for structure in passed:
        fits = [structure.in_sample, *(structure.held_out[split] for split in Split)]
        cells = [f"{value:.1f}" for fit in fits for value in (fit.median, fit.mean)]
        table.add_row(", ".join(("p1..p4, coulomb, delay", *structure.terms)), *cells)
    CONSOLE.print(table)
    typer.echo(f"Chosen: --terms {','.join(passed[-1].terms) or '(none)'}")


@takes_estimator()
def residual_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    number: Annotated[int, typer.Option("--log", min=0, help="Which log, from 0 on.")] = 0,
    plot: Annotated[
        Path | None, typer.Option(help="Write a plot (HTML) to this file.", show_default=False)
    ] = None,
    root: RootOption = None,
) -> None:
    """Show the torque that p1..p4 leave over in one log, and the friction term it looks like."""
    logs = read_data(data, root)
    if number >= len(logs.logs):
        raise InputError(data, "--log", number, f"less than {len(logs.logs)}")
    log = logs.logs[number]
    setting = Predictor(logs).setting(number, estimator.unchecked()(logs))
    residual = residual_torque(log, setting.parameters, setting.zero)
    typer.echo(f"{log.label}: looks like {residual.looks_like}")
    table = new_table("Share of its variance that each term alone explains", "term", "%")
    for name, share in residual.shares.items():
        table.add_row(name, f"{100 * share:.1f}")
    CONSOLE.print(table)
    if plot is not None:
        write_residual(residual, log.label, plot)
        typer.echo(f"Plot: {plot}")


@takes_estimator()
def design_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    swing: Annotated[
        float, typer.Option(min=0.01, help="Largest swing allowed, in rad.")
    ] = LARGEST_SWING,
    count: Annotated[int, typer.Option(min=1, help="How many candidates to print.")] = 12,
    root: RootOption = None,
) -> None:
    """Rank candidate next experiments by how much they would tell.

    Sines, multisines and free decays with each added mass of the data set and with none; each is
    simulated with the estimate.
    """
    logs = read_data(data, root)
    found = estimator(logs)
    misfit = 1 - float(np.median(Predictor(logs).fits(found))) / 100
    masses = sorted({*logs.masses, NO_ADDED_MASS})
    ranked = rank_experiments(found, masses, misfit, largest_swing=swing, track=show_progress)
    table = new_table(
        f"{logs.name}: standard errors after one more run, over those now",
        *("added mass", "input", "swing in rad", "mean", *found.names, "warning"),
    )
    for candidate in ranked[:count]:
        table.add_row(
            str(candidate.added_mass),
            candidate.what,
            f"{candidate.swing:.2f}",
            f"{candidate.score:.2f}",
            *(f"{error:.2f}" for error in candidate.errors),
            candidate.warning,
        )
    CONSOLE.print(table)


def reproduce_command(
    *,
    what: Annotated[str, typer.Argument(help="What to reproduce: thesis.")],
    root: Annotated[
        Path | None,
        typer.Option(help="Folder of the 41 real logs; or set BUTTERFLY_LOGS.", show_default=False),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Write the data of Figures 3-12 to this folder.", show_default=False),
    ] = None,
) -> None:
    """Print the thesis's figures beside those obtained the same way, and the right ones.

    Example: `butterfly reproduce thesis --root LOGS --out figures`
    """
    if what != "thesis":
        raise InputError("butterfly reproduce", "what", what, "thesis")
    synthetic = thesis_robot()
    rows = reproduce(synthetic, root)
    table = new_table("The thesis, published against obtained", "figures", "published", "obtained")
    table.add_column("same")
    table.add_column("right")
    for row in rows:
        same = "yes" if row.agrees else "no"
        table.add_row(row.what, row.published, row.obtained, same, row.corrected)
    CONSOLE.print(table)
    for row in rows:
        if row.note:
            typer.echo(f"{row.what}: {row.note}")
    if not has_real_logs(root):
        typer.echo("Tables 4 and 5 need the real logs: give --root, or set BUTTERFLY_LOGS.")
    if out is not None:
        for path in write_figure_data(out, synthetic, root):
            typer.echo(f"Figure data: {path}")


def calibrate_orbit_command(
    *,
    experiment: Annotated[
        Path, typer.Argument(help="An experiment file with control:, or a shipped one's name.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for logs and report; results/NAME if not given.", show_default=False
        ),
    ] = None,
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
    write_page(page, folder / "report.html")
    typer.echo(f"Report: {folder / 'report.html'}")


def _fit(fit: FitSummary) -> list[str]:
    return [f"{value:.1f}" for value in (fit.median, fit.mean, fit.worst)]
