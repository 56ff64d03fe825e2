"""Options of the verbs, as their commands take them.

Made by `make commands`: what is changed here is overwritten.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypedDict

from cyclopts import Parameter

from butterfly.cli.options import OUT, THE_DATA, WRITTEN, parse_floats, parse_names, parse_numbers
from butterfly.cli.output import FOLDER


class InspectKeywords(TypedDict):
    """Keywords of `butterfly.inspect`."""

    logs: Sequence[int] | None
    added_mass: float


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OptionsOfInspect:
    """Options of `butterfly inspect`.

    Parameters
    ----------
    logs
        Numbers of the logs, from 0, shown without a forecast. Separated by commas. Default: all.
    added_mass
        Added mass in kg of the robot of an experiment or saved result, at arm (0.104 m).
    """

    logs: Annotated[str | None, Parameter(metavar="NUMBERS", name="--log")] = None
    added_mass: Annotated[float, Parameter(metavar="kg")] = 0.0

    def keywords(self) -> InspectKeywords:
        """Return them as `butterfly.inspect` takes them."""
        return {"logs": parse_numbers(self.logs), "added_mass": self.added_mass}


INSPECT = OptionsOfInspect()


class IdentifyKeywords(TypedDict):
    """Keywords of `butterfly.identify`."""

    holdout: Sequence[str]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OptionsOfIdentify:
    """Options of `butterfly identify`.

    Parameters
    ----------
    holdout
        Names or glob patterns of held-out logs: predicted, never fitted. Separated by commas.
    """

    holdout: Annotated[str | None, Parameter(metavar="NAMES", group=THE_DATA)] = None

    def keywords(self) -> IdentifyKeywords:
        """Return them as `butterfly.identify` takes them."""
        return {"holdout": parse_names(self.holdout)}


IDENTIFY = OptionsOfIdentify()


class SelectKeywords(TypedDict):
    """Keywords of `butterfly.select`."""

    candidates: Sequence[str]
    holdout: Sequence[str]
    nested: bool


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OptionsOfSelect:
    """Options of `butterfly select`.

    Parameters
    ----------
    candidates
        Terms to choose from. Separated by commas.
    holdout
        Names or glob patterns of held-out logs: predicted, never fitted. Separated by commas.
    nested
        Nested cross-validation: repeats the choice without each held-out part, for an unbiased FIT
        (slow).
    """

    candidates: Annotated[str | None, Parameter(metavar="NAMES")] = (
        "drag,load,bias,p3_offset,stribeck"
    )
    holdout: Annotated[str | None, Parameter(metavar="NAMES", group=THE_DATA)] = None
    nested: bool = False

    def keywords(self) -> SelectKeywords:
        """Return them as `butterfly.select` takes them."""
        return {
            "candidates": parse_names(self.candidates),
            "holdout": parse_names(self.holdout),
            "nested": self.nested,
        }


SELECT = OptionsOfSelect()


class DesignKeywords(TypedDict):
    """Keywords of `butterfly.design`."""

    goal: float | str
    duration: float
    command: float | None
    swing: float | None
    price: float


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OptionsOfDesign:
    """Options of `butterfly design`.

    Parameters
    ----------
    goal
        Half-width of the 95 % intervals of p1..p4 and Coulomb friction, over their values. For
        friction, or a gravity moment, close to 0 the whole interval has to be below this share of
        the largest torque.
    duration
        Length of a run in s; of a servo at most that of its logs.
    command
        Largest command, in units of the input. Default: the largest one logged.
    swing
        Largest allowed swing in rad (m on a slide). Default: 1; on a slide or servo, the logs'
        largest.
    price
        What a change of mass costs, in s of robot time.
    """

    goal: Annotated[float | str, Parameter(metavar="SHARE")] = "1%"
    duration: Annotated[float, Parameter(metavar="s")] = 40.0
    command: Annotated[float | None, Parameter(metavar="VALUE")] = None
    swing: Annotated[float | None, Parameter(metavar="rad")] = None
    price: Annotated[float, Parameter(metavar="s")] = 120.0

    def keywords(self) -> DesignKeywords:
        """Return them as `butterfly.design` takes them."""
        return {
            "goal": self.goal,
            "duration": self.duration,
            "command": self.command,
            "swing": self.swing,
            "price": self.price,
        }


DESIGN = OptionsOfDesign()


class ValidateKeywords(TypedDict):
    """Keywords of `butterfly.validate`."""

    split: str
    folds: int | None
    holdout: Sequence[str]
    bootstrap: int


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OptionsOfValidate:
    """Options of `butterfly validate`.

    Parameters
    ----------
    split
        What to hold out at a time: an added mass (mass), sine frequencies (frequency), logs (log),
        a section of every log (time), or the first of these that the data allow (auto).
    folds
        Number of parts for frequency, log and time. Default: 5, or fewer if the data require it.
    holdout
        Names or glob patterns of held-out logs: predicted, never fitted. Separated by commas.
    bootstrap
        Number of bootstrap samples of the logs, for 95 % intervals.
    """

    split: Literal["auto", "mass", "frequency", "log", "time"] = "auto"
    folds: Annotated[int | None, Parameter(metavar="N")] = None
    holdout: Annotated[str | None, Parameter(metavar="NAMES", group=THE_DATA)] = None
    bootstrap: Annotated[int, Parameter(metavar="N")] = 0

    def keywords(self) -> ValidateKeywords:
        """Return them as `butterfly.validate` takes them."""
        return {
            "split": self.split,
            "folds": self.folds,
            "holdout": parse_names(self.holdout),
            "bootstrap": self.bootstrap,
        }


VALIDATE = OptionsOfValidate()


class ResidualKeywords(TypedDict):
    """Keywords of `butterfly.residual`."""

    logs: Sequence[int] | None
    holdout: Sequence[str]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OptionsOfResidual:
    """Options of `butterfly residual`.

    Parameters
    ----------
    logs
        Numbers of the logs to show, from 0. Separated by commas. Default: all.
    holdout
        Names or glob patterns of held-out logs: predicted, never fitted. Separated by commas.
    """

    logs: Annotated[str | None, Parameter(metavar="NUMBERS", name="--log")] = None
    holdout: Annotated[str | None, Parameter(metavar="NAMES", group=THE_DATA)] = None

    def keywords(self) -> ResidualKeywords:
        """Return them as `butterfly.residual` takes them."""
        return {"logs": parse_numbers(self.logs), "holdout": parse_names(self.holdout)}


RESIDUAL = OptionsOfResidual()


class PredictKeywords(TypedDict):
    """Keywords of `butterfly.predict`."""

    draws: int
    seed: int


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OptionsOfPredict:
    """Options of `butterfly predict`.

    Parameters
    ----------
    draws
        Number of parameter draws, for the bands and the command's --out.
    seed
        Random seed.
    """

    draws: Annotated[int, Parameter(metavar="N")] = 200
    seed: Annotated[int, Parameter(metavar="N")] = 0

    def keywords(self) -> PredictKeywords:
        """Return them as `butterfly.predict` takes them."""
        return {"draws": self.draws, "seed": self.seed}


PREDICT = OptionsOfPredict()


class CompareKeywords(TypedDict):
    """Keywords of `butterfly.compare`."""

    logs: Sequence[int] | None
    holdout: Sequence[str]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OptionsOfCompare:
    """Options of `butterfly compare`.

    Parameters
    ----------
    logs
        Numbers of the logs to show, from 0. Separated by commas. Default: all.
    holdout
        Names or glob patterns of held-out logs: predicted, never fitted. Separated by commas.
    """

    logs: Annotated[str | None, Parameter(metavar="NUMBERS", name="--log")] = None
    holdout: Annotated[str | None, Parameter(metavar="NAMES", group=THE_DATA)] = None

    def keywords(self) -> CompareKeywords:
        """Return them as `butterfly.compare` takes them."""
        return {"logs": parse_numbers(self.logs), "holdout": parse_names(self.holdout)}


COMPARE = OptionsOfCompare()


class RunKeywords(TypedDict):
    """Keywords of `butterfly.run`."""

    out: Path | None
    figures: bool
    jobs: int | None
    force: bool
    only: str | None
    engine: Literal["local", "dask"]
    scheduler: str | None


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OptionsOfRun:
    """Options of `butterfly run`.

    Parameters
    ----------
    out
        Folder for results and report. Default: results/NAME.
    figures
        Write the report's figures as PNG and SVG too.
    jobs
        Worker processes of a sweep, or threads of a single run. Default: one per core.
    force
        Repeat finished runs.
    only
        Numbers of the runs to do, such as 0,3,10-19. Default: all.
    engine
        Where a sweep runs; dask needs butterfly-testbed[dask].
    scheduler
        Address of a Dask scheduler, such as tcp://HOST:8786. Default: a local cluster.
    """

    out: Annotated[Path | None, OUT, FOLDER] = None
    figures: Annotated[bool, Parameter(group=WRITTEN)] = False
    jobs: Annotated[int | None, Parameter(metavar="N")] = None
    force: bool = False
    only: Annotated[str | None, Parameter(metavar="NUMBERS")] = None
    engine: Literal["local", "dask"] = "local"
    scheduler: Annotated[str | None, Parameter(metavar="ADDRESS")] = None

    def keywords(self) -> RunKeywords:
        """Return them as `butterfly.run` takes them."""
        return {
            "out": self.out,
            "figures": self.figures,
            "jobs": self.jobs,
            "force": self.force,
            "only": self.only,
            "engine": self.engine,
            "scheduler": self.scheduler,
        }


RUN = OptionsOfRun()


class CampaignKeywords(TypedDict):
    """Keywords of `butterfly.campaign`."""

    out: Path | None
    goal: float | str
    masses: Sequence[float] | None
    arm: float
    command: float | None
    angle: float
    speed: float | None
    current: float | None
    seconds: float
    price: float
    model: Path | None
    of: str | None
    clamped: bool


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OptionsOfCampaign:
    """Options of `butterfly campaign`.

    Parameters
    ----------
    out
        Folder for logs, manifest and report: new, empty, or that of the campaign to continue.
        Default: campaign.
    goal
        Half-width of the 95 % intervals of p1..p4 and Coulomb friction, over their values. For
        friction, or a gravity moment, close to 0 the whole interval has to be below this share of
        the largest torque.
    masses
        Masses at hand in kg, the mounted one first. Separated by commas. Default: those of the
        experiment, or none.
    arm
        Distance of these masses from the pivot in m.
    command
        Largest command, in units of the input. Default: that of the experiment.
    angle
        Largest angle from rest in rad.
    speed
        Largest speed, in rad/s. Default: any.
    current
        Largest current in A, where one is read. Default: any.
    seconds
        Largest robot time in s.
    price
        What a change of mass costs, in s of robot time.
    model
        MJCF or URDF of the robot. It gives the joint's gravity, and bounds command and angle by its
        effort and range. The motor's angles are those of the file.
    of
        Name of the joint in that model.
    clamped
        Whether the other joints of that model are clamped: a campaign records none of them.
    """

    out: Annotated[Path | None, OUT, FOLDER] = None
    goal: Annotated[float | str, Parameter(metavar="SHARE")] = "1%"
    masses: Annotated[str | None, Parameter(metavar="NUMBERS")] = None
    arm: Annotated[float, Parameter(metavar="m")] = 0.0
    command: Annotated[float | None, Parameter(metavar="VALUE")] = None
    angle: Annotated[float, Parameter(metavar="rad")] = 1.0
    speed: Annotated[float | None, Parameter(metavar="rad/s")] = None
    current: Annotated[float | None, Parameter(metavar="A")] = None
    seconds: Annotated[float, Parameter(metavar="s")] = 600.0
    price: Annotated[float, Parameter(metavar="s")] = 120.0
    model: Path | None = None
    of: str | None = None
    clamped: bool = False

    def keywords(self) -> CampaignKeywords:
        """Return them as `butterfly.campaign` takes them."""
        return {
            "out": self.out,
            "goal": self.goal,
            "masses": parse_floats(self.masses),
            "arm": self.arm,
            "command": self.command,
            "angle": self.angle,
            "speed": self.speed,
            "current": self.current,
            "seconds": self.seconds,
            "price": self.price,
            "model": self.model,
            "of": self.of,
            "clamped": self.clamped,
        }


CAMPAIGN = OptionsOfCampaign()
