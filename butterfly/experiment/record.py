"""Records of a run and of a sweep, and their JSON.

SweepRecord             the planned runs in order
RunRecord               the result of a run
  EstimateRecord        of each estimator: its estimate, or its error
  OrbitRecord           of a held orbit
    AlsoRecord          of another one of the same robot, and what both say of it
Outcome                 a run that was performed: its record, and what is not saved
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Annotated, Any, Self, cast

from pydantic import ConfigDict, PlainSerializer, PlainValidator, TypeAdapter, computed_field

from butterfly.comparison.answers import change
from butterfly.files import is_as_signed, signed
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identified import Identified
from butterfly.identification.trust import Ending, Parameter, or_none
from butterfly.logs.log import Log
from butterfly.orbit.loop import Calibration, OrbitStudy
from butterfly.orbit.online import Alarm
from butterfly.progress import current_search
from butterfly.verdict import Level

SCHEMA = 6
"""Schema of the records; records of others count as missing."""

OK, REFUSED, FAILED = "ok", "refused", "failed"
"""A run's status: done, refused for good (bad input, unidentifiable), or failed unexpectedly."""

_SCHEMA_SAID = re.compile(r'\s*\{\s*"schema":\s*(\d+)\b')  # by the first line of a record

_KeptEstimate = Annotated[
    Estimate,
    PlainValidator(Estimate.from_dict),
    PlainSerializer(lambda estimate: estimate.to_dict()),
]


class _Signed:
    """A record in its own file, with a digest that shows damage."""

    def to_json(self) -> str:
        """Return the content of its file."""
        unsigned: Any = replace(self, digest="")  # type: ignore[type-var]
        return signed(self._adapter().dump_json(unsigned, indent=1, by_alias=True).decode())

    @classmethod
    def from_json(cls, text: str) -> Self | None:
        """Read the content of a file; None if it is not a record, damaged, or of another schema."""
        schema = _SCHEMA_SAID.match(text)
        try:
            if schema is None or int(schema[1]) != SCHEMA:
                return None
            record: Any = cls._adapter().validate_json(text)
        except (ValueError, KeyError, TypeError, RecursionError):  # as ValidationError is
            return None
        if not is_as_signed(text, record.digest):
            return None
        return cast(Self, replace(record, digest=""))

    @classmethod
    @cache
    def _adapter(cls) -> TypeAdapter[Self]:
        return TypeAdapter(cls)


