"""An estimate as numbers for programs: values with units, covariance, what was left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.estimate import Estimate
from butterfly.identification.parameter import unit_of
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.model.terms import PARAMETERS
from butterfly.report.finding_texts import finding_text, values_of


def estimate_numbers(
    estimate: Estimate, truth: LumpedParameters | None = None, more: Sequence[Finding] = ()
) -> dict[str, Any]:
    """Return an estimate under the keys that all results have which rest on one.

    The truth where it is known, and findings besides the estimate's own.
    """
    content = estimate.to_dict(truth)
    content["findings"] = finding_numbers((*estimate.findings, *more), values_of(estimate))
    return content if truth is None else content | {"truth": lumped_numbers(truth, estimate)}


def finding_numbers(
    findings: Iterable[Finding], values: Mapping[str, float]
) -> list[dict[str, Any]]:
    """Return findings: of which kind, how grave, whom they concern, and what they say."""
    return [
        {
            "kind": str(each.kind),
            "severity": str(each.severity),
            "text": finding_text(each, values),
            "parameters": list(each.parameters),
            "number": each.number,
            "logs": list(each.logs),
        }
        for each in findings
    ]


def lumped_numbers(
    parameters: LumpedParameters,
    estimate: Estimate | None = None,
    *,
    input_kind: InputKind | None = None,
    joint: JointKind = JointKind.HINGE,
) -> dict[str, dict[str, Any]]:
    """Return those parameters that every joint has, and the others that are not as usual.

    Their units are those of an estimate, or of what drives which joint.
    """
    if estimate is not None:
        input_kind, joint = estimate.input_kind, estimate.joint
    usual = {each.name: each.default for each in fields(LumpedParameters)}
    values = {name: float(getattr(parameters, name)) for name in usual}
    return {
        name: {"value": value, "unit": unit_of(name, input_kind, joint)}
        for name, value in values.items()
        if name in PARAMETERS or value != usual[name]
    }


def without_root(manifest: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return a manifest that says nothing of where on a machine its logs lie."""
    return None if manifest is None else {**manifest, "root": None}
