"""Logs and manifests as numbers and words of the program alone: nothing that names their owner.

What is not named here is left out, so a new field is private until somebody lists it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from numbers import Real
from typing import Any

import numpy as np

from butterfly.logs.formats import FORMATS
from butterfly.logs.log import AS_WRITTEN, OF_SERVO, SAMPLED, Log
from butterfly.logs.manifest import LogEntry, Manifest
from butterfly.model.prior import Known, known_of
from butterfly.model.servo import LAWS, ServoLoop

_OF_DATA_SET = ("input", "intersample", "joint", "shape", "gravity", "repair")
_ASKED = ("sign", "encoder", "units", "interval", "split")
_OTHER = "other"  # format of a file with an unknown ending


def anonymous_log(log: Log, name: str) -> Log:
    """Return a log under another name, its clock from 0, without its file and its headings."""
    finite = log.time[np.isfinite(log.time)]
    start = float(finite[0]) if finite.size else 0.0
    lead = None if log.lead is None else replace(log.lead, time=log.lead.time - start)
    return replace(
        log,
        time=log.time - start,
        lead=lead,
        added_mass=replace(log.added_mass, label=""),
        source=name,
        name=name,
        reading=AS_WRITTEN,
        regimes=(),
    )


def anonymous_manifest(manifest: Manifest, logs: Iterable[tuple[LogEntry, Log]]) -> Manifest:
    """Return the manifest of logs of a manifest, each in a file of its own, in the usual units."""
    facts: dict[str, Any] = manifest.model_dump(include={*_OF_DATA_SET})
    entries = [_anonymous_entry(entry, log) for entry, log in logs]
    known = {name: _number(value) for name, value in manifest.prior.values.items()}
    facts.update(known=known, zero=_number(manifest.zero), loop=loop_facts(manifest.loop))
    return Manifest(name="logs", root=".", logs=entries, **facts)


def manifest_facts(manifest: Manifest) -> dict[str, Any]:
    """Return what else a manifest says, as numbers and words of the program."""
    columns = manifest.columns or {}
    facts = manifest.model_dump(mode="json", include={*_ASKED})
    return {
        **facts,
        "files": len({entry.file for entry in manifest.logs}),
        "formats": sorted({format_of(entry) for entry in manifest.logs}),
        "columns": [field for field in (*SAMPLED, *OF_SERVO) if field in columns],
        "has_model": manifest.model is not None,
        "holds_out": len(manifest.holdout),
    }


def format_of(entry: LogEntry) -> str:
    """Return the ending of a log's file, if it is one that the program reads."""
    _, dot, ending = entry.file.rpartition(".")
    return known if (known := f"{dot}{ending.lower()}") in FORMATS else _OTHER


def _anonymous_entry(entry: LogEntry, log: Log) -> LogEntry:
    loop = loop_facts(entry.loop or {}) or None
    facts = {"input": entry.input, "zero": _number(entry.zero), "loop": loop}
    bare = LogEntry.carrying(f"{log.name}.csv", log.added_mass, log.excitation)
    return bare.model_copy(update=facts)


def _number(value: Any) -> Known | None:  # noqa: ANN401 - as a manifest gives it
    """Return a value without the name of the motor that it is from."""
    return None if value is None else replace(known_of(value), origin="")


def loop_facts(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts about a servo's loop that are numbers, and its law."""
    names = {field.name for field in fields(ServoLoop)} - {"law"}
    law = {"law": given["law"]} if given.get("law") in LAWS else {}
    return law | {name: value for name, value in given.items() if name in names and _plain(value)}


def _plain(value: object) -> bool:
    if isinstance(value, Mapping):
        return value.keys() <= {"value", "uncertainty"} and all(map(_plain, value.values()))
    return isinstance(value, Real)
