"""The `butterfly model` commands: show, draw and export the robot in MuJoCo."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Annotated

import typer

from butterfly.cli.console import show_pairs
from butterfly.cli.data_options import DataOptions, takes_data_options
from butterfly.cli.options import DATA, MassOption
from butterfly.experiment.named_robot import export, robot_of
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass
from butterfly.plant.twin import MASS
from butterfly.plant.watch.picture import render

SourceArgument = Annotated[
    Path, typer.Argument(help=f"An experiment file or a shipped one's name, or data: {DATA}.")
]
AddedOption = Annotated[
    float,
    typer.Option("--added-mass", help="Added mass in kg, at --arm (0.104 m if that is not given)."),
]
_ARM = 0.104  # m


@takes_data_options
def show_command(
    *,
    source: SourceArgument,
    mass: MassOption = MASS,
    added: AddedOption = 0.0,
    options: DataOptions,
) -> None:
    """Print the robot's physical and lumped parameters.

    Example: `butterfly model show quickstart --added-mass 0.05`
    """
    robot = robot_of(source, mass, options.read)
    carried = _carried(added, options)
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


@takes_data_options
def render_command(
    *,
    source: SourceArgument,
    out: Annotated[Path, typer.Option(help="Picture to write: .png, .jpg or .webp.")],
    angle: Annotated[float, typer.Option(help="Angle of the hand in rad.")] = 0.5,
    size: Annotated[int, typer.Option(min=16, max=4096, help="Width and height in pixels.")] = 640,
    mass: MassOption = MASS,
    added: AddedOption = 0.0,
    options: DataOptions,
) -> None:
    """Draw the robot; needs no display where EGL is installed.

    Example: `butterfly model render quickstart --added-mass 0.05 --out hand.png`
    """
    render(robot_of(source, mass, options.read), _carried(added, options), angle, out, size)
    typer.echo(f"Picture: {out}")


@takes_data_options
def export_command(
    *,
    source: SourceArgument,
    out: Annotated[Path, typer.Option(help="MJCF file to write.")],
    mass: MassOption = MASS,
    added: AddedOption = 0.0,
    options: DataOptions,
) -> None:
    """Write the robot as one MJCF file that loads in plain MuJoCo and in its viewer.

    The input delay of an identified robot is left out: to add it, give the motor MuJoCo's `delay`,
    `nsample` and `interp`.

    Example: `butterfly model export results/quickstart --out twin.xml`
    """
    export(robot_of(source, mass, options.read), _carried(added, options), out)
    typer.echo(f"Model: {out}")


def _carried(added: float, options: DataOptions) -> AddedMass:
    return AddedMass(mass=added, arm=_ARM if options.arm is None else options.arm)
