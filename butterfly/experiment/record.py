"""What is kept of a run and of a sweep: typed records, and their JSON.

SweepRecord             what was asked: the runs in order
RunRecord               what a run gave
  EstimateRecord        of each estimator: its estimate, or why there is none
  OrbitRecord           of an orbit that was held
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import ConfigDict, PlainSerializer, PlainValidator, TypeAdapter, computed_field

from butterfly.experiment.orbit_record import OrbitRecord
from butterfly.identification.diagnostics.findings import Ending
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FitSummary
from butterfly.identification.parameter import Parameter, or_nan
from butterfly.model.parameters import LumpedParameters
from butterfly.verdict import Level

SCHEMA = 4
"""Of the records; those of 3 are read, one with another number counts as none."""

OK, REFUSED, FAILED = "ok", "refused", "failed"
"""A run's status: done, refused for good (bad input, unidentifiable), or failed unexpectedly."""

_UNSIGNED = '"digest": ""'

_Record = TypeVar("_Record", "RunRecord", "SweepRecord")
_CONFIG = ConfigDict(ser_json_inf_nan="strings")  # JSON has no NaN


def _to_dict(estimate: Estimate) -> dict[str, Any]:
    return estimate.to_dict()


def _from_dict(content: Estimate | dict[str, Any]) -> Estimate:
    return content if isinstance(content, Estimate) else Estimate.from_dict(content)


_KeptEstimate = Annotated[Estimate, PlainValidator(_from_dict), PlainSerializer(_to_dict)]


