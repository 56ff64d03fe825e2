"""What results say for programs of the data, the estimate and the findings that they rest on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.diagnostics.residuals import Residuals
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.parameter import lumped_numbers
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import PARAMETERS
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
