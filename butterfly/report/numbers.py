"""What results and tables of sweeps say for programs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from butterfly.files import replacing
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate, Truth
from butterfly.identification.estimators import Estimator
from butterfly.identification.residuals import Residuals
from butterfly.identification.trust import Finding, lumped_numbers
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import PARAMETERS
from butterfly.outputs import mark_of
from butterfly.report.finding_texts import finding_text, values_of


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
    return [
        {"kind": "", "text": finding_text(finding, values)} | asdict(finding)
        for finding in findings
    ]


def estimate_numbers(estimate: Estimate, truth: Truth | None = None) -> dict[str, Any]:
    """Return an estimate under the keys that all results have which rest on one."""
    content = estimate.to_dict(truth)
    content["findings"] = finding_numbers(estimate.findings, estimate)
    if isinstance(truth, LumpedParameters):
        content["truth"] = lumped_numbers(truth, estimate.input_kind, estimate.joint)
    return content


def residual_numbers(residuals: Residuals, estimate: Estimate) -> dict[str, Any]:
    """Return the residuals of an estimate, and what they mean, for programs."""
    return residuals.numbers() | {"findings": finding_numbers(residuals.findings, estimate)}


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
        return [_plain(entry) for entry in value]
    return value if isinstance(value, bool | int | float | None) else str(value)


def write_columns(path: Path, kind: str, columns: Mapping[str, Any]) -> None:
    """Write (n,) columns by name as CSV, where no text is a formula, or Parquet, by the ending."""
    import pyarrow as pa  # noqa: PLC0415 - slow to import
    import pyarrow.compute as pc  # noqa: PLC0415
    from pyarrow import csv, parquet  # noqa: PLC0415

    table = pa.table(columns).replace_schema_metadata({f"butterfly.{kind}": ""})
    with replacing(path, mark_of(path, kind)) as draft:
        if path.suffix.lower() == ".parquet":
            parquet.write_table(table, draft)
            return
        for k, field in enumerate(table.schema):
            if pa.types.is_string(field.type):
                texts = table.column(k)
                taken = pc.match_substring_regex(texts, r"^[=+\-@\t\r]")
                quoted = pc.binary_join_element_wise("'", texts, "")
                table = table.set_column(k, field, pc.if_else(taken, quoted, texts))
        csv.write_csv(table, draft)
