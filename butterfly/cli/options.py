"""Options that several commands take, and values as NAME=VALUE by commas."""

from __future__ import annotations

import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter

from butterfly.errors import InputError

_ALL = "--help-all" in sys.argv

THE_FIT = Group("The fit", sort_key=2)
FIT_IN_DETAIL = Group("The fit in detail", sort_key=3, show=_ALL)
THE_DATA = Group("The data", sort_key=4)
DATA_IN_DETAIL = Group("The data in detail", sort_key=5, show=_ALL)
WRITTEN = Group("What is written", sort_key=6)

Data = Annotated[Path, Parameter(name="DATA")]
"""A manifest, a folder of logs, a log, a saved result or a shipped data set's name."""

_EXPERIMENT = "An experiment file (YAML), or a shipped one's name."
Experiment = Annotated[Path, Parameter(name="EXPERIMENT", help=_EXPERIMENT)]

Out = Annotated[Path | None, Parameter(name=("--out", "-o"), group=WRITTEN, metavar="PATH")]
_LOG = "Numbers of the logs, from 0 on, by commas; all if not given."
_HOLDOUT = "Logs that no fit sees: names or glob patterns, by commas."
_HAND_MASS = "Mass of an identified hand; its motion does not depend on it. Chosen if not given."
LogNumbers = Annotated[str | None, Parameter(name="--log", metavar="NUMBERS", help=_LOG)]
Holdout = Annotated[str | None, Parameter(group=THE_DATA, metavar="NAMES", help=_HOLDOUT)]
HandMass = Annotated[float | None, Parameter(metavar="kg", help=_HAND_MASS)]
Limit = Annotated[int, Parameter(metavar="N")]
Page = Annotated[Path | None, Parameter(group=WRITTEN, metavar="FILE")]
Split = Literal["auto", "mass", "frequency", "log", "time"]


@Parameter(name="*", group=WRITTEN)
@dataclass(frozen=True, kw_only=True)
class Report:
    """The page of an answer.

    Parameters
    ----------
    report
        Write an HTML report to this file.
    figures
        Write its figures as PNG and SVG too, beside it.
    """

    report: Annotated[Path | None, Parameter(name=("--report", "-r"), metavar="FILE")] = None
    figures: bool = False

    def __post_init__(self) -> None:
        if self.figures and self.report is None:
            raise InputError("butterfly", "--figures", "no report", "--report FILE beside it")
        if self.report is not None and self.report.is_dir():
            expected = "a file, as report.html in it"
            raise InputError(self.report, "--report", "a folder", expected)


NO_REPORT = Report()

Fault = Literal["duplicate", "backward", "non_finite", "unwrap"]
Pairs = Annotated[str | None, Parameter(metavar="PAIRS")]
_Detail = Parameter(group=DATA_IN_DETAIL)


@Parameter(name="*", group=THE_DATA)
@dataclass(frozen=True, kw_only=True)
class DataOptions:
    """What is said of data, in place of a manifest or beside it.

    Parameters
    ----------
    columns
        What holds time, input and angle (time=X, input=Y, angle=Z): columns or variables, by name
        or number.
    units
        Units (time=ms, angle=deg): also counts/4096, or a factor; a minus turns the sign. Of arm,
        mass and omega, too.
    input
        What the logs' input commands; voltage if nothing says.
    loop
        Its loop if that is a setpoint: law=dynamixel-x,kp=400.
    arm
        Pivot to added mass.
    known
        What is known of robot, motor or hand: p4=1, p3=0.05+-0.001 (a standard uncertainty),
        resistance=2 and others.
    zero
        What the encoder reads where the hand hangs: 0.1, or 0.1+-0.01.
    root
        Folder of the logs, if not the manifest's.
    intersample
        How the input goes between samples; zero_order_hold if nothing says.
    repair
        Fault to repair; may be repeated.
    joint
        How the joint moves (a slide's angle is a way in m, its p1 a mass); hinge if nothing says.
    gravity
        Across the joint's axis: 0 for one that turns about the vertical; 9.81 if nothing says.
    begin
        First instant of the piece that is meant of a log, by its own clock.
    end
        Last instant of that piece.
    restarts
        Take a file whose clock falls back for several logs.
    """

    columns: Pairs = None
    units: Pairs = None
    input: Literal["voltage", "torque", "current", "duty", "setpoint", "none"] | None = None
    loop: Pairs = None
    arm: Annotated[float | None, Parameter(metavar="m")] = None
    known: Pairs = None
    zero: Annotated[str | None, _Detail, Parameter(metavar="rad", allow_leading_hyphen=True)] = None
    root: Annotated[Path | None, _Detail, Parameter(metavar="FOLDER")] = None
    intersample: Annotated[Literal["zero_order_hold", "first_order_hold"] | None, _Detail] = None
    repair: Annotated[tuple[Fault, ...], _Detail] = ()
    joint: Annotated[Literal["hinge", "slide"] | None, _Detail] = None
    gravity: Annotated[float | None, _Detail, Parameter(metavar="m/s²")] = None
    begin: Annotated[
        float | None, _Detail, Parameter(name="--from", metavar="s", allow_leading_hyphen=True)
    ] = None
    end: Annotated[
        float | None, _Detail, Parameter(name="--to", metavar="s", allow_leading_hyphen=True)
    ] = None
    restarts: Annotated[bool, _Detail] = False

    def description(self) -> dict[str, Any]:
        """Return what was said, by the fields of a manifest."""
        said = {each.name: getattr(self, each.name) for each in fields(self)}
        said |= {
            name: parse_pairs(said[name], f"--{name}")
            for name in ("columns", "units", "known", "loop")
            if said[name] is not None
        }
        said["repair"] = said["repair"] or None
        said["split"] = "restarts" if said.pop("restarts") else None
        del said["root"]
        return {name: value for name, value in said.items() if value is not None}


SILENT = DataOptions()


def parse_numbers(text: str | None) -> list[int] | None:
    """Read the numbers of logs, from 0 on, by commas; None stays None."""
    if text is None:
        return None
    parts = [part.strip() for part in text.split(",")]
    if not all(part.removeprefix("-").isdigit() for part in parts):
        raise InputError("--log", "number", text, "numbers from 0 on, separated by commas")
    return [int(part) for part in parts]


def parse_pairs(text: str, option: str) -> dict[str, str]:
    """Split NAME=VALUE pairs by commas; ``option`` is named where one has no ``=``."""
    pairs = [item.partition("=") for item in text.split(",")]
    if not all(separator for _, separator, _ in pairs):
        raise InputError(option, "value", text, "NAME=VALUE, separated by commas")
    return {name.strip(): value.strip() for name, _, value in pairs}


def parse_names(text: str | None) -> tuple[str, ...]:
    """Split names separated by commas; None gives none."""
    return tuple(filter(None, map(str.strip, (text or "").split(","))))
