"""Mistakes of whoever recorded or described the logs: wrong units, columns, omegas and masses.

Each has its name and its text; those of clocks, omegas and columns show in the inputs alone. One is
named only where undoing it makes the logs agree with a joint, or with their manifest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import ButterflyError, InputError
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.logs.log import Log
from butterfly.signals.frequency_response import ResponsePoint
from butterfly.signals.spectrum import dominant_frequency
from butterfly.verdict import Level

_NAMED = 4  # logs that a sentence names
_SAME = 0.03  # relative difference that counts as none between units
_DETUNED = 0.005  # relative difference that an omega must have to be a wrong one
_TURNED = 0.1  # rad by which the input's phase must then move from half to half of the window
_MOST_WRONG = 0.5  # share of the logs whose omega may be wrong, each by a factor of its own
_STARTS = 50  # parts of a log, of which the first is its start
_SINE = 0.8  # share of a signal that one sine explains, if it is one


class UnitError(StrEnum):
    """What may have been mistaken."""

    DEGREES = "degrees"
    COUNTS = "counts"
    MILLISECONDS = "milliseconds"
    MICROSECONDS = "microseconds"
    SWAPPED = "swapped"
    PER_MINUTE = "per-minute"
    HERTZ = "hertz"
    OMEGA = "omega"
    MILLIMETRES = "millimetres"
    CENTIMETRES = "centimetres"
    MASS = "mass"
    GRAMS = "grams"


_AGREE = "the logs agree with a joint"


def _said(what: str, unit: str) -> str:
    """Tell how to say the unit that was meant."""
    return f"Say so: --units {what}={unit}, or units: {{{what}: {unit}}} in the manifest."


def unit_error_text(finding: Finding) -> str:
    """Name the slip that a finding tells of, and the factor that undoes it."""
    return _TEXTS[UnitError(finding.parameters[0])](finding)


def with_unit_errors(error: ButterflyError, slips: Sequence[Finding]) -> ButterflyError:
    """Return an error that names slips besides; itself if there are none."""
    if not slips:
        return error
    said = " ".join(map(unit_error_text, slips))
    if isinstance(error, InputError):
        return InputError(error.source, error.field, error.value, f"{error.expected}. {said}")
    return type(error)(f"{error}. {said}")


def listed(names: Sequence[str]) -> str:
    """Name a few logs, and count the others."""
    rest = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {rest} more" if rest > 0 else "")


def _factor(finding: Finding) -> float:
    assert finding.number is not None  # noqa: S101 - every slip has its factor
    return finding.number


def _counts(finding: Finding) -> str:
    factor = _factor(finding)
    turn = f"{2 * math.pi / factor:.0f}"
    return (
        f"The angle looks like encoder counts: times {factor:.4g} (2 pi/{turn}) {_AGREE}. "
        + _said("angle", f"counts/{turn}")
    )


def _omega(finding: Finding) -> str:
    measured = finding.parameters[1:]  # of one log
    at = f" ({measured[0]})" if measured else ""
    return (
        f"The manifest's omega looks wrong for {listed(finding.logs)}: times {_factor(finding):.4g}"
        f" it is the frequency of the recorded input{at}."
    )


def _mass(finding: Finding) -> str:
    _, told, ways = finding.parameters
    where = f" in {listed(finding.logs)}" if finding.logs else ""
    choice = "" if ways == "1" else f"; one of {ways} ways, of which the motion tells no more"
    return (
        f"The added masses contradict each other: if {told} was {1e3 * _factor(finding):.3g} g"
        f"{where}, {_AGREE}{choice}."
    )


_TEXTS: dict[UnitError, Callable[[Finding], str]] = {
    UnitError.DEGREES: lambda _: (
        f"The angle looks like degrees: times pi/180 (0.01745) {_AGREE}. {_said('angle', 'deg')}"
    ),
    UnitError.COUNTS: _counts,
    UnitError.MILLISECONDS: lambda _: (
        f"The stamps look like milliseconds: times 0.001 {_AGREE}. {_said('time', 'ms')}"
    ),
    UnitError.MICROSECONDS: lambda _: (
        f"The stamps look like microseconds: times 1e-6 {_AGREE}. {_said('time', 'us')}"
    ),
    UnitError.SWAPPED: lambda _: (
        f"Input and angle look swapped: the other way round {_AGREE}. The manifest's key columns, "
        "or --columns, says which is which."
    ),
    UnitError.PER_MINUTE: lambda _: (
        "The manifest's omegas look like revolutions per minute: times 2 pi/60 (0.1047) they are "
        f"the frequencies of the recorded inputs. {_said('omega', 'rpm')}"
    ),
    UnitError.HERTZ: lambda _: (
        "The manifest's omegas look like Hz: times 2 pi they are the frequencies of the recorded "
        f"inputs. {_said('omega', 'Hz')}"
    ),
    UnitError.OMEGA: _omega,
    UnitError.MILLIMETRES: lambda _: (
        f"The arms look like millimetres: times 0.001 {_AGREE}. {_said('arm', 'mm')}"
    ),
    UnitError.CENTIMETRES: lambda _: (
        f"The arms look like centimetres: times 0.01 {_AGREE}. {_said('arm', 'cm')}"
    ),
    UnitError.MASS: _mass,
    UnitError.GRAMS: lambda _: (
        "The added masses look like grams: so much has hardly room at such an arm, or is hardly "
        "moved by such a joint, which the motion cannot tell. If they are, times 0.001 all values "
        f"but the delay hold. {_said('mass', 'g')}"
    ),
}

_FACTORS = {
    UnitError.MILLISECONDS: 1e-3,
    UnitError.MICROSECONDS: 1e-6,
    UnitError.PER_MINUTE: 2 * math.pi / 60,
    UnitError.HERTZ: 2 * math.pi,
}
"""What told over measured frequency is the inverse of."""


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
        FindingKind.UNIT_ERROR,
        (slip,),
        number=factor,
        severity=Level.WARNING,
        logs=tuple(log.name for log in logs),
    )
