"""The slips that are known, and what is said of each."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import StrEnum

from butterfly.errors import ButterflyError, InputError
from butterfly.identification.diagnostics.findings import Finding

_NAMED = 4  # logs that a sentence names


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
