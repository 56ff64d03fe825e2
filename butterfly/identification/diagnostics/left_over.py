"""Which term of the table, missing from a model, looks like what it leaves over.

That may be torque or, as a score test has it, errors of the free run. What a change of the model's
own coefficients would add is first taken from it and from every candidate, jointly over all logs:
only what is new can be missing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.estimate import Estimate
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import TERMS

Samples = NDArray[np.float64]

_SURE = 4.0  # standard errors from 0 at which a coefficient counts as one
_LIKE = 0.3  # share that a term must explain of what is more than noise, to be named
_MORE_THAN_NOISE = 1.2  # rms over the noise's, from which there is something else
_OF_GRAVITY = ("p3", "p3_offset")
_ALIKE = 0.8  # of the likeliest one's share, from which another term looks like it
_SLOW = 0.3  # share of the rms velocity at which Stribeck friction is looked for
_PIECES = 10  # of a log, between which what is left is taken to be independent
_SINGULAR = 1e-8


class Balance(NamedTuple):
    """What one log says, at n instants.

    Parameters
    ----------
    left
        (n,) torque in N m, or simulated less measured angle in rad, that the model leaves over.
    known
        (n, k) what it would change by with k coefficients that the model has.
    candidates
        By term: (n,) what it would change by with one unit of it.
    whole
        Rms of the motor's torque in N m, or of the motion in rad.
    noise
        Rms that the sensor's errors make of it.
    """

    left: Samples
    known: Samples
    candidates: Mapping[str, Samples]
    whole: float
    noise: float


@dataclass(frozen=True, kw_only=True)
class LeftOver:
    """What the model leaves over looks like.

    Parameters
    ----------
    relative
        Its rms over the motor's torque, or the motion, less what a change of the model's own terms
        would take.
    noise
        Share of its variance that the sensors' errors explain.
    shares
        By missing term: the share that it alone explains, largest first.
    terms
        Those that it looks like, the likeliest first; several where they look alike.
    size
        Rms of what the likeliest adds, over the same.
    shows
        Whether there is more than noise and what is too little to count.
    """

    relative: float
    noise: float
    shares: dict[str, float]
    terms: tuple[str, ...] = ()
    size: float = 0.0
    shows: bool = False

    @property
    def looks_like(self) -> str:
        """Name what it looks like."""
        if not self.shows:
            return "nothing that the data can show"
        names = " or ".join(TERMS[name].looks_like for name in self.terms)
        return names or "no missing term of the table"

    def words(self, whole: str) -> str:
        """Say what it looks like, how much of it that is, and how large beside ``whole``."""
        if not self.shows:
            return self.looks_like
        if not self.terms:
            return f"{self.looks_like} ({100 * self.relative:.2g} % of {whole})"
        share = f"{100 * self.shares[self.terms[0]]:.0f} % of its variance"
        return f"{self.looks_like} ({share}, {100 * self.size:.2g} % of {whole})"


def missing_terms(estimate: Estimate, added: AddedMass) -> tuple[str, ...]:
    """Names of the terms that are looked for: those with a name for it that the model lacks.

    Parameters
    ----------
    estimate
        Of the parameters.
    added
        What the joint carries somewhere: nothing that it carries weighs without gravity.
    """
    local = {name for values in estimate.local.values() for name in values}
    has = {*estimate.names, *local, *(() if added.gravity else _OF_GRAVITY)}
    named = (row.name for row in TERMS.values() if row.looks_like)
    return tuple(
        name for name in named if name not in has and not getattr(estimate.parameters, name)
    )


def slow_velocity(logs: Iterable[Log]) -> float:
    """Return the velocity in rad/s at which Stribeck friction is looked for in logs."""
    return _SLOW * float(np.median([log.rms_speed for log in logs]))


def name_left_over(balances: Sequence[Balance], least: float) -> tuple[LeftOver, list[LeftOver]]:
    """Name what several logs leave over: together, and each.

    Parameters
    ----------
    balances
        Of the logs, their k and their candidates the same.
    least
        Share of the whole below which nothing is said.
    """
    weights = [1 / each.whole for each in balances]
    ends = np.cumsum([each.left.size for each in balances])[:-1]
    known, left = (
        np.concatenate([w * column for w, column in zip(weights, columns, strict=True)])
        for columns in ([each.known for each in balances], [each.left for each in balances])
    )
    names = list(balances[0].candidates)
    columns = [
        np.concatenate([w * b.candidates[name] for w, b in zip(weights, balances, strict=True)])
        for name in names
    ]
    new = np.split(_less(known, np.column_stack([left, *columns])), ends)
    noises = [w * each.noise for w, each in zip(weights, balances, strict=True)]
    sizes = [max(part.shape[0], 1) for part in new]
    noise = float(np.sqrt(np.average(np.square(noises), weights=sizes)))
    pieces = [piece for part in new for piece in np.array_split(part, _PIECES)]
    each = [
        _judged(np.array_split(part, _PIECES), names, own, least)
        for part, own in zip(new, noises, strict=True)
    ]
    return _judged(pieces, names, noise, least), each


def _less(known: Samples, columns: Samples) -> Samples:
    """Take from (n, j) columns what those known explain."""
    sizes = np.linalg.norm(known, axis=0)
    scaled = known[:, sizes > 0] / sizes[sizes > 0]
    change = np.linalg.lstsq(scaled, columns, rcond=_SINGULAR)[0]
    return np.asarray(columns - scaled @ change)


def _judged(
    pieces: Sequence[Samples], names: Sequence[str], noise: float, least: float
) -> LeftOver:
    """Judge pieces of (n, 1 + j): what is left, and what j missing terms would change of it."""
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
        if possible and abs(value) > _SURE * error and added > least:
            likely[name] = float(added)
    quiet = float(min(noise**2 / power, 1.0)) if power > 0 else 1.0
    ordered = dict(sorted(shares.items(), key=lambda item: -item[1]))
    enough = max(_LIKE * (1 - quiet), _ALIKE * max(shares.values(), default=0.0))
    terms = tuple(name for name in ordered if name in likely and ordered[name] > enough)
    beyond = (power * (1 - quiet)) ** 0.5 > least and quiet * _MORE_THAN_NOISE**2 < 1
    return LeftOver(
        relative=float(power**0.5),
        noise=quiet,
        shares=ordered,
        terms=terms,
        size=likely[terms[0]] if terms else 0.0,
        shows=bool(terms or beyond),
    )
