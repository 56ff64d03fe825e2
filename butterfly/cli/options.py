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
    typer.Option(help="Folder of the logs, if not the manifest's.", show_default=False),
]
ArmOption = Annotated[
    float | None,
    typer.Option(help="Pivot to added mass, where no manifest says.", show_default=False),
]
InputOption = Annotated[
    InputKind,
    typer.Option(
        "--input", help="What the logs' input commands, voltage or torque, where no manifest says."
    ),
]
IntersampleOption = Annotated[
    Intersample,
    typer.Option(
        help="How the input goes between samples, where no manifest says: zero_order_hold or "
        "first_order_hold."
    ),
]
ColumnsOption = Annotated[
    str | None,
    typer.Option(
        help="What holds time, input and angle (time=X, input=Y, angle=Z; by commas): columns or "
        "variables, by name or number.",
        show_default=False,
    ),
]
UnitsOption = Annotated[
    str | None,
    typer.Option(
        help="Units, by commas (time=ms, angle=deg): also counts/4096, or a factor; a minus turns "
        "the sign. Of arm, mass and omega, too.",
        show_default=False,
    ),
]
RepairOption = Annotated[
    list[Repair] | None,
    typer.Option(
        help="Fault to repair: duplicate, backward, non_finite or unwrap; may be repeated.",
        show_default=False,
    ),
]

JointOption = Annotated[
    JointKind | None,
    typer.Option(
        help="How the joint moves, hinge or slide (its angle is a way in m, its p1 a mass); hinge "
        "if no manifest says.",
        show_default=False,
    ),
]
GravityOption = Annotated[
    float | None,
    typer.Option(
        min=0,
        help="Across the joint's axis: 0 for one that turns about the vertical; 9.81 if no "
        "manifest says.",
        show_default=False,
    ),
]
KnownOption = Annotated[
    str | None,
    typer.Option(
        help="What is known of the robot, by commas: p4=1, or p3=0.05+-0.001 (a standard "
        "uncertainty); or of motor and hand: resistance, torque_constant, hand_mass and others.",
        show_default=False,
    ),
]

FromOption = Annotated[
    float | None,
    typer.Option(
        "--from",
        help="First instant of the piece that is meant of a log, by its own clock.",
        show_default=False,
    ),
]
ToOption = Annotated[
    float | None,
    typer.Option("--to", help="Last instant of that piece.", show_default=False),
]
RestartsOption = Annotated[
    bool,
    typer.Option(
        "--restarts",
        help="Take a file whose clock falls back for several logs.",
    ),
]
ZeroOption = Annotated[
    str | None,
    typer.Option(
        help="What the encoder reads where the hand hangs, if not what a manifest or the logs "
        "tell: 0.1, or 0.1+-0.01.",
        show_default=False,
    ),
]

ReportOption = Annotated[
    Path | None, typer.Option(help="Write an HTML report to this file.", show_default=False)
]
FiguresOption = Annotated[
    bool,
    typer.Option("--figures", help="Write its figures as PNG and SVG too, beside it."),
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
HandMassOption = Annotated[
    float | None,
    typer.Option(
        "--hand-mass",
        help="Mass of an identified hand; its motion does not depend on it. Chosen if not given.",
    ),
]
LimitOption = Annotated[int, typer.Option("--limit", min=1, help="Rows to print, at most.")]
LogOption = Annotated[
    str | None,
    typer.Option("--log", help="Numbers of the logs, from 0 on, by commas.", show_default="all"),
]


HoldoutOption = Annotated[
    str | None,
    typer.Option(
        "--holdout",
        help="Logs that no fit sees: names or glob patterns, by commas.",
        show_default=False,
    ),
]

SPLITS = (
    "What is left out together: one added mass (mass), some of the sines' frequencies (frequency), "
    "some logs (log), a stretch of every log (time), or the first of these that suits (auto)."
)
"""What `butterfly.identification.splits.Split` offers."""


def picked(numbers: str | None, count: int) -> list[int]:
    """Read the numbers of logs (see `LogOption`); all of them if none are given.

    Raises
    ------
    InputError
        If one is no number of a log, of which there are ``count``.
    """
    if numbers is None:
        return list(range(count))
    parts = [part.strip() for part in numbers.split(",")]
    for part in parts:
        if not (part.isdigit() and int(part) < count):
            raise InputError("--log", "number", part, f"numbers from 0 to {count - 1}")
    return [int(part) for part in parts]


def require_report(figures: bool, report: Path | None) -> None:
    """Raise InputError where a report cannot be a file, or figures lack theirs: before the work."""
    if figures and report is None:
        raise InputError("butterfly", "--figures", "no report", "--report FILE beside it")
    if report is not None and report.is_dir():
        raise InputError(report, "--report", "a folder", "a file, as report.html in it")


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
