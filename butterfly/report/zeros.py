"""What `butterfly inspect` says of where the hand hangs."""

from __future__ import annotations

from collections.abc import Sequence

from butterfly.errors import InputError
from butterfly.identification.diagnostics.unit_errors.names import listed
from butterfly.identification.encoder_offset import OffsetKind, encoder_offsets
from butterfly.logs.log import Log
from butterfly.logs.thinning import thinned
from butterfly.model.known import Knowledge
from butterfly.signals.frequency_response import ResponsePoint, response_point

REMEDY = (
    "say what the encoder reads where the hand hangs (zero: in the manifest, or --zero), or add a "
    "log that begins and ends at rest"
)
"""What helps where a zero is a guess."""


def zeros_said(logs: Sequence[Log], known: Knowledge) -> list[str]:
    """Say where the hand hangs in logs, how that was found, and in which of them it is a guess.

    Parameters
    ----------
    logs
        Without faults, each of a name of its own.
    known
        Of the robot; where no gravity acts there is nothing to say.
    """
    if not logs or known.weightless(log.added_mass for log in logs):
        return []
    logs = [thinned(log) for log in logs]
    zeros = encoder_offsets(logs, [_response(log) for log in logs])
    said = []
    for zero in dict.fromkeys(zeros):
        own = [log for log, each in zip(logs, zeros, strict=True) if each == zero]
        where = "" if len(own) == len(logs) else f" {_named(own, logs)}"
        if zero.kind is OffsetKind.GUESS:
            said.append(f"Where the hand hangs{where} is a guess: {REMEDY}.")
        else:
            said.append(f"The hand hangs at {zero}{where}.")
    return said


def _named(own: Sequence[Log], logs: Sequence[Log]) -> str:
    """Name some of the logs, by what they carry if all with the same are among them."""
    masses = {log.added_mass for log in own}
    if len(own) == sum(log.added_mass in masses for log in logs):
        return f"with {' and '.join(str(mass) for mass in sorted(masses))}"
    return f"in {listed([log.name for log in own])}"


def _response(log: Log) -> ResponsePoint | None:
    """Return the steady response to a sine; None for another input, or where there is none."""
    try:
        return response_point(log) if log.excitation else None
    except InputError:
        return None
