"""The `butterfly model` commands: show, draw and export the robot in MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from butterfly.api.sources import is_data
from butterfly.api.usable import require_possible
from butterfly.cli.console import say, say_verdict, show_pairs
from butterfly.cli.data_options import DataOptions, takes_data_options
from butterfly.cli.exit_codes import end_with
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.options import DATA, HandMassOption
from butterfly.errors import InputError
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.identification.estimators import Suitable
from butterfly.identification.identify import judged
from butterfly.identification.parameter import unit_of
from butterfly.logs.units import Units
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.plant.robot import HAND_MASS, Robot
from butterfly.plant.stand_alone import command_of, stand_alone
from butterfly.plant.watch.picture import render
from butterfly.report.format import field_unit
from butterfly.report.numbers.table_numbers import rests_on

if TYPE_CHECKING:
    from collections.abc import Mapping

    from butterfly.document import Told
    from butterfly.logs.log import InputKind
    from butterfly.plant.robot import Robot
    from butterfly.verdict import Level, Verdict

SourceArgument = Annotated[
    Path, typer.Argument(help=f"An experiment file or a shipped one's name, or data: {DATA}.")
]
AddedOption = Annotated[
    float,
    typer.Option("--added-mass", help="Added mass, at --arm (0.104 m if that is not given)."),
]
_ARM = 0.104  # m


@answers_in_json("model")
@takes_data_options
def show_command(
    *,
    source: SourceArgument,
    hand_mass: HandMassOption = None,
    added_mass: AddedOption = 0.0,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Print the robot's physical and lumped parameters.

    Example: `butterfly model show quickstart --added-mass 0.05`
    """
    named = _named(source, hand_mass, added_mass, options)
    robot, carried = named.robot, named.carried
    loaded = robot.lumped.with_added_mass(carried)
    rows = {
        "hand": _numbers(robot.hand),
        "drive": _numbers(robot.drive),
        "friction": _numbers(robot.friction) or "none",
        "clutch": _numbers(robot.clutch) if robot.clutch else "rigid",
        "added mass": str(carried) if carried.mass else "none",
        "p1": f"{loaded.p1:.6g} kg m²",
        "p2": f"{loaded.p2:.6g} N m s/rad",
        "p3": f"{loaded.p3:.6g} N m",
        "p4": f"{loaded.p4:.6g} {unit_of('p4', named.input_kind)}",
        "resonance": f"{resonance_frequency(loaded):.5g} rad/s",
    }
    show_pairs(rows.items())
    answer.give(named.told)
    end_with(named.level)


def _numbers(part: object) -> str:
    """Name the numbers of one part that are not at their defaults, with their units."""
    return ", ".join(
        f"{each.name} {getattr(part, each.name):.6g} {field_unit(f'part.{each.name}')}".rstrip(" –")
        for each in fields(part)  # type: ignore[arg-type]
        if getattr(part, each.name) != each.default
    )


@takes_data_options
def render_command(
    *,
    source: SourceArgument,
    out: Annotated[Path, typer.Option(help="Picture to write: .png, .jpg or .webp.")],
    angle: Annotated[float, typer.Option(help="Angle of the hand.")] = 0.5,
    size: Annotated[int, typer.Option(min=16, max=4096, help="Width and height in pixels.")] = 640,
    hand_mass: HandMassOption = None,
    added_mass: AddedOption = 0.0,
    options: DataOptions,
) -> None:
    """Draw the robot; needs no display where EGL is installed.

    Example: `butterfly model render quickstart --added-mass 0.05 --out hand.png`
    """
    named = _named(source, hand_mass, added_mass, options)
    render(named.robot, named.carried, angle, out, size)
    typer.echo(f"Picture: {out}")
    end_with(named.level)


@takes_data_options
def export_command(
    *,
    source: SourceArgument,
    out: Annotated[Path, typer.Option(help="MJCF file to write.")],
    hand_mass: HandMassOption = None,
    added_mass: AddedOption = 0.0,
    options: DataOptions,
) -> None:
    """Write the robot as one MJCF file that loads in plain MuJoCo and in its viewer.

    It moves there as it does here, the command's delay included; what MuJoCo cannot do is said.

    Example: `butterfly model export results/quickstart --out twin.xml`
    """
    named = _named(source, hand_mass, added_mass, options)
    written = stand_alone(named.robot, named.carried, **named.command)
    written.write(out)
    typer.echo(f"Model: {out}, with steps of {1e3 * written.step:g} ms")
    for said in written.left_out:
        say(said)
    end_with(named.level)


@dataclass(frozen=True, kw_only=True)
class _Named:
    """A robot, what it carries, its command, and what it rests on if it is the twin of data.

    Of the command it is what `butterfly.plant.stand_alone` takes.
    """

    name: str
    robot: Robot
    carried: AddedMass
    input_kind: InputKind
    command: Mapping[str, float]
    verdict: Verdict | None = None
    besides: dict[str, Any] = field(default_factory=dict)

    @property
    def level(self) -> Level | None:
        return None if self.verdict is None else self.verdict.level

    def told(self) -> Told:
        """Return it for programs."""
        from butterfly.report.numbers.model_numbers import told_model  # noqa: PLC0415 - slow

        return told_model(
            self.name,
            self.robot,
            self.carried,
            self.input_kind,
            verdict=self.verdict,
            besides=self.besides,
        )


def _named(source: Path, mass: float | None, added: float, options: DataOptions) -> _Named:
    """Return a robot, and print the verdict if it is the twin of data.

    Raises
    ------
    InputError
        If ``source`` is neither an experiment nor data, cannot be read, or is of a slide.
    UnusableError
        If no joint has the parameters that were identified.
    """
    path, carried = locate(source), _carried(added, options)
    if not is_data(path):
        plan = read_experiment(path)
        return _Named(
            name=plan.name,
            robot=plan.plant.robot,
            carried=carried,
            input_kind=plan.input_kind,
            command=vars(plan.plant.path),
        )
    logs = options.read(source)
    if logs.joint is JointKind.SLIDE:
        raise InputError(str(source), "joint", logs.joint, "a hinge, which the model in MuJoCo has")
    chosen = Suitable(check=False).suited(logs)
    found = judged(logs, chosen)
    verdict = require_possible(found)
    say_verdict(verdict.sentence)
    gravity = logs.logs[0].added_mass.gravity
    twin, rest = Robot.of_loaded(found.parameters, replace(carried, gravity=gravity), mass)
    if mass is None and twin.hand.mass > HAND_MASS:
        say(
            f"The hand has a mass of {twin.hand.mass:.3g} kg (--hand-mass): none of "
            f"{HAND_MASS:g} kg can have its p1 and p3, and the motion does not depend on it"
        )
    return _Named(
        name=logs.name,
        robot=twin,
        carried=rest,
        input_kind=logs.input_kind,
        command=command_of(found.parameters),
        verdict=verdict,
        besides=rests_on(logs, found, chosen),
    )


def _carried(added: float, options: DataOptions) -> AddedMass:
    told = None if options.arm is None else options.arm * Units.of(options.units).factor("arm")
    return AddedMass(mass=added, arm=_ARM if told is None else told)
