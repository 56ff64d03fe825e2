"""An estimate, and what its free runs leave over, as numbers for programs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.diagnostics.misfit import LogMisfit, Misfit
from butterfly.identification.diagnostics.residuals import LEVELS, ResidualSummary
from butterfly.identification.estimate import Estimate
from butterfly.identification.parameter import unit_of
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.model.terms import PARAMETERS
from butterfly.report.finding_texts import finding_text, values_of

_LENGTHS = ("motion", "error", "after_small_changes", "by_sensors", "encoder_step", "noise")


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


def misfit_numbers(misfit: Misfit, values: Mapping[str, float]) -> dict[str, Any]:
    """Return what is left over: of all logs as shares of the rms motion, and names of terms."""
    return {
        "relative": misfit.relative,
        "after_small_changes": misfit.left,
        "by_sensors": misfit.explained,
        "times_sensors": misfit.times,
        "beyond_sensors": misfit.beyond_sensors,
        "logs_outside": misfit.outside,
        "left_over": left_over_numbers(misfit.left_over),
        "logs": [_log(log) for log in misfit.logs],
        "findings": finding_numbers(misfit.findings, values),
    }


def misfit_units(joint: JointKind, place: str = "misfit.") -> dict[str, str]:
    """Return the units of `misfit_numbers` that stand in some place of a document."""
    return {f"{place}logs.{name}": joint.way for name in _LENGTHS}


def left_over_numbers(left_over: ResidualSummary) -> dict[str, Any]:
    """Return what something left over looks like."""
    return {
        "looks_like": list(left_over.terms),
        "relative": left_over.relative,
        "size": left_over.size,
        "noise_share": left_over.noise,
        "shares": left_over.shares,
    }


def _log(log: LogMisfit) -> dict[str, Any]:
    sensor = log.sensor
    lengths = (log.motion, log.error, log.left, log.explained, sensor.step, sensor.noise)
    return {
        "log": log.name,
        **dict(zip(_LENGTHS, lengths, strict=True)),
        "over_band": dict(zip(map(str, LEVELS), log.excess, strict=True)),
        "left_over": left_over_numbers(log.left_over),
    }
