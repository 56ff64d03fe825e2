"""What is kept of a run and of a sweep: typed records, and their JSON.

SweepRecord             what was asked: the runs in order
RunRecord               what a run gave
  EstimateRecord        of each estimator
    ParameterRecord     of each parameter
  OrbitRecord           of an orbit that was held
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError

from butterfly.identify.findings import Ending, Finding
from butterfly.identify.predict import FitSummary  # noqa: TC001 - pydantic reads annotations

if TYPE_CHECKING:
    from collections.abc import Mapping

    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.model.parameters import LumpedParameters
    from butterfly.orbit.study import OrbitStudy

SCHEMA = 2
"""Of the records; one with another number counts as none."""

OK, REFUSED, FAILED = "ok", "refused", "failed"
"""A run's status: done, refused for good (bad input, unidentifiable), or failed unexpectedly."""

_Record = TypeVar("_Record")
_CONFIG = ConfigDict(ser_json_inf_nan="strings")  # JSON has no NaN


@dataclass(frozen=True, kw_only=True)
class ParameterRecord:
    """One parameter of an estimate; None where there is nothing to say.

    Parameters
    ----------
    parameter
        Its name.
    value, standard_error, lower, upper
        Estimate, and limits of its 95 % interval.
    least_left_out, largest_left_out
        Range of the estimates that leave the logs of one added mass out.
    true
        Where it is known.
    on_bound
        Whether a bound holds it.
    """

    parameter: str
    value: float
    standard_error: float | None
    lower: float | None
    upper: float | None
    least_left_out: float | None = None
    largest_left_out: float | None = None
    true: float | None = None
    on_bound: bool = False

    @classmethod
    def all_of(
        cls, found: ParameterEstimate, truth: LumpedParameters | None = None
    ) -> tuple[ParameterRecord, ...]:
        """Return a record for each parameter of an estimate, beside the truth if it is known."""
        columns = (found.values, found.standard_errors, found.lower, found.upper)
        rows = zip(found.names, *(column.tolist() for column in columns), strict=True)
        records = []
        for k, (name, value, error, lower, upper) in enumerate(rows):
            others = [float(values[k]) for values in found.left_out.values()]
            records.append(
                cls(
                    parameter=name,
                    value=value,
                    standard_error=_or_none(error),
                    lower=_or_none(lower),
                    upper=_or_none(upper),
                    least_left_out=min(others, default=None),
                    largest_left_out=max(others, default=None),
                    true=None if truth is None else float(getattr(truth, name)),
                    on_bound=name in found.on_bound,
                )
            )
        return tuple(records)

    @property
    def deviation(self) -> float | None:
        """Relative deviation from the truth, where that is known and not 0."""
        return self.value / self.true - 1 if self.true else None

    def numbers(self) -> dict[str, float | None]:
        """Return what a report says of it, for programs."""
        names = ("value", "standard_error", "lower", "upper", "true")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, kw_only=True)
class EstimateRecord:
    """What an estimator gave.

    Parameters
    ----------
    estimator
        Its label.
    ending
        How it came to its values, or that it refused.
    error
        Why there are none, or no held-out FIT.
    parameters
        The estimate; empty if there is none.
    condition
        Condition number of its regression.
    findings
        What to know about it.
    fit, held_out
        FIT in per cent, of the logs it was fitted to and of those left out.
    """

    estimator: str
    ending: Ending
    error: str = ""
    parameters: tuple[ParameterRecord, ...] = ()
    condition: float | None = None
    findings: tuple[Finding, ...] = ()
    fit: FitSummary | None = None
    held_out: FitSummary | None = None

    @classmethod
    def of(
        cls, estimator: str, found: ParameterEstimate, fit: FitSummary, truth: LumpedParameters
    ) -> EstimateRecord:
        """Return the record of an estimate."""
        return cls(
            estimator=estimator,
            ending=found.ending,
            parameters=ParameterRecord.all_of(found, truth),
            condition=_or_none(found.condition),
            findings=found.findings,
            fit=fit,
        )

    @property
    def converged(self) -> bool:
        """Whether the values are where the estimator wanted to be."""
        return self.ending is Ending.CONVERGED


@dataclass(frozen=True, kw_only=True)
class CrossRecord:
    """Models of orbits, used at each other's: amplitudes in rad, rms errors in rad by row."""

    amplitudes_rad: tuple[float, ...]
    rms_rad: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, kw_only=True)
