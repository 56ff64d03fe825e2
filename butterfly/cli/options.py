"""Options that several commands take, and values as NAME=VALUE by commas."""

from __future__ import annotations

import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter

from butterfly.cli.written import FOLDER, REPORT
from butterfly.errors import InputError

_ALL = "--help-all" in sys.argv

THE_FIT = Group("The fit", sort_key=2)
FIT_IN_DETAIL = Group("The fit in detail", sort_key=3, show=_ALL)
THE_DATA = Group("The data", sort_key=4)
DATA_IN_DETAIL = Group("The data in detail", sort_key=5, show=_ALL)
WRITTEN = Group("Output", sort_key=6)

Data = Annotated[Path, Parameter(name="DATA")]
"""A manifest, a folder of logs, a log, a saved result or a shipped data set's name."""

OUT = Parameter(name=("--out", "-o"), group=WRITTEN, metavar="PATH")
OutFolder = Annotated[Path | None, OUT, FOLDER]
_HAND_MASS = "Mass to write for the moving body; the motion does not depend on it. Default: chosen."
HandMass = Annotated[float | None, Parameter(metavar="kg", help=_HAND_MASS)]


@Parameter(name="*", group=WRITTEN)
@dataclass(frozen=True, kw_only=True)
class Report:
    """The HTML report of a result.

    Parameters
    ----------
    report
        Write an HTML report to this file.
    figures
        Write the report's figures as PNG and SVG too.
    """

    report: Annotated[Path | None, Parameter(name=("--report", "-r"), metavar="FILE"), REPORT] = (
        None
    )
    figures: bool = False

    def __post_init__(self) -> None:
        if self.figures and self.report is None:
            raise InputError("butterfly", "--figures", "without --report", "--report FILE as well")


NO_REPORT = Report()

Fault = Literal["duplicate", "backward", "non_finite", "unwrap"]
Pairs = Annotated[str | None, Parameter(metavar="PAIRS")]
_Detail = Parameter(group=DATA_IN_DETAIL)
_FROM = "Use each log from this time, by its own clock."
_TO = "Use each log up to this time."
_Instant = Parameter(metavar="s", allow_leading_hyphen=True)


@Parameter(name="*", group=THE_DATA)
@dataclass(frozen=True, kw_only=True)
class Facts:
    """Facts about the logs, in place of a manifest or overriding it.

    Parameters
    ----------
    columns
        Columns of time, input and angle, by name or number: time=t,input=tau,angle=q.
    units
        Units of columns, arm, mass or omega: time=ms,angle=deg. Also counts/4096, a factor, or a
        minus sign.
    input
        Kind of input. Default: voltage.
    loop
        Control loop of a servo, with --input setpoint: law=dynamixel-x,kp=400.
    arm
        Distance from pivot to added mass.
    known
        Known values, +- standard error: p4=1,p3=0.05+-0.001,resistance=2.
    zero
        Encoder reading with the joint hanging at rest: 0.1 or 0.1+-0.01.
    root
        Folder of the logs, if not the manifest's.
    intersample
        Input between samples. Default: zero_order_hold.
    repair
        Fault to repair. Repeatable.
    joint
        Joint type; a slide's angle is in m, its p1 in kg. Default: hinge.
    gravity
        Gravity normal to the joint axis; 0 for a vertical axis. Default: 9.81.
    interval
        Sampling interval of logs without a column of time.
    restarts
        Split a file where its clock restarts.
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
    interval: Annotated[float | None, _Detail, Parameter(metavar="s")] = None
    restarts: Annotated[bool, _Detail] = False

    def description(self) -> dict[str, Any]:
        """Return the given options as fields of a manifest."""
        said = {each.name: getattr(self, each.name) for each in fields(self)}
        said |= {
            name: parse_pairs(said[name], f"--{name}")
            for name in ("columns", "units", "known", "loop")
            if said[name] is not None
        }
        said["repair"] = said["repair"] or None
        said["split"] = "restarts" if said.pop("restarts") else None
        del said["root"]
        said |= {"from": said.pop("begin", None), "to": said.pop("end", None)}
        return {name: value for name, value in said.items() if value is not None}


@Parameter(name="*", group=THE_DATA)
@dataclass(frozen=True, kw_only=True)
class DataOptions(Facts):
    """The same, and which piece of a log to use."""

    begin: Annotated[float | None, _Detail, _Instant, Parameter(name="--from", help=_FROM)] = None
    end: Annotated[float | None, _Detail, _Instant, Parameter(name="--to", help=_TO)] = None


SILENT = DataOptions()


def parse_numbers(text: str | None) -> list[int] | None:
    """Read log numbers separated by commas; None stays None."""
    if text is None:
        return None
    parts = [part.strip() for part in text.split(",")]
    if not all(part.removeprefix("-").isdigit() for part in parts):
        raise InputError("--log", "number", text, "numbers from 0, separated by commas")
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
