"""Slips that the recorded inputs alone give away: of the clock, of omegas, of the columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.unit_errors.names import UnitError
from butterfly.logs.log import Log
from butterfly.signals.frequency_response import ResponsePoint
from butterfly.signals.spectrum import dominant_frequency
from butterfly.verdict import Level

_FACTORS = {
    UnitError.MILLISECONDS: 1e-3,
    UnitError.MICROSECONDS: 1e-6,
    UnitError.PER_MINUTE: 2 * math.pi / 60,
    UnitError.HERTZ: 2 * math.pi,
}
"""What told over measured frequency is the inverse of."""

_SAME = 0.03  # relative difference that counts as none between units
_DETUNED = 0.005  # relative difference that an omega must have to be a wrong one
_TURNED = 0.1  # rad by which the input's phase must then move from half to half of the window
_MOST_WRONG = 0.5  # share of the logs whose omega may be wrong, each by a factor of its own
_STARTS = 50  # parts of a log, of which the first is its start
_SINE = 0.8  # share of a signal that one sine explains, if it is one


def unit_errors_of_refused(logs: Sequence[Log]) -> list[Finding]:
    """Tell why the inputs of sines are not at the frequencies that the manifest gives them."""
    sines = [log for log in logs if log.excitation is not None]
    if not sines:
        return []
    ratios, shares = np.array([_ratio(log) for log in sines]).T
    if np.median(shares) < _SINE:
        return _swapped(sines)
    for slip, factor in _FACTORS.items():
        if np.all(np.abs(ratios / factor - 1) < _SAME):
            return [_finding(slip, factor)]
    common = float(np.median(ratios))
    if np.all(np.abs(ratios / common - 1) < _DETUNED) and abs(common - 1) > _DETUNED:
        return [_of_omega(common, *sines)]
    wrong = np.abs(ratios - 1) > _DETUNED
    if np.mean(wrong) > _MOST_WRONG:
        return []
    return [_of_omega(float(ratios[k]), sines[k]) for k in np.flatnonzero(wrong)]


def unit_errors_of_still(logs: Sequence[Log]) -> list[Finding]:
    """Tell why angles stand still: of joints that were let go, the inputs do, and come to rest."""
    still = [log for log in logs if np.ptp(log.angle) == 0 and np.isfinite(log.input).all()]
    if still and all(_comes_to_rest(log.input) for log in still):
        return [_finding(UnitError.SWAPPED, 1.0)]
    return []


def unit_errors_of_omega(
    logs: Sequence[Log], points: Sequence[ResponsePoint | None]
) -> list[Finding]:
    """Tell of which logs the input is next to, not at, the frequency that the manifest gives."""
    near = [
        (log, point.detuning)
        for log, point in zip(logs, points, strict=True)
        if point is not None
        and abs(point.detuning) > _DETUNED
        and abs(point.detuning) * point.omega * (log.time[-1] - log.time[0]) > _TURNED
    ]
    if not near:
        return []
    worst = max((detuning for _, detuning in near), key=abs)
    return [_of_omega(1 + worst, *(log for log, _ in near))]


def _comes_to_rest(values: NDArray[np.float64]) -> bool:
    """Whether a signal is largest where it starts, and grows no more."""
    first, second = np.array_split(values, 2)
    distance = np.abs(values - second.mean())
    start = distance[: max(1, values.size // _STARTS)]
    return bool(start.max() >= distance.max() and np.std(second) < np.std(first))


def _ratio(log: Log) -> tuple[float, float]:
    """Measured over told frequency of a log's input, and the share that it explains."""
    assert log.excitation is not None  # noqa: S101 - of sines only
    measured, share = dominant_frequency(log.time, log.input)
    return measured / log.excitation.omega, share


def _swapped(sines: Sequence[Log]) -> list[Finding]:
    """Tell whether the angles are the sines that the inputs should be."""
    right = []
    for log in sines:
        assert log.excitation is not None  # noqa: S101 - of sines only
        measured, share = dominant_frequency(log.time, log.angle)
        right.append(share > _SINE and abs(measured / log.excitation.omega - 1) < _SAME)
    return [_finding(UnitError.SWAPPED, 1.0)] if np.mean(right) > _SINE else []


def _of_omega(ratio: float, *logs: Log) -> Finding:
    """Name a wrong omega; of one log by what it should be too."""
    found = _finding(UnitError.OMEGA, ratio, *logs)
    if len(logs) > 1 or logs[0].excitation is None:
        return found
    measured = f"{ratio * logs[0].excitation.omega:.4g} rad/s"
    return replace(found, parameters=(UnitError.OMEGA, measured))


def _finding(slip: UnitError, factor: float, *logs: Log) -> Finding:
    return Finding(
        kind=FindingKind.UNIT_ERROR,
        parameters=(slip,),
        number=factor,
        severity=Level.WARNING,
        logs=tuple(log.name for log in logs),
    )
