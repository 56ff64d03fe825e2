"""Arguments and options that several commands take, and values as NAME=VALUE by commas."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from butterfly.errors import InputError
from butterfly.logs.health import Repair
from butterfly.logs.log import InputKind, Intersample
from butterfly.model.parameters import JointKind

ExperimentArgument = Annotated[
    Path, typer.Argument(help="An experiment file (YAML), or a shipped one's name.")
]
DATA = "a manifest, a folder of logs, a log, a saved result or a shipped data set's name"
"""What a user can name as data."""

DataArgument = Annotated[Path, typer.Argument(help=f"The data: {DATA}.")]

RootOption = Annotated[
    Path | None,
    typer.Option(help="Folder of the logs, if not the one the manifest names.", show_default=False),
]
ArmOption = Annotated[
    float | None,
    typer.Option(help="Pivot to added mass in m, where no manifest says it.", show_default=False),
]
InputOption = Annotated[
    InputKind,
    typer.Option("--input", help="What the logs' input commands, where no manifest says it."),
]
IntersampleOption = Annotated[
    Intersample,
    typer.Option(help="How the input is held between samples, where no manifest says it."),
]
ColumnsOption = Annotated[
    str | None,
    typer.Option(
        help="What holds time, input and angle (time=X,input=Y,angle=Z): columns of a table or "
        "variables of a .mat file, by name or number.",
        show_default=False,
    ),
]
UnitsOption = Annotated[
    str | None,
    typer.Option(
        help="Units by commas (time=ms,angle=deg, counts/4096, a factor; a minus turns the sign), "
        "also of arm, mass and omega.",
        show_default=False,
    ),
]
RepairOption = Annotated[
    list[Repair] | None,
    typer.Option(help="Fault that may be repaired; may be repeated.", show_default=False),
]

JointOption = Annotated[
    JointKind | None,
    typer.Option(
        help="How the joint moves: a slide's angle is a way in m, its p1 a mass in kg.",
        show_default="what the manifest says, or hinge",
    ),
]
GravityOption = Annotated[
    float | None,
    typer.Option(
        min=0,
        help="In m/s², across the joint's axis; 0 for a joint that turns about the vertical.",
        show_default="what the manifest says, or 9.81",
    ),
]
KnownOption = Annotated[
    str | None,
    typer.Option(
        help="What is known of the robot, by commas: parameters (p4=1, p3=0.05+-0.001 with a "
        "standard uncertainty), or motor and hand (resistance, torque_constant, hand_mass, ...).",
        show_default=False,
    ),
]

FromOption = Annotated[
    float | None,
    typer.Option(
        "--from",
        help="First instant in s, by its own clock, of the piece that is meant of a log.",
        show_default="its beginning",
    ),
]
ToOption = Annotated[
    float | None,
    typer.Option("--to", help="Last instant in s of that piece.", show_default="its end"),
]
RestartsOption = Annotated[
    bool,
    typer.Option(
        "--restarts",
        help="Take files whose clock falls back for several recordings, each a log.",
    ),
]
ZeroOption = Annotated[
    str | None,
    typer.Option(
        help="What the encoder reads in rad where the hand hangs, in place of what a manifest says "
        "or the logs tell: 0.1, or 0.1+-0.01 with a standard uncertainty.",
        show_default=False,
    ),
]

ReportOption = Annotated[
    Path | None, typer.Option(help="Write an HTML report to this file.", show_default=False)
]
FiguresOption = Annotated[
    bool,
    typer.Option("--figures", help="Write the report's figures as PNG and SVG too, beside it."),
]
PlotOption = Annotated[
    Path | None, typer.Option(help="Write a plot (HTML) to this file.", show_default=False)
]
ResultsOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help="Folder for results and report; results/NAME if not given.",
        show_default=False,
    ),
]
MassOption = Annotated[
    float,
    typer.Option(help="Mass in kg given to an identified hand; the motion does not tell it."),
]


HoldoutOption = Annotated[
    str | None,
    typer.Option(
        "--holdout",
        help="Logs that are not used for the fit, only foretold by it: names or glob patterns, by "
        "commas.",
        show_default=False,
    ),
]

SPLITS = (
    "What is left out together: one added mass; some of the sines' frequencies; some logs; a "
    "stretch of time of every log; or the first of these that suits the logs."
)
"""What `butterfly.identify.judgement.splits.Split` offers."""


def require_report(figures: bool, report: Path | None) -> None:
    """Raise InputError where figures are asked for without the report that they belong to."""
    if figures and report is None:
        raise InputError("butterfly", "--figures", "no report", "--report FILE beside it")


def parse_pairs(text: str, option: str) -> dict[str, str]:
    """Split NAME=VALUE pairs.

    Raises
    ------
    InputError
        Naming ``option``, if a pair has no ``=``.
    """
    pairs = [item.partition("=") for item in text.split(",")]
    if not all(separator for _, separator, _ in pairs):
        raise InputError(option, "value", text, "NAME=VALUE, separated by commas")
    return {name.strip(): value.strip() for name, _, value in pairs}


def parse_names(text: str | None) -> tuple[str, ...]:
    """Split names separated by commas; None gives none."""
    return tuple(filter(None, map(str.strip, (text or "").split(","))))


def parse_terms(text: str | None) -> tuple[str, ...] | None:
    """Split names separated by commas; None stays None, and an empty text gives none."""
    return None if text is None else tuple(filter(None, text.replace(" ", "").split(",")))
