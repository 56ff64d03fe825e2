"""The `butterfly model` commands: show, draw and export the robot in MuJoCo."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Annotated

import typer

from butterfly.console import show_pairs
from butterfly.experiment.named_robot import export, robot_of
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass
from butterfly.plant.twin import MASS
from butterfly.plant.watch.picture import render

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Show, draw or export the robot of an experiment, or the identified twin of a data set.",
)

SourceArgument = Annotated[
    Path,
    typer.Argument(help="An experiment file, or a data set: its manifest, folder or shipped name."),
]
RootOption = Annotated[
    Path | None,
    typer.Option(help="Folder of the logs, if not the one the manifest names.", show_default=False),
]
MassOption = Annotated[
    float,
    typer.Option(help="Mass in kg given to an identified hand; the motion does not tell it."),
]
AddedOption = Annotated[float, typer.Option("--added-mass", help="Added mass in kg.")]
ArmOption = Annotated[float, typer.Option(help="Pivot to added mass in m.")]


@app.command("show")
def show_command(
    *,
    source: SourceArgument,
    root: RootOption = None,
    mass: MassOption = MASS,
    added: AddedOption = 0.0,
    arm: ArmOption = 0.104,
) -> None:
    """Print the robot's physical and lumped parameters.

    Example: `butterfly model show quickstart --added-mass 0.05`
    """
    robot = robot_of(source, root, mass)
    carried = AddedMass(mass=added, arm=arm)
    loaded = robot.lumped.with_added_mass(carried)
    rows = {
        "hand": _numbers(robot.hand),
        "drive": _numbers(robot.drive),
        "friction": _numbers(robot.friction) or "none",
        "clutch": _numbers(robot.clutch) if robot.clutch else "rigid",
        "added mass": str(carried),
        "p1": f"{loaded.p1:.6g} kg m²",
        "p2": f"{loaded.p2:.6g} N m s/rad",
        "p3": f"{loaded.p3:.6g} N m",
        "p4": f"{loaded.p4:.6g} N m per unit of input",
        "resonance": f"{resonance_frequency(loaded):.5g} rad/s",
    }
    show_pairs(rows.items())


def _numbers(part: object) -> str:
    """Name the numbers of one part that are not at their defaults (SI units)."""
    return ", ".join(
        f"{field.name} {getattr(part, field.name):.6g}"
        for field in fields(part)  # type: ignore[arg-type]
        if getattr(part, field.name) != field.default
    )


@app.command("render")
def render_command(
    *,
    source: SourceArgument,
    out: Annotated[Path, typer.Option(help="Picture to write: .png, .jpg or .webp.")],
    angle: Annotated[float, typer.Option(help="Angle of the hand in rad.")] = 0.5,
    size: Annotated[int, typer.Option(min=16, max=4096, help="Width and height in pixels.")] = 640,
    root: RootOption = None,
    mass: MassOption = MASS,
    added: AddedOption = 0.0,
    arm: ArmOption = 0.104,
) -> None:
    """Draw the robot; needs no display where EGL is installed.

    Example: `butterfly model render quickstart --added-mass 0.05 --out hand.png`
    """
    render(robot_of(source, root, mass), AddedMass(mass=added, arm=arm), angle, out, size)
    typer.echo(f"Picture: {out}")


@app.command("export")
def export_command(
    *,
    source: SourceArgument,
    out: Annotated[Path, typer.Option(help="MJCF file to write.")],
    root: RootOption = None,
    mass: MassOption = MASS,
    added: AddedOption = 0.0,
    arm: ArmOption = 0.104,
) -> None:
    """Write the robot as one MJCF file that loads in plain MuJoCo and in its viewer.

    The input delay of an identified robot is left out: to add it, give the motor MuJoCo's `delay`,
    `nsample` and `interp`.

    Example: `butterfly model export results/quickstart --out twin.xml`
    """
    export(robot_of(source, root, mass), AddedMass(mass=added, arm=arm), out)
    typer.echo(f"Model: {out}")
