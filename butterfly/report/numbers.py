"""What results, and runs and sweeps on disk, say for programs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from butterfly.experiment.record import EstimateRecord, RunRecord
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.residuals import LogResiduals, Residuals
from butterfly.identification.estimators import Estimator
from butterfly.identification.findings import Finding
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.parameter import lumped_numbers, unit_of
from butterfly.logs.log import InputKind
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import PARAMETERS
from butterfly.report.finding_texts import estimate_verdict, finding_text, values_of
from butterfly.result import document
from butterfly.verdict import Level, Verdict

if TYPE_CHECKING:
    import pyarrow as pa

NEAR_ORBIT = "near the orbit"
"""Name of an orbit's estimate among those of a run."""

RESIDUAL_CAPTION = (
    "Error: rms of measured minus simulated motion, in % of the rms motion, averaged over steps of "
    "the simulation. Next: the part that no small change of the parameters removes, and the error "
    "that encoder resolution and noise explain. Bands: whether autocorrelation and "
    "cross-correlation with the input stay within 95 % bands of sensor noise; one good log in "
    "twenty does not. A misfit of 0.1 % of the motion counts for nothing: where the error is no "
    "larger, the bands are as wide as the curves can be, and nothing is tested."
)
"""What `residual_row` has."""

RESIDUAL_COLUMNS = (
    *("error in % of the motion", "after small changes in %", "sensor noise in %"),
    *("error over sensor noise", "outside its bands", "missing terms explain in %"),
)

_IN_THEIR_UNIT = {
    *("value", "standard_error", "lower", "upper", "true"),
    *("least_left_out", "largest_left_out"),
}


def rests_on(data: DataSet, estimate: Estimate, estimator: Estimator | None) -> dict[str, Any]:
    """Return what every result says of the data and the estimate that it rests on."""
    return {
        "data": data.about,
        "chosen": chosen_options(estimator, estimate),
        **estimate_numbers(estimate),
    }


def finding_numbers(findings: Iterable[Finding], estimate: Estimate) -> list[dict[str, Any]]:
    """Return findings about an estimate for programs, each with its text."""
    values = values_of(estimate)
    return [{"kind": "", "text": finding_text(each, values)} | asdict(each) for each in findings]


def estimate_numbers(estimate: Estimate, truth: LumpedParameters | None = None) -> dict[str, Any]:
    """Return an estimate under the keys that all results have which rest on one."""
    content = estimate.to_dict(truth)
    content["findings"] = finding_numbers(estimate.findings, estimate)
    if truth is not None:
        content["truth"] = lumped_numbers(truth, estimate.input_kind, estimate.joint)
    return content


def residual_numbers(residuals: Residuals, estimate: Estimate) -> dict[str, Any]:
    """Return the residuals of an estimate, and what they mean, for programs."""
    return residuals.numbers() | {"findings": finding_numbers(residuals.findings, estimate)}


def residual_row(log: LogResiduals) -> dict[str, Any]:
    """Return the residuals of a log as cells of a result's row."""
    shares = (100 * x / (log.motion or np.nan) for x in (log.error, log.left, log.explained))
    cells = (*shares, log.times, bool(log.outside), 100 * log.share or np.nan)
    return dict(zip(RESIDUAL_COLUMNS, cells, strict=True))


def chosen_options(
    estimator: Estimator | None, estimate: Estimate, label: str = ""
) -> dict[str, Any]:
    """Return what an estimate was made with: method, terms that it fits, options if known."""
    options = {} if estimator is None else asdict(estimator)
    return {
        "method": options.pop("method", label.partition("(")[0]),
        "label": label if estimator is None else estimator.label,
        "terms": [name for name in estimate.names if name not in PARAMETERS],
        "options": {name: _plain(value) for name, value in options.items()},
    }


def _plain(value: object) -> Any:  # noqa: ANN401 - any option
    if isinstance(value, tuple | list):
        return [_plain(each) for each in value]
    return value if isinstance(value, bool | int | float | None) else str(value)


def record_document(record: RunRecord) -> dict[str, Any]:
    """Return the record of one run."""
    content = json.loads(record.to_json())
    for unsaid in ("schema", "digest", "versions"):
        del content[unsaid]
    verdict = run_verdict(record)
    return document(
        "run-record",
        f"Run {record.key}",
        content | {"made_with": record.versions, "estimates": [*map(_estimate, record.estimates)]},
        verdict=verdict,
        summary=() if verdict is None else verdict.lines,
        units={"seconds": "s", "estimates.fit": "%", "estimates.held_out": "%"},
    )


def runs_document(records: Sequence[RunRecord]) -> dict[str, Any]:
    """Return the records of runs that are compared."""
    runs = [record_document(each) for each in records]
    return document(
        "runs",
        " beside ".join(each["title"] for each in runs),
        {"runs": runs},
        summary=[f"{each['title']}: {each['summary'][0]}" for each in runs if each["summary"]],
    )


def rows_document(name: str, table: pa.Table, kind: InputKind) -> dict[str, Any]:
    """Return the rows of a table of results, with the units of what they estimate."""
    rows = table.to_pylist()
    for row in rows:
        if "parameter" in row:
            row["unit"] = unit_of(row["parameter"], kind)
    units = {f"rows.{each}": _unit_of_column(each) for each in table.column_names}
    return document(
        "table",
        f"Rows of {name}",
        {"count": table.num_rows, "rows": rows},
        units={column: unit for column, unit in units.items() if unit},
    )


def _unit_of_column(name: str) -> str:
    if name.startswith(("fit_", "held_out_", "holdout_")):
        return "%"
    if name.startswith("orbit_") and name not in {"orbit_rounds", "orbit_differing"}:
        return "rad/s" if name.endswith("speed") else "rad"
    return "the row's unit" if name in _IN_THEIR_UNIT else ""


def run_verdict(record: RunRecord) -> Verdict | None:
    """Return the worst verdict on the estimates of a run; None if there is none."""
    found = {e.estimator: estimate_verdict(e.estimate) for e in record.estimates if e.estimate}
    if record.orbit is not None and record.orbit.verdict is not None:
        level = Level.of_verdict(record.orbit.verdict)
        found[NEAR_ORBIT] = Verdict(level, ("see the orbit's findings.",))
    if len(found) == 1:
        return next(iter(found.values()))
    return Verdict.of_several(found) if found else None


def _estimate(record: EstimateRecord) -> dict[str, Any]:
    found = record.estimate
    fits = {name: getattr(record, name) for name in ("fit", "held_out", "holdout")}
    content: dict[str, Any] = {"estimator": record.estimator, "error": record.error}
    if found is None:
        content |= {"verdict": None, "reasons": [], "ending": str(record.ending)}
    else:
        content |= estimate_verdict(found).numbers() | found.to_dict(record.truth)
        content["findings"] = finding_numbers(found.findings, found)
    return content | {name: fit and fit.numbers() for name, fit in fits.items()}
