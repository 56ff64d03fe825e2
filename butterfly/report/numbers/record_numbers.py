"""What runs and sweeps have left on disk, as numbers for programs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from butterfly.document import Told
from butterfly.experiment.perform import RunResult
from butterfly.experiment.record import EstimateRecord, RunRecord, SweepRecord
from butterfly.experiment.schema import Experiment
from butterfly.identification.parameter import unit_of
from butterfly.logs.log import InputKind
from butterfly.report.finding_texts import estimate_verdict, values_of
from butterfly.report.numbers.estimate_numbers import finding_numbers, lumped_numbers
from butterfly.report.numbers.orbit_numbers import told_orbit
from butterfly.verdict import Verdict

if TYPE_CHECKING:
    import pyarrow as pa

_IN_THEIR_UNIT = {
    *("value", "standard_error", "lower", "upper", "true"),
    *("least_left_out", "largest_left_out"),
}


def told_sweep(sweep: SweepRecord, said: Sequence[str], numbers: Mapping[str, Any]) -> Told:
    """Tell a sweep."""
    return Told(
        kind="sweep",
        title=f"Sweep {sweep.name!r}",
        summary=tuple(said),
        content={
            "data": {"name": sweep.name, "description": sweep.description},
            "seed": sweep.seed,
            "varied": list(sweep.fields),
            **numbers,
        },
        units={"recovery.rms_deviation": "1", "recovery.coverage": "1"},
    )


def told_record(record: RunRecord) -> Told:
    """Tell the record of one run."""
    content = json.loads(record.to_json())
    for unsaid in ("schema", "digest", "versions"):
        del content[unsaid]
    verdict = verdict_of_run(record)
    return Told(
        kind="run-record",
        title=f"Run {record.key}",
        verdict=verdict,
        summary=() if verdict is None else (verdict.sentence,),
        content={
            **content,
            "made_with": record.versions,
            "estimates": [_estimate(each) for each in record.estimates],
        },
        units={"seconds": "s", "estimates.fit": "%", "estimates.held_out": "%"},
    )


def told_runs(records: Sequence[RunRecord]) -> Told:
    """Tell runs that are compared."""
    both = [told_record(each) for each in records]
    return Told(
        kind="runs",
        title=" beside ".join(each.title for each in both),
        summary=tuple(f"{each.title}: {each.summary[0]}" for each in both if each.summary),
        content={"runs": [each.document() for each in both]},
    )


def told_rows(name: str, table: pa.Table, limit: int, kind: InputKind) -> Told:
    """Tell the first rows of a table of results, with the units of what they estimate."""
    rows = table.slice(0, limit).to_pylist()
    for row in rows:
        if "parameter" in row:
            row["unit"] = unit_of(row["parameter"], kind)
    return told_table(
        "table",
        f"Rows of {name}",
        rows,
        units={f"rows.{each}": _unit_of_column(each) for each in table.column_names},
        of=table.num_rows,
    )


def _unit_of_column(name: str) -> str:
    if name.startswith(("fit_", "held_out_", "holdout_")):
        return "%"
    if name.startswith("orbit_") and name != "orbit_rounds":
        return "rad"
    return "the row's unit" if name in _IN_THEIR_UNIT else ""


def told_table(
    kind: str,
    title: str,
    rows: Sequence[Mapping[str, Any]],
    *,
    units: Mapping[str, str] | None = None,
    of: int | None = None,
) -> Told:
    """Tell a table of results.

    `units`: Of the columns; none of those that have an empty one; `of`: How many rows there are;
    all of them are told if not given.
    """
    known = {name: unit for name, unit in (units or {}).items() if unit}
    count = len(rows) if of is None else of
    return Told(kind=kind, title=title, content={"count": count, "rows": list(rows)}, units=known)


def verdict_of_run(record: RunRecord) -> Verdict | None:
    """Say the worst verdict on the estimates of a run; None if there is none."""
    level = record.level
    if level is None:
        return None
    told = [(each, each.estimate) for each in record.estimates if each.estimate is not None]
    reasons = [
        (each.estimator, why) for each, found in told for why in estimate_verdict(found).reasons
    ]
    named = (f"{name}: {reason}" if len(told) > 1 else reason for name, reason in reasons)
    return Verdict(level, tuple(named))


def told_run(experiment: Experiment, given: Mapping[str, Any], result: RunResult) -> Told:
    """Tell a single run: the experiment, its truth, and what each estimator found.

    `given`: What its file says, with all that it extends.
    """
    record, truth = result.record, experiment.plant.robot.lumped
    found = [each.told(truth) for each in result.identifications.values()]
    orbit = None
    if result.orbit is not None:
        carried = result.orbit.calibration.rounds[0].logs[0].added_mass
        orbit = told_orbit(result.orbit, truth.with_added_mass(carried))
    verdict = verdict_of_run(record)
    first = () if verdict is None else (verdict.sentence,)
    return Told(
        kind="run",
        title=f"Run of {experiment.name!r}",
        verdict=verdict,
        summary=(*first, *(each.title for each in found)),
        content={
            "data": {
                "name": experiment.name,
                "description": experiment.description,
                "input": str(experiment.input_kind),
                "logs": record.logs,
            },
            "key": record.key,
            "status": record.status,
            "error": record.error,
            "seed": record.seed,
            "experiment": dict(given),
            "truth": lumped_numbers(truth, input_kind=experiment.input_kind),
            "estimates": [each.document() for each in found],
            "refused": [
                {"estimator": each.estimator, "error": each.error}
                for each in record.estimates
                if each.estimate is None
            ],
            "orbit": None if orbit is None else orbit.document(),
            "seconds": record.seconds,
        },
        units={"seconds": "s"},
    )


def _estimate(record: EstimateRecord) -> dict[str, Any]:
    fits = {name: getattr(record, name) for name in ("fit", "held_out", "holdout")}
    content: dict[str, Any] = {"estimator": record.estimator, "error": record.error}
    if record.estimate is None:
        content |= {"verdict": None, "reasons": [], "ending": str(record.ending)}
    else:
        content |= estimate_verdict(record.estimate).numbers() | record.estimate.to_dict(
            record.truth
        )
        values = values_of(record.estimate)
        content["findings"] = finding_numbers(record.estimate.findings, values)
    return content | {name: fit and fit.numbers() for name, fit in fits.items()}
