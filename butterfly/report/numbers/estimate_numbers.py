"""An estimate as numbers for programs: values with units, covariance, what was left out."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

from butterfly.experiment.estimate_record import ParameterRecord, or_none
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.logs.log import InputKind
from butterfly.model.parameters import AddedMass, JointKind, LumpedParameters
from butterfly.model.terms import PARAMETERS, TERMS
from butterfly.report.parameter_rows import unit_of
from butterfly.report.words import finding_said, values_of


def data_numbers(data: DataSet) -> dict[str, Any]:
    """Return what is to be said of the data that a result rests on."""
    carrier = data.logs[0].added_mass
    return {
        "name": data.name,
        "description": data.description,
        "input": str(data.input_kind),
        "logs": len(data.logs),
        "known": data.known.as_told(),
        "joint": str(carrier.joint),
        "gravity": carrier.gravity,
    }


def chosen_numbers(
    estimator: Estimator | None, estimate: Estimate, label: str = ""
) -> dict[str, Any]:
    """Return what an estimate was made with: method, terms that it fits, options.

    Parameters
    ----------
    estimator
        What made it; None if only its label is known.
    estimate
        What it made.
    label
        Of the estimator, where it is not known itself.
    """
    options = {} if estimator is None else asdict(estimator)
    return {
        "method": options.pop("method", label.partition("(")[0]),
        "label": label if estimator is None else estimator.label,
        "terms": [name for name in estimate.names if name not in PARAMETERS],
        "options": {name: _plain(value) for name, value in options.items()},
    }


def estimate_numbers(
    estimate: Estimate,
    kind: InputKind,
    joint: JointKind,
    *,
    truth: LumpedParameters | None = None,
    more: Sequence[Finding] = (),
    unit: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Return an estimate under the keys that all results have which rest on one.

    Parameters
    ----------
    estimate
        The estimate.
    kind, joint
        What drives how it moves, which tell the units.
    truth
        True parameters, where they are known.
    more
        Findings besides the estimate's own.
    unit
        Of its parameters by name, where they are not the usual ones.
    """
    units = {name: unit_of(name, kind, joint) for name in TERMS} | dict(unit or {})
    records = ParameterRecord.all_of(estimate, truth)
    said: dict[str, Any] = {
        "method": estimate.method,
        "ending": str(estimate.ending),
        "parameters": {each.parameter: record_row(each, units[each.parameter]) for each in records},
        "covariance": {"names": list(estimate.names), "matrix": estimate.covariance.tolist()},
        "left_out": left_out_numbers(estimate.names, estimate.left_out),
        "condition": or_none(estimate.condition),
        "findings": finding_numbers((*estimate.findings, *more), values_of(estimate)),
    }
    return said if truth is None else said | {"truth": lumped_numbers(truth, units)}


def left_out_numbers(
    names: Sequence[str], left_out: Mapping[Hashable, Iterable[float]]
) -> list[dict[str, Any]]:
    """Return what the estimates would have been without one added mass, log or part each."""
    said = []
    for key, values in left_out.items():
        carried = {"added_mass": asdict(key)} if isinstance(key, AddedMass) else {}
        found = dict(zip(names, map(float, values), strict=True))
        said.append({"without": str(key), **carried, "values": found})
    return said


def finding_numbers(
    findings: Iterable[Finding], values: Mapping[str, float]
) -> list[dict[str, Any]]:
    """Return findings: of which kind, how grave, whom they concern, and what they say."""
    return [
        {
            "kind": str(each.kind),
            "severity": str(each.severity),
            "text": finding_said(each, values),
            "parameters": list(each.parameters),
            "number": each.number,
            "logs": list(each.logs),
        }
        for each in findings
    ]


def lumped_numbers(
    parameters: LumpedParameters, units: Mapping[str, str]
) -> dict[str, dict[str, Any]]:
    """Return those parameters that every joint has, and the others that are not as usual."""
    usual = {each.name: each.default for each in fields(LumpedParameters)}
    values = {name: float(getattr(parameters, name)) for name in usual}
    return {
        name: {"value": value, "unit": units[name]}
        for name, value in values.items()
        if name in PARAMETERS or value != usual[name]
    }


def without_root(manifest: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return a manifest that says nothing of where on a machine its logs lie."""
    return None if manifest is None else {**manifest, "root": None}


def record_row(record: ParameterRecord, unit: str) -> dict[str, Any]:
    """Return what is kept of a parameter, its unit beside its value."""
    row = asdict(record)
    del row["parameter"]
    return {"value": row.pop("value"), "unit": unit, **row}


def _plain(value: object) -> Any:  # noqa: ANN401 - any option
    if isinstance(value, tuple | list):
        return [_plain(each) for each in value]
    return value if isinstance(value, bool | int | float | None) else str(value)
