"""Options that several commands take, and values as NAME=VALUE by commas."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from cyclopts import Group, Parameter, Token

from butterfly.cli.command_texts import FACTS
from butterfly.cli.output import FOLDER, REPORT
from butterfly.errors import InputError, nearest

if TYPE_CHECKING:
    from butterfly.identification.estimators import Estimator

_ALL = "--help-all" in sys.argv
ALL = "all"  # joints of a model

THE_FIT = Group("The fit", sort_key=2)
FIT_IN_DETAIL = Group("The fit in detail", sort_key=3, show=_ALL)
THE_DATA = Group("The data", sort_key=4)
DATA_IN_DETAIL = Group("The data in detail", sort_key=5, show=_ALL)
WRITTEN = Group("Output", sort_key=6)

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
        Write an HTML report, its numbers beside it (.json).
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

_DETAIL: Any = {"group": DATA_IN_DETAIL}


def _fact(field: str, more: str = "", **how: Any) -> Parameter:  # noqa: ANN401 - of a parameter
    """Declare the option of a manifest's field: its help begins as the field's docstring."""
    return Parameter(help=f"{FACTS[field]}. {more}".strip(), **how)


_COLUMNS = _fact("columns", "Such as time=t,input=tau,angle=q.", metavar="PAIRS")
_UNITS = _fact("units", "Such as time=ms,angle=-deg,input=counts/4096.", metavar="PAIRS")
_LOOP = _fact("loop", "With --input setpoint, such as law=dynamixel-x,kp=400.", metavar="PAIRS")
_KNOWN = _fact("known", "Such as p4=1,p3=0.05+-0.001,from=xl330.", metavar="PAIRS")
_POSE = _fact("pose", "Such as wrist=0.5,grip=0.", metavar="PAIRS", **_DETAIL)
_ZERO = _fact("zero", "Such as 0.1+-0.01.", metavar="rad", allow_leading_hyphen=True, **_DETAIL)
_ROOT = Parameter(metavar="FOLDER", help="Folder of the logs, if not the manifest's.", **_DETAIL)
_HOLD = _fact("intersample", "Default: both are compared.", **_DETAIL)
_GRAVITY = _fact("gravity", "Default: 9.81.", metavar="m/s²", **_DETAIL)
_FROM = _fact("begin", name="--from", metavar="s", allow_leading_hyphen=True, **_DETAIL)
_TO = _fact("end", name="--to", metavar="s", allow_leading_hyphen=True, **_DETAIL)
_Kind = Literal["voltage", "torque", "current", "duty", "setpoint", "none"]
_Fault = Literal["duplicate", "backward", "non_finite", "unwrap"]


def _faults(_: object, tokens: Sequence[Token]) -> tuple[str, ...]:
    """Read names of faults, separated by commas."""
    names = parse_names(",".join(token.value for token in tokens))
    for name in names:
        if name not in get_args(_Fault):
            raise ValueError(f"got {name}; expected {nearest(name, get_args(_Fault))}")
    return names


_REPAIR = _fact("repair", "Repeatable, or with commas.", converter=_faults, **_DETAIL)
_JOINT = _fact("joint", "Default: hinge.", **_DETAIL)


@Parameter(name="*", group=THE_DATA)
@dataclass(frozen=True, kw_only=True)
class Facts:
    """Facts about the logs, in place of a manifest or overriding it."""

    columns: Annotated[str | None, _COLUMNS] = None
    units: Annotated[str | None, _UNITS] = None
    input: Annotated[_Kind | None, _fact("input", "Default: voltage.")] = None
    loop: Annotated[str | None, _LOOP] = None
    arm: Annotated[float | None, _fact("arm", metavar="m")] = None
    known: Annotated[str | None, _KNOWN] = None
    model: Annotated[Path | None, _fact("model", metavar="FILE")] = None
    of: Annotated[str | None, _fact("of", "Or: all.", metavar="JOINT")] = None
    pose: Annotated[str | None, _POSE] = None
    clamped: Annotated[bool, _fact("clamped", negative="", **_DETAIL)] = False
    zero: Annotated[str | None, _ZERO] = None
    root: Annotated[Path | None, _ROOT] = None
    intersample: Annotated[Literal["zero_order_hold", "first_order_hold"] | None, _HOLD] = None
    repair: Annotated[tuple[_Fault, ...], _REPAIR] = ()
    joint: Annotated[Literal["hinge", "slide"] | None, _JOINT] = None
    gravity: Annotated[float | None, _GRAVITY] = None
    interval: Annotated[float | None, _fact("interval", metavar="s", **_DETAIL)] = None
    restarts: Annotated[bool, _fact("split", **_DETAIL)] = False

    def description(self) -> dict[str, Any]:
        """Return the given options as fields of a manifest."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        values |= {
            name: parse_pairs(values[name], f"--{name}")
            for name in ("columns", "units", "known", "loop", "pose")
            if values[name] is not None
        }
        values["repair"], values["clamped"] = values["repair"] or None, values["clamped"] or None
        values["split"] = "restarts" if values.pop("restarts") else None
        del values["root"]
        values |= {"from": values.pop("begin", None), "to": values.pop("end", None)}
        return {name: value for name, value in values.items() if value is not None}

    @property
    def names_joints(self) -> bool:
        """Whether it asks for several joints of a model."""
        return self.of is not None and (self.of == ALL or "," in self.of)

    def words(self) -> list[str]:
        """Return the given options as words of a command line."""
        names, words = {"begin": "from", "end": "to"}, list[str]()
        for field in fields(self):
            value, option = getattr(self, field.name), f"--{names.get(field.name, field.name)}"
            if value is True:
                words.append(option)
            elif value != field.default:
                several = value if isinstance(value, tuple) else (value,)
                words += [word for one in several for word in (option, str(one))]
        return words


