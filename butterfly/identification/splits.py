"""Splits of the data for cross-validation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from numbers import Integral

import numpy as np

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.inference.limits import edges_of
from butterfly.identification.levels import FEW
from butterfly.logs.log import MIN_SAMPLES, Log
from butterfly.signals.frequency_response import MIN_PERIODS

FOLDS = 5
"""Parts into which frequencies, logs or time are divided, where there are enough of them."""

Samples = Mapping[int, slice]
"""Numbers of logs, and the held-out samples of each."""


class Split(StrEnum):
    """Kinds of data that are held out together."""

    AUTO = "auto"
    MASS = "mass"
    FREQUENCY = "frequency"
    LOG = "log"
    TIME = "time"


@dataclass(frozen=True, kw_only=True)
class Division:
    """Logs divided into parts; one is held out at a time."""

    split: Split  # what the samples of a part have in common; never `Split.AUTO`
    why: str  # why this split was taken, in words
    parts: dict[str, Samples]  # the held-out samples of each part, by its name

    @property
    def sentence(self) -> str:
        """The split, and why it was taken."""
        return f"Held out by {self.split}: {self.why}."

    @property
    def left_out(self) -> str:
        """What is held out at a time, in words."""
        if self.split is Split.LOG and all(len(part) == 1 for part in self.parts.values()):
            return "one log held out"
        return _LEFT_OUT[self.split]

    def remainder(self, data: DataSet, name: str) -> DataSet:
        """Return the data set without one part; InputError if the rest cannot be used."""
        samples = self.parts[name]
        whole = [k for k in range(len(data.logs)) if k not in samples]
        if self.split is not Split.TIME:
            return data.take(whole)
        pieces: list[Log] = []
        for number, log in enumerate(data.logs):
            stretch = samples.get(number)
            pieces += [log] if stretch is None else excluding_interval(log, stretch)
        return DataSet.of(pieces, name=data.name, known=data.given)


def divide(data: DataSet, split: Split = Split.AUTO, folds: int | None = None) -> Division:
    """Divide logs into parts.

    ``mass``: one part for each added mass. ``frequency``: the drive frequencies of sines are dealt
    into folds, neighbours into different ones; other logs are always kept. ``log``: logs are dealt
    into folds in their order. ``time``: every log is cut into as many stretches of equal length,
    and each part is one stretch of all. ``auto``: the first of these that suits the logs. There are
    `FOLDS` folds if not given, or fewer where there are fewer frequencies or logs.

    InputError if there cannot be so many folds; IdentifiabilityError if the logs are all of one
    part, which names a split that suits them.
    """
    counted = isinstance(folds, Integral) and folds >= 2  # noqa: PLR2004 - to leave one out
    if folds is not None and (split is Split.MASS or not counted):
        expected = "a whole number of at least 2, with split frequency, log or time"
        raise InputError("validate", "folds", folds, expected)
    why = "as requested"
    if split is Split.AUTO:
        split, why = _suited(data, folds)
    parts = _parts(data, split, folds)
    if len(parts) < 2:  # noqa: PLR2004 - nothing would be left to estimate from
        raise IdentifiabilityError(f"{_why_alike(data, split)}: none can be held out{remedy(data)}")
    return Division(split=split, why=why, parts=parts)


def remedy(data: DataSet, *, other_than: Split = Split.MASS) -> str:
    """Return the name of another split that is possible, after a semicolon; or nothing."""
    others = (
        split for split in (Split.FREQUENCY, Split.LOG, Split.TIME) if split is not other_than
    )
    works = next((split for split in others if _works(data, split)), None)
    return f"; split {works} works with these logs" if works else ""


def _suited(data: DataSet, folds: int | None) -> tuple[Split, str]:
    """Return the most demanding split that is possible with the logs, and why."""
    masses, omegas, count = len(data.masses), len(_frequencies(data)), len(data.logs)
    if masses >= FEW and folds is None:
        return Split.MASS, f"there are {masses} added masses"
    few = f"only {'one' if masses == 1 else masses} added mass{'es' if masses > 1 else ''}"
    if masses >= FEW:
        few = "folds were requested"
    sines = all(log.excitation for log in data.logs)
    if sines and omegas >= FOLDS and _works(data, Split.FREQUENCY, folds):
        return Split.FREQUENCY, f"{few}, but sines at {omegas} frequencies"
    if count >= FEW and _works(data, Split.LOG, folds):
        return Split.LOG, f"{few}, but {count} logs"
    return Split.TIME, f"{few}, and too few logs to hold one out"


def _works(data: DataSet, split: Split, folds: int | None = None) -> bool:
    """Whether the scale remains identifiable without any one part, if it is with all."""
    try:
        parts = _parts(data, split, folds)
    except InputError:
        return False
    if len(parts) < 2:  # noqa: PLR2004 - one left out, one kept
        return False
    if split is Split.TIME or data.known.scale() or len(data.masses) == 1:
        return True
    numbers = range(len(data.logs))
    remaining = (
        {data.logs[k].added_mass for k in numbers if k not in part} for part in parts.values()
    )
    return all(len(masses) > 1 for masses in remaining)


def _parts(data: DataSet, split: Split, folds: int | None) -> dict[str, Samples]:
    """Return the held-out samples of each part, by its name."""
    logs = data.logs
    if split is Split.TIME:
        count = folds or FOLDS
        edges = [[*edges_of(log.time, count), log.time.size] for log in logs]
        return {
            f"stretch {k + 1} of {count}": {
                number: slice(*bounds[k : k + 2])
                for number, bounds in enumerate(edges)
                if k + 1 < len(bounds)
            }
            for k in range(count)
        }
    if split is Split.MASS:
        owners = [str(log.added_mass) for log in logs]
        names = list(dict.fromkeys(owners))
    elif split is Split.FREQUENCY:
        omegas = _frequencies(data)
        count = _count(folds, len(omegas), "frequencies")
        names = [f"part {k + 1}" for k in range(count)]
        owners = [
            names[omegas.index(log.excitation.omega) % count] if log.excitation else ""
            for log in logs
        ]
    else:
        count = _count(folds, len(logs), "logs")
        names = [logs[k].name if count == len(logs) else f"fold {k + 1}" for k in range(count)]
        owners = [names[k % count] for k in range(len(logs))]
    return {name: {k: slice(None) for k, one in enumerate(owners) if one == name} for name in names}


def _frequencies(data: DataSet) -> list[float]:
    return sorted({log.excitation.omega for log in data.logs if log.excitation})


def _count(folds: int | None, available: int, what: str) -> int:
    if folds is not None and folds > available:
        raise InputError("validate", "folds", folds, f"at most {available}, the number of {what}")
    return folds or min(FOLDS, available)


def _why_alike(data: DataSet, split: Split) -> str:
    """Return why all logs are of one part."""
    if split is Split.MASS:
        (mass,) = data.masses
        return (
            f"all logs have the same added mass ({mass})"
            if mass.mass
            else "no log has an added mass"
        )
    if split is Split.FREQUENCY:
        return "all sines have the same frequency" if _frequencies(data) else "no log is a sine"
    return "there is only one log"


_LEFT_OUT = {
    Split.MASS: "one added mass held out",
    Split.FREQUENCY: "some frequencies held out",
    Split.LOG: "some logs held out",
    Split.TIME: "a stretch of time held out",
}


def excluding_interval(log: Log, interval: slice) -> list[Log]:
    """Return usable pieces of a log before and after an interval; the second is in motion."""
    first, last, _ = interval.indices(log.time.size)
    sides = {"before": (0, first), "after": (last, log.time.size)}
    pieces = []
    for side, (begin, end) in sides.items():
        if end - begin < MIN_SAMPLES:
            continue
        piece = replace(log.piece(begin, end), name=f"{log.name}, {side}")
        if _usable(piece):
            pieces.append(piece)
    return pieces


def _usable(piece: Log) -> bool:
    """Whether a piece moves, and holds enough periods if it is a sine."""
    if np.ptp(piece.angle) == 0:
        return False
    if piece.excitation is None:
        return True
    return float(np.ptp(piece.time)) * piece.excitation.omega / (2 * math.pi) > MIN_PERIODS + 1