@dataclass(frozen=True, kw_only=True)
class EstimateRecord:
    """What an estimator gave: an estimate, or the error that says why there is none."""

    estimator: str  # its label
    error: str = ""  # why there is no estimate, or no held-out FIT
    estimate: _KeptEstimate | None = None
    truth: dict[str, float] | None = None  # of the estimate's parameters, where it is known
    fit: FitSummary | None = None  # FIT in per cent of the logs that it was fitted to
    held_out: FitSummary | None = None  # of what was left out in turns
    holdout: FitSummary | None = None  # of the logs that were named to be held out

    @classmethod
    def of(
        cls,
        estimator: str,
        found: Estimate,
        fit: FitSummary,
        truth: LumpedParameters,
        holdout: FitSummary | None = None,
    ) -> EstimateRecord:
        """Return the record of an estimate."""
        names = (*found.names, *found.known.exact)
        return cls(
            estimator=estimator,
            estimate=found,
            truth={name: float(getattr(truth, name)) for name in names},
            fit=fit,
            holdout=holdout,
        )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The table of the estimate; empty if there is none."""
        return () if self.estimate is None else self.estimate.table(self.truth)

    @property
    def ending(self) -> Ending:
        """How the estimation ended."""
        return Ending.REFUSED if self.estimate is None else self.estimate.ending

    @property
    def converged(self) -> bool:
        """Whether the values are where the estimator wanted to be."""
        return self.ending is Ending.CONVERGED

    @property
    def level(self) -> Level:
        """How much speaks against the values."""
        return Level.WARNING if self.estimate is None else self.estimate.level

    @computed_field  # type: ignore[prop-decorator]
    @property
    def verdict(self) -> str:
        """What may be done with the values: good, use with care, or do not use."""
        return self.level.verdict


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
    files
        Digests of the contents of the files that lie beside it, by name (see `digest_of`).
    digest
        Of the rest of its file, which tells whether that is as it was written.
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
    files: dict[str, str] = field(default_factory=dict)
    digest: str = ""

    @property
    def reason(self) -> str:
        """Why there is no result, or what an estimator refused first; empty if nothing."""
        errors = [f"{each.estimator}: {each.error}" for each in self.estimates if each.error]
        return self.error or next(iter(errors), "")

    @property
    def unconverged(self) -> int:
        """How many of its estimates are not where their estimator wanted to be."""
        return sum(each.ending is Ending.STOPPED for each in self.estimates)

    @property
    def level(self) -> Level | None:
        """The worst verdict on its estimates, the orbit's among them; None if it has none."""
        found = [each.level for each in self.estimates if each.estimate is not None]
        if self.orbit is not None and self.orbit.verdict is not None:
            found.append(Level.of_verdict(self.orbit.verdict))
        return Level.worst(found) if found else None

    @property
    def verdict(self) -> str | None:
        """The same in words."""
        return None if self.level is None else self.level.verdict

    def to_json(self) -> str:
        """Return the content of its file."""
        return _to_json(_RUN, self)

    @classmethod
    def from_json(cls, text: str) -> RunRecord | None:
        """Read the content of a file; None if it is no record, damaged, or of another schema."""
        return _from_json(_RUN, text)


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
    beside
        Digests of the logs and reports of its one run that lie beside it, by name; None where it
        was not done in full.
    tables
        Digests of the tables, by name.
    digest
        As a run's.
    """

    schema: int = SCHEMA
    name: str
    description: str
    seed: int
    worst: int
    fields: tuple[str, ...]
    versions: dict[str, str]
    runs: tuple[PlannedRun, ...]
    beside: dict[str, str] | None = None
    tables: dict[str, str] = field(default_factory=dict)
    digest: str = ""

    def to_json(self) -> str:
        """Return the content of its file."""
        return _to_json(_SWEEP, self)

    @classmethod
    def from_json(cls, text: str) -> SweepRecord | None:
        """Read the content of a file; None if it is no record, damaged, or of another schema."""
        return _from_json(_SWEEP, text)


_RUN, _SWEEP = TypeAdapter(RunRecord), TypeAdapter(SweepRecord)


def digest_of(content: bytes) -> str:
    """Return what tells a content from any other."""
    return hashlib.sha256(content).hexdigest()


def _to_json(adapter: TypeAdapter[_Record], record: _Record) -> str:
    text = adapter.dump_json(replace(record, digest=""), indent=1, by_alias=True).decode()
    before, _, after = text.rpartition(_UNSIGNED)
    return f'{before}"digest": "{digest_of(text.encode())}"{after}'


def _from_json(adapter: TypeAdapter[_Record], text: str) -> _Record | None:
    try:
        content = json.loads(text)
        if content["schema"] == _BEFORE:
            return adapter.validate_python(upgraded(content))
        if content["schema"] != SCHEMA:
            return None
        record = adapter.validate_json(text)
    except (ValueError, KeyError, TypeError):  # ValidationError is a ValueError
        return None
    before, _, after = text.rpartition(f'"digest": "{record.digest}"')
    if record.digest != digest_of(f"{before}{_UNSIGNED}{after}".encode()):
        return None
    return replace(record, digest="")


_BEFORE = 3  # the schema before estimates were kept whole


def upgraded(content: dict[str, Any]) -> dict[str, Any]:
    """Return a record of schema 3 as one of now: covariances between parameters are not known."""
    estimates = [_upgraded_estimate(each) for each in content.get("estimates", ())]
    orbit = content.get("orbit")
    if orbit is not None:
        orbit = {key: each for key, each in orbit.items() if key != "parameters"}
    new = {"estimates": estimates, "orbit": orbit} if "estimates" in content else {}
    return {**content, **new, "schema": SCHEMA, "digest": ""}


def _upgraded_estimate(old: dict[str, Any]) -> dict[str, Any]:
    kept = {key: old.get(key) for key in ("estimator", "fit", "held_out", "holdout")}
    kept["error"] = old.get("error", "")
    rows = {row["parameter"]: row for row in old["parameters"]}
    fitted = {name: row for name, row in rows.items() if not row["known"]}
    if not rows:
        return kept
    errors = [or_nan(row["standard_error"]) for row in fitted.values()]
    scatter = np.full(2 * (len(fitted),), np.nan)
    np.fill_diagonal(scatter, np.square(errors))
    apart = {
        key: {name: row[key] for name, row in fitted.items()}
        for key in ("least_left_out", "largest_left_out")
        if fitted and all(row[key] is not None for row in fitted.values())
    }
    estimate = {
        "method": old["estimator"],
        "ending": old["ending"],
        "parameters": rows,
        "unestimated": {},
        "covariance": {"names": list(fitted), "matrix": scatter.tolist()},
        "left_out": [{"without": key, "values": each} for key, each in apart.items()],
        "condition": old["condition"],
        "findings": old["findings"],
        "on_bound": [name for name, row in fitted.items() if row["on_bound"]],
        "held": {},
        "known": {name: row["value"] for name, row in rows.items() if row["known"]},
        "resonances": [],
        "local": [],
    }
    truth = {name: row["true"] for name, row in rows.items() if row["true"] is not None}
    return {**kept, "estimate": estimate, "truth": truth if len(truth) == len(rows) else None}
