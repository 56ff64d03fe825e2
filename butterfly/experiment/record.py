"""What is kept of a run and of a sweep: typed records, and their JSON.

SweepRecord             what was asked: the runs in order
RunRecord               what a run gave
  EstimateRecord        of each estimator
    ParameterRecord     of each parameter
  OrbitRecord           of an orbit that was held
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError

from butterfly.experiment.estimate_record import EstimateRecord
from butterfly.experiment.orbit_record import OrbitRecord
from butterfly.verdict import Level

SCHEMA = 3
"""Of the records; one with another number counts as none."""

OK, REFUSED, FAILED = "ok", "refused", "failed"
"""A run's status: done, refused for good (bad input, unidentifiable), or failed unexpectedly."""

_Record = TypeVar("_Record", "RunRecord", "SweepRecord")
_CONFIG = ConfigDict(ser_json_inf_nan="strings")  # JSON has no NaN


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
        return sum(bool(each.parameters) and not each.converged for each in self.estimates)

    @property
    def level(self) -> Level | None:
        """The worst verdict on its estimates, the orbit's among them; None if it has none."""
        found = [each.level for each in self.estimates if each.parameters]
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
    signed = replace(record, digest=_signature(adapter, record))
    return adapter.dump_json(signed, indent=1, by_alias=True).decode()


def _from_json(adapter: TypeAdapter[_Record], text: str) -> _Record | None:
    try:
        record = adapter.validate_json(text)
    except ValidationError:
        return None
    if record.schema != SCHEMA or record.digest != _signature(adapter, record):
        return None
    return replace(record, digest="")


def _signature(adapter: TypeAdapter[_Record], record: _Record) -> str:
    return digest_of(adapter.dump_json(replace(record, digest=""), by_alias=True))
