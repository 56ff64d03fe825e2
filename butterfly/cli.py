"""The commands; the work is done elsewhere."""

from __future__ import annotations

import sys
from pathlib import Path  # noqa: TC003 - typer reads annotations
from typing import Annotated

import typer

from butterfly import (
    __version__,
    compare_commands,
    results_commands,
    run_commands,
    study_commands,
)
from butterfly.arguments import ReportOption, RootOption, parse_pairs, parse_parameters
from butterfly.console import show_identification, show_pairs, show_progress
from butterfly.errors import ButterflyError, InputError
from butterfly.estimator_options import takes_estimator
from butterfly.identify.data import read_data_set
from butterfly.identify.estimators import Estimator  # noqa: TC001 - typer reads annotations
from butterfly.identify.identification import identify
from butterfly.identify.physical import INSEPARABLE, PendulumEstimate, physical_hand
from butterfly.logs.formats import ENDINGS, read_log
from butterfly.logs.health import DEFAULT_REPAIRS, Repair, examine
from butterfly.logs.log import InputKind, Intersample
from butterfly.logs.manifest import (
    MANIFEST_NAME,
    Manifest,
    manifest_from_names,
    read_manifest,
    write_manifest,
)
from butterfly.model_commands import app as model_commands
from butterfly.report.identification import write_report
from butterfly.report.inspection import health_rows, write_inspection
from butterfly.resources import locate
from butterfly.view_commands import video_command, view_command

EXIT_BAD_INPUT = 2

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    help="Simulate and identify the Butterfly robot's hand: MuJoCo, grey-box model, real logs.",
    epilog="Start with: `butterfly run quickstart`",
)
app.add_typer(model_commands, name="model")
run_commands.register(app)
study_commands.register(app)
compare_commands.register(app)
app.add_typer(results_commands.app, name="results")
app.command("view")(view_command)
app.command("video")(video_command)

ArmOption = Annotated[
    float | None,
    typer.Option(
        help="Pivot to added mass in m, for a folder without manifest.", show_default=False
    ),
]
InputOption = Annotated[
    InputKind,
    typer.Option("--input", help="What the logs' input commands, for a folder without manifest."),
]
HoldOption = Annotated[
    Intersample,
    typer.Option(
        "--intersample",
        help="How the input is held between samples, for a folder without manifest.",
    ),
]


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        typer.echo(f"butterfly {__version__}")
        raise typer.Exit


@app.command("identify")
@takes_estimator()
def identify_command(
    *,
    data: Annotated[Path, typer.Argument(help="A data-set manifest (YAML), or a folder of logs.")],
    estimator: Estimator,
    report: ReportOption = None,
    root: RootOption = None,
    arm: ArmOption = None,
    input_kind: InputOption = InputKind.VOLTAGE,
    hold: HoldOption = Intersample.ZERO_ORDER_HOLD,
    against: Annotated[
        list[str] | None,
        typer.Option(
            help="Other parameters to simulate the same logs with: p1=…,p2=…,p3=… and, if wanted, "
            "p4=…,coulomb=…,delay=…; without p4 the best one is used. May be repeated.",
            show_default=False,
        ),
    ] = None,
    hand_mass: Annotated[
        float | None,
        typer.Option(
            help="Mass of the hand in kg, if it was weighed: separates its inertia and centre of "
            "mass (83).",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Identify the robot from a data set.

    Prints the parameters with standard errors and intervals, how far to trust them, and how well
    a free-run simulation with them follows every log (FIT). A folder without manifest.yaml needs
    --arm, and files named like Data_120_5__3_5__0015.mat (120.5 g, 3.5 rad/s, amplitude 0.015).

    Try `butterfly identify results/quickstart` after `butterfly run quickstart`, or
    `butterfly identify real-logs --root LOGS --report report.html`.
    """
    manifest = _manifest(data, root, arm, input_kind, hold)
    others = {text: parse_parameters(text, "--against") for text in against or []}
    read = read_data_set(manifest, show_progress)
    result = identify(read, estimator, against=others, track=show_progress)
    show_identification(result)
    if hand_mass is not None:
        hand = physical_hand(PendulumEstimate.of(result.estimate), hand_mass)
        show_pairs(
            [
                ("centre of mass", f"{hand.com_distance:.4g} ± {hand.com_distance_error:.2g} m"),
                ("inertia about it", f"{hand.inertia:.4g} ± {hand.inertia_error:.2g} kg m²"),
            ]
        )
        typer.echo(INSEPARABLE)
    if report is not None:
        write_report(result, report)
        typer.echo(f"Report: {report}")


@app.command("inspect")
def inspect_command(
    log: Annotated[Path, typer.Argument(help=f"A log: {ENDINGS}.")],
    columns: Annotated[
        str | None,
        typer.Option(
            help="Columns of a .csv file, as time=NAME,input=NAME,angle=NAME.", show_default=False
        ),
    ] = None,
    repair: Annotated[
        list[Repair] | None,
        typer.Option(
            help="Fault to repair by dropping samples; may be repeated.", show_default=False
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Write a plot (HTML) to this file.", show_default=False)
    ] = None,
) -> None:
    """Check one log: clock, gaps, saturation, clipping, and the dominant frequency.

    Example: `butterfly inspect Data_52__8__002.mat --plot log.html`
    """
    pairs = None if columns is None else parse_pairs(columns, "--columns")
    recorded = read_log(log, pairs, input_kind=InputKind.VOLTAGE)
    clean, health = examine(recorded, DEFAULT_REPAIRS | frozenset(repair or ()))
    typer.echo(log)
    show_pairs(health_rows(clean, health))
    if plot is not None:
        write_inspection(clean, health, plot)
        typer.echo(f"Plot: {plot}")


@app.command("manifest")
def manifest_command(
    folder: Annotated[Path, typer.Argument(help="Folder of logs named like Data_52__8__002.mat.")],
    arm: Annotated[float, typer.Option(help="Pivot to added mass in m.")],
    input_kind: InputOption = InputKind.VOLTAGE,
    hold: HoldOption = Intersample.ZERO_ORDER_HOLD,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Manifest to write; FOLDER/manifest.yaml if not given.", show_default=False
        ),
    ] = None,
) -> None:
    """Generate a data-set manifest from the names of the log files, to edit and keep."""
    path = out or folder / MANIFEST_NAME
    manifest = manifest_from_names(folder, arm=arm, input_kind=input_kind, intersample=hold)
    if out is None:
        manifest = manifest.model_copy(update={"root": "."})
    write_manifest(manifest, path)
    typer.echo(f"Manifest of {len(manifest.logs)} logs: {path}")


def main() -> None:
    """Run the command line; bad input ends in one line on stderr and exit code 2."""
    try:
        app()
    except ButterflyError as error:
        typer.secho(f"error: {' '.join(str(error).split())}", fg="red", err=True)
        sys.exit(EXIT_BAD_INPUT)


def _manifest(
    data: Path, root: Path | None, arm: float | None, input_kind: InputKind, hold: Intersample
) -> Manifest:
    path = locate(data)
    if path.is_file():
        return read_manifest(path, root)
    if (path / MANIFEST_NAME).exists():
        return read_manifest(path / MANIFEST_NAME, root)
    if arm is None:
        raise InputError(
            path,
            MANIFEST_NAME,
            "no such file",
            "a manifest, or --arm and files named by the pattern",
        )
    return manifest_from_names(path, arm=arm, input_kind=input_kind, intersample=hold)