@dataclass(frozen=True, kw_only=True)
class EstimateRecord:
    """The result of an estimator: an estimate, or an error."""

    estimator: str  # its label
    error: str = ""  # why there is no estimate, or no held-out FIT
    estimate: _KeptEstimate | None = None
    truth: dict[str, float] | None = None  # of the estimate's parameters, where it is known
    fit: FitSummary | None = None  # FIT in per cent of the logs that it was fitted to
    held_out: FitSummary | None = None  # of what was left out in turns
    holdout: FitSummary | None = None  # of the logs that were named to be held out

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The table of the estimate; empty if there is none."""
        return () if self.estimate is None else self.estimate.table(self.truth)

    @property
    def ending(self) -> Ending:
        """How the estimation ended."""
        return Ending.REFUSED if self.estimate is None else self.estimate.ending

    @property
    def findings(self) -> tuple[str, ...]:
        """Kinds of what was found of the estimate."""
        findings = () if self.estimate is None else self.estimate.findings
        return tuple(finding.kind for finding in findings)

    @property
    def condition(self) -> float | None:
        """Condition number of the estimate; None if it is not finite."""
        return None if self.estimate is None else or_none(self.estimate.condition)

    @computed_field  # type: ignore[prop-decorator]
    @property
    def verdict(self) -> str:
        """Level of the verdict: good, use with care, or do not use."""
        return (Level.WARNING if self.estimate is None else self.estimate.level).verdict


@dataclass(frozen=True, kw_only=True)
class RoundsRecord:
    """The rounds of a calibration next to an orbit."""

    target_rad: float | None = None  # amplitude that was wanted; None if it is to turn over
    amplitudes_rad: tuple[float | None, ...] = ()  # of the rounds; None where the hand turned over
    ending: str  # why the rounds ended, in words
    reached: bool  # whether the last one came to the target within its bound
    absolute: bool  # whether the parameters are, or ratios to p1
    target_rad_s: float | None = None  # mean speed of an orbit that turns over
    speeds_rad_s: tuple[float | None, ...] = ()  # of the rounds; None where it did not turn over

    @staticmethod
    def fields_of(calibration: Calibration) -> dict[str, Any]:
        """Return the fields that a calibration has."""
        last = calibration.rounds[-1]
        reached = tuple(or_none(turn.reached) for turn in calibration.rounds)
        sizes = {"target_rad": last.orbit.size, "amplitudes_rad": reached}
        if last.orbit.direction:
            sizes = {"target_rad_s": last.orbit.size, "speeds_rad_s": reached}
        absolute = not last.recalibration.estimate.ratios
        ended = {"ending": calibration.ending, "reached": calibration.reached}
        return sizes | ended | {"absolute": absolute}


@dataclass(frozen=True, kw_only=True)
class AlsoRecord(RoundsRecord):
    """Another orbit of the same robot, and by how much its parameters differ from the first one's.

    Differences are 95 % intervals, each of one parameter alone, or of its ratio to p1.
    """

    differences: dict[str, tuple[float, float]]

    @property
    def differing(self) -> tuple[str, ...]:
        """Parameters on which both do not agree."""
        return tuple(name for name, (low, high) in self.differences.items() if low * high > 0)


@dataclass(frozen=True, kw_only=True)
class OrbitRecord(RoundsRecord):
    """A held orbit, and re-calibration next to it."""

    free_run_rms_rad: dict[str, float]  # errors of the models' free runs, by model
    # models of orbits, applied to each other: amplitudes_rad, and rms_rad by row
    cross_orbit: dict[str, tuple[float | tuple[float, ...], ...]]
    verdict: str | None = None  # on the parameters; None in records of older programs
    also: AlsoRecord | None = None
    alarms: tuple[Alarm, ...] | None = None  # changes that were noticed; None if none was watched

    @classmethod
    def of(cls, study: OrbitStudy) -> OrbitRecord:
        """Return the record of a study."""
        also = None
        if study.also is not None:
            comparison = change(study.estimate, study.also.rounds[-1].recalibration.estimate)
            differences = {p.name: p.interval for p in comparison.parameters}
            also = AlsoRecord(**cls.fields_of(study.also), differences=differences)
        return cls(
            **cls.fields_of(study.calibration),
            also=also,
            verdict=study.estimate.level.verdict,
            free_run_rms_rad=study.errors,
            alarms=None if (seen := study.watched) is None else tuple(seen.detector.alarms),
            cross_orbit={
                "amplitudes_rad": study.amplitudes,
                "rms_rad": tuple(tuple(row) for row in study.cross.tolist()),
            },
        )


@dataclass(frozen=True, kw_only=True)
class RunRecord(_Signed):
    """The result of a run."""

    __pydantic_config__ = ConfigDict(ser_json_inf_nan="strings")  # JSON has no NaN

    schema: int = SCHEMA
    key: str = ""  # its address
    status: str  # OK, REFUSED or FAILED
    error: str = ""  # why it is not OK
    seed: int
    overrides: dict[str, Any] = field(default_factory=dict)  # that set it apart in its sweep
    repetition: int = 0
    logs: int = 0  # how many it simulated
    estimates: tuple[EstimateRecord, ...] = ()
    orbit: OrbitRecord | None = None
    stopped_after: float | None = None  # seconds of searching, where these were too few
    versions: dict[str, str] = field(default_factory=dict)  # of what it was made with
    seconds: dict[str, float] = field(default_factory=dict)  # that it took, by part
    files: dict[str, str] = field(default_factory=dict)  # digests of those beside it, by name
    digest: str = ""  # of the rest of its file, which tells whether that is as it was written

    @property
    def reason(self) -> str:
        """Error of the run, or the first error of an estimator; empty if none."""
        errors = [
            f"{record.estimator}: {record.error}" for record in self.estimates if record.error
        ]
        return self.error or next(iter(errors), "")

    @property
    def stays(self) -> bool:
        """Whether a repetition would give the same: it did not fail or stop its search early."""
        searched = math.inf if self.stopped_after is None else self.stopped_after
        return self.status != FAILED and searched >= current_search().seconds

    @property
    def unconverged(self) -> int:
        """Number of estimates that did not converge."""
        return sum(record.ending is Ending.STOPPED for record in self.estimates)

    @property
    def verdict(self) -> str | None:
        """The worst verdict on its estimates, including the orbit; None without estimates."""
        levels = [record.estimate.level for record in self.estimates if record.estimate is not None]
        if self.orbit is not None and self.orbit.verdict is not None:
            levels.append(Level.of_verdict(self.orbit.verdict))
        return Level.worst(levels).verdict if levels else None


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A run that was performed: its record, and what the process has besides."""

    record: RunRecord
    files: Mapping[str, bytes] = field(default_factory=dict)  # contents of its files, by name
    logs: tuple[Log, ...] = ()  # simulated, in order
    identifications: Mapping[str, Identified] = field(default_factory=dict)  # by estimators' labels
    orbit: OrbitStudy | None = None
    error: Exception | None = None  # what ended it early, or why there is no result

    @property
    def sent(self) -> Outcome:
        """What a worker replies: the record and the files."""
        return Outcome(record=self.record, files=self.files)


@dataclass(frozen=True, kw_only=True)
class SweepRun:
    """One run of a sweep: its place, the address of its result, and its varied fields."""

    number: int  # in the sweep's order, from 0 on
    key: str
    repetition: int  # from 0 on
    seed: int
    overrides: dict[str, Any]  # fields that it sets, by their paths


@dataclass(frozen=True, kw_only=True)
class Task(SweepRun):
    """A run to perform: all that a worker needs except the tables."""

    content: dict[str, Any]  # the experiment without its sweep; digests stand for tables of files

    def failed(self, error: str) -> Outcome:
        """Return the outcome without a reply."""
        record = RunRecord(
            key=self.key,
            status=FAILED,
            error=error,
            seed=self.seed,
            overrides=self.overrides,
            repetition=self.repetition,
        )
        return Outcome(record=record)


@dataclass(frozen=True, kw_only=True)
class SweepRecord(_Signed):
    """The plan of a sweep."""

    schema: int = SCHEMA
    name: str
    description: str
    seed: int
    worst: int  # how many of the worst runs the report lists
    fields: tuple[str, ...]  # paths of those that vary
    versions: dict[str, str]  # of what it was planned with
    runs: tuple[SweepRun, ...]  # in order; of tasks only what is one's place is kept
    output_digests: dict[str, str] | None = (
        None  # digests of its one run's logs and reports; None of more
    )
    tables: dict[str, str] = field(default_factory=dict)  # digests of the tables, by name
    digest: str = ""  # as a run's


def origin_of(text: str) -> str:
    """Describe a file that is not a current record, by its own schema and version."""
    try:
        content = json.loads(text)
        schema, version = int(content["schema"]), str(content["versions"]["butterfly"])
    except (ValueError, KeyError, TypeError, RecursionError):
        return "no record"
    if schema == SCHEMA:
        return "a damaged record"
    return f"schema {schema} of butterfly {version}"
