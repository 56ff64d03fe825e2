"""What free runs leave over, as numbers for programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from butterfly.identification.diagnostics.misfit import LEVELS, LogMisfit, Misfit
from butterfly.identification.diagnostics.residuals import ResidualSummary
from butterfly.model.parameters import JointKind
from butterfly.report.numbers.estimate_numbers import finding_numbers

_LENGTHS = ("motion", "error", "after_small_changes", "by_sensors", "encoder_step", "noise")


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