class OrbitRecord:
    """An orbit that was held, and the re-calibration next to it.

    Parameters
    ----------
    target_rad
        Amplitude that was wanted.
    amplitudes_rad
        Those that the rounds came to; None where the hand turned over.
    ending
        Why the rounds ended, in words.
    absolute
        Whether the parameters are, or ratios to p1.
    parameters
        Of the last round.
    free_run_rms_rad
        Errors of the models' free runs, by model.
    cross_orbit
        Errors of models at each other's orbits.
    """

    target_rad: float
    amplitudes_rad: tuple[float | None, ...]
    ending: str
    absolute: bool
    parameters: tuple[ParameterRecord, ...]
    free_run_rms_rad: dict[str, float]
    cross_orbit: CrossRecord

    @classmethod
    def of(cls, study: OrbitStudy) -> OrbitRecord:
        """Return the record of a study."""
        rounds = study.calibration.rounds
        last = rounds[-1].recalibration
        return cls(
            target_rad=rounds[-1].wanted,
            amplitudes_rad=tuple(_or_none(each.amplitude) for each in rounds),
            ending=study.calibration.ending,
            absolute=last.is_absolute,
            parameters=ParameterRecord.all_of(last.estimate),
            free_run_rms_rad=study.errors,
            cross_orbit=CrossRecord(
                amplitudes_rad=study.amplitudes,
                rms_rad=tuple(tuple(row) for row in study.cross.tolist()),
            ),
        )

    def numbers(self) -> dict[str, Any]:
        """Return what a report says of it, for programs."""
        numbers: dict[str, Any] = _ORBIT.dump_python(self, mode="json")
        return numbers | {"parameters": {row.parameter: row.numbers() for row in self.parameters}}


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """What a run gave.

    Parameters
    ----------
    key
        Its address.
    status, error
        `OK`, `REFUSED` or `FAILED`, and why.
    seed, overrides, repetition
        What set it apart from the other runs of its sweep.
    logs
        How many it simulated.
    estimates, orbit
        What was found.
    versions
        Of what it was made with.
    seconds
        That it took, by part.
    """

    __pydantic_config__ = _CONFIG

    schema: int = SCHEMA
    key: str = ""
    status: str
    error: str = ""
    seed: int
    overrides: dict[str, Any] = field(default_factory=dict)
    repetition: int = 0
    logs: int = 0
    estimates: tuple[EstimateRecord, ...] = ()
    orbit: OrbitRecord | None = None
    versions: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def reason(self) -> str:
        """Why there is no result, or what an estimator refused first; empty if nothing."""
        errors = [f"{each.estimator}: {each.error}" for each in self.estimates if each.error]
        return self.error or next(iter(errors), "")

    @property
    def unconverged(self) -> int:
        """How many of its estimates are not where their estimator wanted to be."""
        return sum(bool(each.parameters) and not each.converged for each in self.estimates)

    def to_json(self) -> str:
        """Return the content of its file."""
        return _to_json(_RUN, self)

    @classmethod
    def from_json(cls, text: str) -> RunRecord | None:
        """Read the content of a file; None if it is no record, or one of another schema."""
        record = _from_json(_RUN, text)
        return record if record is not None and record.schema == SCHEMA else None


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a worker sends back.

    Parameters
    ----------
    record
        Of the run.
    files
        Contents of the files that go beside it, by name.
    """

    record: RunRecord
    files: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class PlannedRun:
    """One run of a sweep: where it stands, its address, and what sets it apart."""

    number: int
    key: str
    repetition: int
    seed: int
    overrides: dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class SweepRecord:
    """What was asked.

    Parameters
    ----------
    name, description, seed
        Of the experiment.
    worst
        How many of the worst runs the report lists.
    fields
        Paths of the fields that vary.
    versions
        Of what it was planned with.
    runs
        In order.
    """

    schema: int = SCHEMA
    name: str
    description: str
    seed: int
    worst: int
    fields: tuple[str, ...]
    versions: dict[str, str]
    runs: tuple[PlannedRun, ...]

    def to_json(self) -> str:
        """Return the content of its file."""
        return _to_json(_SWEEP, self)

    @classmethod
    def from_json(cls, text: str) -> SweepRecord | None:
        """Read the content of a file; None if it is no record, or one of another schema."""
        record = _from_json(_SWEEP, text)
        return record if record is not None and record.schema == SCHEMA else None


_RUN, _SWEEP, _ORBIT = TypeAdapter(RunRecord), TypeAdapter(SweepRecord), TypeAdapter(OrbitRecord)


def _to_json(adapter: TypeAdapter[_Record], record: _Record) -> str:
    return adapter.dump_json(record, indent=1).decode()


def _from_json(adapter: TypeAdapter[_Record], text: str) -> _Record | None:
    try:
        return adapter.validate_json(text)
    except ValidationError:
        return None


def _or_none(value: float) -> float | None:
    """JSON has no NaN."""
    return value if math.isfinite(value) else None