@Parameter(name="*", group=THE_DATA)
@dataclass(frozen=True, kw_only=True)
class DataOptions(Facts):
    """The same, and which piece of a log to use."""

    begin: Annotated[float | None, _FROM] = None
    end: Annotated[float | None, _TO] = None


SILENT = DataOptions()


NAMES_OF_FIT = ("terms", "fixed", "per_mass", "per_log")
"""Options of estimators that are lists of names."""


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """A method, and options of estimators: those that are not None are given."""

    method: str

    @property
    def given(self) -> dict[str, Any]:
        """The given options, with lists of names split at commas."""
        values = {name: value for name, value in vars(self).items() if name != "method"}
        return {
            name: parse_names(value.replace(" ", "")) if name in NAMES_OF_FIT else value
            for name, value in values.items()
            if value is not None
        }

    def estimator(self) -> "Estimator":
        """Return the estimator; an unknown option raises InputError, which lists the known ones."""
        from butterfly.experiment.methods import kind_of, make_estimator  # noqa: PLC0415 - slow

        kind_of(self.method, self.given, written=lambda name: f"--{name.replace('_', '-')}")
        return make_estimator(self.method, self.given)

    def keywords(self) -> dict[str, Any]:
        """Return the given method and options, checked, as a verb takes them."""
        several = parse_names(self.method)
        if len(several) > 1:
            return {"method": several, **self.given}
        self.estimator()
        unasked = {option.name: option.default for option in fields(self)}
        return (
            self.given
            if self.method == unasked["method"]
            else {"method": self.method, **self.given}
        )


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


def parse_floats(text: str | None) -> list[float] | None:
    """Read numbers separated by commas; None stays None."""
    if text is None:
        return None
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError("--masses", "number", text, "numbers separated by commas") from None


def parse_positions(text: str) -> dict[str, float]:
    """Read NAME=NUMBER pairs separated by commas."""
    positions = {}
    for name, number in parse_pairs(text, "--pose").items():
        try:
            positions[name] = float(number)
        except ValueError:
            raise InputError("--pose", name, number, "a number in rad or m") from None
    return positions


def parse_names(text: str | None) -> tuple[str, ...]:
    """Split names separated by commas; None gives none."""
    return tuple(filter(None, map(str.strip, (text or "").split(","))))
