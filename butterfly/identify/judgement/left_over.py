"""Which term of the table, missing from a model, a torque that it leaves over looks like.

What a change of the model's own coefficients would add is first taken from the torque and from
every candidate, jointly over all logs: only what is new can be missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from butterfly.model.terms import TERMS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    Samples = NDArray[np.float64]

LEAST_SIZE = 5e-3
"""Torque over the motor's below which nothing is said: averaging is no more exact than that."""

_SURE = 4.0  # standard errors from 0 at which a coefficient counts as one
_LIKE = 0.3  # share that a term must explain of what is more than noise, to be named
_MORE_THAN_NOISE = 1.2  # rms over the noise's, from which there is something else
_PIECES = 10  # of a log, between which what is left is taken to be independent
_SINGULAR = 1e-8


class Balance(NamedTuple):
    """What one log says, at n instants.

    Parameters
    ----------
    torque
        (n,) N m that the model leaves over.
    known
        (n, k) what it would change by with k coefficients that the model has.
    candidates
        By term: (n,) what one unit of it would have left over.
    motor
        Rms torque in N m of the motor.
    noise
        Rms torque in N m that the sensor's errors make of it.
    """

    torque: Samples
    known: Samples
    candidates: Mapping[str, Samples]
    motor: float
    noise: float


@dataclass(frozen=True, kw_only=True)
class LeftOver:
    """What a torque that the model leaves over looks like.

    Parameters
    ----------
    relative
        Rms of the torque over the motor's, less what a change of the model's own terms would take.
    noise
        Share of its variance that the sensors' errors explain.
    shares
        By missing term: the share that it alone explains, largest first.
    term
        The one that it looks like; "" if it is like none, or there is none to see.
    size
        Rms of what that term adds over the motor's torque.
    """

    relative: float
    noise: float
    shares: dict[str, float]
    term: str = ""
    size: float = 0.0

    @property
    def shows(self) -> bool:
        """Whether the data show more than noise."""
        beyond = self.relative * max(1 - self.noise, 0.0) ** 0.5
        more = self.noise * _MORE_THAN_NOISE**2 < 1 and beyond > LEAST_SIZE
        return bool(self.term) or more

    @property
    def words(self) -> str:
        """What it looks like, how much of it, and how large that is."""
        if not self.shows:
            return "nothing that the data can show"
        size = f"{100 * self.relative:.2g} % of the motor's torque"
        if not self.term:
            return f"no single term of the table ({size})"
        share = f"{100 * self.shares[self.term]:.0f} % of its variance"
        return f"{TERMS[self.term].looks_like} ({share}, {100 * self.size:.2g} % of the motor's torque)"


def name_left_over(balances: Sequence[Balance]) -> tuple[LeftOver, list[LeftOver]]:
    """Name what several logs leave over: together, and each.

    Parameters
    ----------
    balances
        Of the logs, their k and their candidates the same.
    """
    weights = [1 / each.motor for each in balances]
    ends = np.cumsum([each.torque.size for each in balances])[:-1]
    known, torque = (
        np.concatenate([w * column for w, column in zip(weights, columns, strict=True)])
        for columns in ([each.known for each in balances], [each.torque for each in balances])
    )
    names = list(balances[0].candidates)
    columns = [
        np.concatenate([w * b.candidates[name] for w, b in zip(weights, balances, strict=True)])
        for name in names
    ]
    new = np.split(_less(known, np.column_stack([torque, *columns])), ends)
    noises = [w * each.noise for w, each in zip(weights, balances, strict=True)]
    sizes = [max(part.shape[0], 1) for part in new]
    noise = float(np.sqrt(np.average(np.square(noises), weights=sizes)))
    pieces = [piece for part in new for piece in np.array_split(part, _PIECES)]
    each = [
        _judged(np.array_split(part, _PIECES), names, own)
        for part, own in zip(new, noises, strict=True)
    ]
    return _judged(pieces, names, noise), each


def _less(known: Samples, columns: Samples) -> Samples:
    """Take from (n, j) columns what those known explain."""
    sizes = np.linalg.norm(known, axis=0)
    scaled = known[:, sizes > 0] / sizes[sizes > 0]
    change = np.linalg.lstsq(scaled, columns, rcond=_SINGULAR)[0]
    return np.asarray(columns - scaled @ change)


def _judged(pieces: Sequence[Samples], names: Sequence[str], noise: float) -> LeftOver:
    """Judge pieces of (n, 1 + j): the torque and what j missing terms would add."""
    count = max(sum(piece.shape[0] for piece in pieces), 1)
    products = np.array([piece.T @ piece for piece in pieces])
    total = products.sum(axis=0)
    power = total[0, 0] / count
    shares: dict[str, float] = {}
    likely: dict[str, float] = {}
    for column, name in enumerate(names, start=1):
        own = total[column, column]
        if not own > 0 or not power > 0:
            continue
        value = total[column, 0] / own
        scores = products[:, column, 0] - value * products[:, column, column]
        error = float(np.sqrt(np.sum(scores**2))) / own
        shares[name] = float(value * total[column, 0] / total[0, 0])
        added = abs(value) * (own / count) ** 0.5
        possible = -value >= TERMS[name].lower
        if possible and abs(value) > _SURE * error and added > LEAST_SIZE:
            likely[name] = float(added)
    quiet = min(noise**2 / power, 1.0) if power > 0 else 1.0
    ordered = dict(sorted(shares.items(), key=lambda item: -item[1]))
    term = next((name for name in ordered if name in likely), "")
    if term and ordered[term] < _LIKE * (1 - quiet):
        term = ""
    return LeftOver(
        relative=float(power**0.5),
        noise=float(quiet),
        shares=ordered,
        term=term,
        size=likely.get(term, 0.0),
    )
