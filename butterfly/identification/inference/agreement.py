"""Whether all conditions agree on one set of values: contrasts, from the equations at the optimum.

A model that lacks something still follows the logs, with values that depend on where it was looked
at. So let one parameter j follow one condition x linearly (the added mass, 1/command, swing^2,
omega^2, time in the log, the sign of the input), all others re-optimised to first order. With the
cells' curvature H_c = J^T J and gradient s_c = J^T r, and x about its mean,

    q = H^-1 sum x_c H_c e_j,  a_c = x_c e_j - q,  S = sum a_c^T s_c,  I = sum a_c^T H_c a_c,

the slope is gamma = -S/I. Its scatter is that of the clusters k without one another (jackknife),

    e_k = (z_k + I_k gamma) / (1 - I_k/I),  t = gamma I / sqrt(sum e_k^2),

with 1/sum((I_k/I)^2) - 1 degrees of freedom. What would hold at the condition's limit, theta -
gamma q + gamma (x* - mean x) e_j, is a rival that the intervals hold. A mass that is weighed wrong
is a contrast as well: of p1 and p3 together, in its logs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, stdtr

from butterfly.identification.blocks import FEW
from butterfly.identification.equations import CellEquations
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import PARAMETERS

Samples = NDArray[np.float64]

_LEVEL = 0.05  # of a false alarm, over all contrasts (Holm, Scand. J. Statist. 6, 1979)
_SHARES = (0.02, 0.05)  # of the squared errors, of sines and of transients: below, nothing is named
_MOVES = 0.01  # of p1 or p4, by which a smaller share counts
_MOVES_STEADY = 1e-3  # the same where steady responses say it, whose errors are known
_UNSEEN = 1e-6  # share of a direction that the parameters leave, below which it is one of them
_LEAST_MASSES = 3  # of which one can be weighed wrong: to call two the same explains everything
_LEAST_GROUP = 6  # logs of either sign of the input, fewer of which differ by chance


_OF_TORQUES = ("p1", "p3", "p4")
_FRICTION = {"p2", "coulomb"}
_FOLLOWING = tuple(name for name in PARAMETERS if name != "delay")


class Condition(StrEnum):
    """What a parameter may follow."""

    MASS = "added mass"
    COMMAND = "command"
    SWING = "swing"
    FREQUENCY = "frequency"
    TIME = "time"
    DIRECTION = "direction"
    WEIGHED = "weighed"
    ALL = "all"


@dataclass(frozen=True, kw_only=True)
class Contrast:
    """One parameter that follows one condition, where it should be the same in all."""

    parameter: str  # or, of a mass that is weighed wrong, "mass"
    condition: Condition
    least: float  # least, largest: of the condition, in SI units of `Conditions`, or kg
    largest: float
    first: float  # first, last: the parameter there; of a mass what was given and what would fit
    last: float
    share: float  # of the squared errors that it explains
    chance: float  # that conditions which agree look so, over all contrasts that were tried

    @property
    def grows(self) -> bool:
        """Whether the parameter grows with the condition."""
        return self.last > self.first

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Contrast:
        """Return the contrast of which its fields tell; other keys are not looked at."""
        numbers = ("least", "largest", "first", "last", "share", "chance")
        return cls(
            parameter=str(content["parameter"]),
            condition=Condition(content["condition"]),
            **{name: float(content[name]) for name in numbers},
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Conditions:
    """Under which conditions the logs of k cells were recorded."""

    # by condition: (k,) inertia of the added mass in kg m^2, 1/rms input, mean squared swing in
    # rad^2, omega^2 in rad^2/s^2, time since the start in s, sign of the input
    values: Mapping[Condition, Samples]
    masses: tuple[AddedMass, ...]  # of the n logs
    sines: bool  # whether all are sines
    steady: bool = False  # whether residuals are those of steady responses, whose errors are known

    @classmethod
    def of(cls, logs: Sequence[Log], cells: int, *, steady: bool = False) -> Conditions:
        """Read them off logs, each of which was cut into some cells."""
        pieces = [piece for log in logs for piece in _pieces(log, cells)]
        values = {
            Condition.MASS: _repeated([log.added_mass.inertia for log in logs], cells),
            Condition.COMMAND: _repeated([_of_command(log) for log in logs], cells),
            Condition.SWING: np.array([np.var(angle) for _, angle in pieces]),
            Condition.FREQUENCY: _repeated([_omega_squared(log) for log in logs], cells),
            Condition.TIME: np.array([time.mean() for time, _ in pieces]),
            Condition.DIRECTION: _repeated([_direction(log) for log in logs], cells),
        }
        if cells == 1:
            del values[Condition.TIME]
        signs = values[Condition.DIRECTION][::cells]
        if min(np.sum(signs > 0), np.sum(signs < 0)) < _LEAST_GROUP:
            del values[Condition.DIRECTION]
        return cls(
            values=values,
            masses=tuple(log.added_mass for log in logs),
            sines=all(log.excitation for log in logs),
            steady=steady,
        )


class _About(NamedTuple):
    """What a contrast is about."""

    parameter: str
    condition: Condition
    mean: float  # of the condition, by what the cells tell; of a mass its own
    x: Samples  # (k,) the condition


class _Tried(NamedTuple):
    """A contrast that was tried: its slope, share and chance, and what the others move by."""

    about: _About
    gamma: float
    moves: Samples  # (n,) change of the parameters with the slope, about the mean
    share: float
    chance: float
    of_logs: float  # the same by the scatter between logs


def disagreements_of(
    equations: CellEquations, conditions: Conditions
) -> tuple[tuple[Contrast, ...], tuple[Samples, ...]]:
    """Return the contrasts that are no chance and matter, the best first, and their rivals.

    A rival is what would hold at the limit of its condition: (n,) values each.
    """
    tried = [*_of_parameters(equations, conditions), *_of_masses(equations, conditions)]
    tried.sort(key=lambda each: each.chance)
    accepted: list[tuple[Contrast, list[Samples]]] = []
    for passed, each in enumerate(tried):
        chance = each.chance * (len(tried) - passed)
        if not chance < _LEVEL:
            break
        rivals = [_rival(equations, each, limit) for limit in _limits(each)]
        moved = rivals or [equations.values + each.moves]
        if _matters(equations, each, moved, conditions):
            accepted.append((_contrast(equations, each, chance), rivals))
    accepted.sort(key=lambda each: -each[0].share)
    return (
        tuple(contrast for contrast, _ in accepted),
        tuple(rival for _, rivals in accepted for rival in rivals),
    )


def friction_disagrees(equations: CellEquations, conditions: Conditions) -> bool:
    """Whether friction follows a condition, as it does where a term of it is missing."""
    found, _ = disagreements_of(equations, conditions)
    return any(each.parameter in _FRICTION for each in found)


def lacking_term(
    equations: CellEquations, names: Sequence[str], conditions: Conditions
) -> str | None:
    """Return which of some terms a model lacks, by the rule of contrasts: the likeliest, if any.

    The terms are in the equations, at what is none of them; each may move in all cells alike.
    """
    absent = np.isin(equations.names, names)
    about = replace(equations, on_bound=equations.on_bound | absent)
    tried = []
    for name in names:
        place = equations.names.index(name)
        direction = np.zeros((equations.log.size, len(equations.names)))
        direction[:, place] = 1.0
        every = _About(name, Condition.ALL, 0.0, direction[:, place])
        found = _tried(about, conditions, direction, every)
        if found and equations.values[place] + found.gamma > equations.lower[place]:
            tried.append(found)
    best = min(tried, key=lambda each: each.chance, default=None)
    if best is None or not best.chance * len(names) < _LEVEL:
        return None
    moved = [equations.values + best.moves]
    matters = _matters(equations, best, moved, conditions, _OF_TORQUES)
    return best.about.parameter if matters else None


def weighed_within(contrasts: Sequence[Contrast]) -> float:
    """Return within which share masses are weighed, as they tell of each other; 0 if they agree.

    The least change of one of them that makes them agree.
    """
    wrong = [each for each in contrasts if each.condition is Condition.WEIGHED]
    return min((abs(each.last / each.first - 1) for each in wrong), default=0.0)


def _of_parameters(equations: CellEquations, conditions: Conditions) -> list[_Tried]:
    """Try each parameter of the scale with each condition that differs from cell to cell."""
    tried = []
    for condition, x in conditions.values.items():
        if not np.ptp(x) > 0:
            continue
        for name in _FOLLOWING:
            if name not in equations.names or equations.on_bound[equations.names.index(name)]:
                continue
            place = equations.names.index(name)
            weight = equations.curvature[:, place, place]
            if not weight.sum() > 0:
                continue
            mean = float(weight @ x / weight.sum())
            direction = np.zeros((x.size, len(equations.names)))
            direction[:, place] = x - mean
            found = _tried(equations, conditions, direction, _About(name, condition, mean, x))
            tried += [found] if found else []
    return tried


def _of_masses(equations: CellEquations, conditions: Conditions) -> list[_Tried]:
    """Try whether each added mass was weighed wrong, where there are enough of them."""
    names, masses = equations.names, conditions.masses
    different = sorted({mass for mass in masses if mass.mass})
    effects = {mass.inertia_and_moment for mass in masses}
    if len(effects) < _LEAST_MASSES or not {"p1", "p3"} <= {*names}:
        return []
    tried = []
    for mass in different:
        x = np.array([float(masses[number] == mass) for number in equations.log])
        direction = np.zeros((x.size, len(names)))
        direction[:, names.index("p1")] = x * mass.arm**2
        direction[:, names.index("p3")] = x * mass.gravity * mass.arm
        about = _About("mass", Condition.WEIGHED, mass.mass, x)
        found = _tried(equations, conditions, direction, about)
        tried += [found] if found else []
    return tried


def _tried(
    equations: CellEquations, conditions: Conditions, direction: Samples, about: _About
) -> _Tried | None:
    """Let the parameters move along (k, n) directions; None where the cells cannot tell that."""
    free = ~equations.on_bound
    curvature, gradient = equations.curvature, equations.gradient
    pulls = np.einsum("kmn,kn->km", curvature, direction)
    total, _ = equations.total
    scale = np.sqrt(np.maximum(np.diag(total), 0.0))
    free = free & (scale > 0)
    own = np.outer(scale[free], scale[free])
    follow = np.zeros(len(scale))
    follow[free] = (
        np.linalg.lstsq(
            total[np.ix_(free, free)] / own, pulls.sum(axis=0)[free] / scale[free], rcond=None
        )[0]
        / scale[free]
    )
    apart = direction - follow
    parts = np.einsum("kn,kmn,km->k", apart, curvature, apart)
    whole = float(np.einsum("kn,kn->", direction, pulls))
    information = float(parts.sum())
    if not information > _UNSEEN * whole:
        return None
    scores = np.einsum("kn,kn->k", apart, gradient)
    gamma = -float(scores.sum()) / information
    cost = float(equations.cost.sum())
    explained = gamma**2 * information
    logs = np.unique(equations.log, return_inverse=True)[1]
    own_scores = np.asarray(np.bincount(logs, scores), dtype=float)
    own_parts = np.asarray(np.bincount(logs, parts), dtype=float)
    of_logs = _chance(own_scores, own_parts, gamma, information)
    if conditions.steady:
        freedom = np.count_nonzero(np.any(equations.rows != 0, axis=2)) - free.sum() - 1
        left = max(cost - explained, np.finfo(float).tiny)
        chance = float(fdtrc(1, freedom, explained * freedom / left)) if freedom > 0 else 1.0
    else:
        chance = _chance(scores, parts, gamma, information)
        of_logs = chance if own_scores.size <= FEW else of_logs
    return _Tried(
        about=about,
        gamma=gamma,
        moves=-follow * gamma,
        share=explained / cost if cost > 0 else 0.0,
        chance=chance,
        of_logs=of_logs,
    )


def _chance(scores: Samples, parts: Samples, gamma: float, information: float) -> float:
    """Probability of such a slope by chance, by the scatter of clusters (see above)."""
    shares = parts / information
    freedom = 1 / float(np.sum(shares**2)) - 1
    errors = (scores + parts * gamma) / np.maximum(1 - shares, _UNSEEN)
    size = float(np.sqrt(np.sum(errors**2)))
    if not freedom > 0 or not size > 0:
        return 1.0
    return float(2 * stdtr(freedom, -abs(gamma) * information / size))


def _limits(each: _Tried) -> tuple[float, ...]:
    """Where a condition would disturb no more: at 0; of the input's sign there is no such place.

    Of masses that are weighed wrong, none is the wrong one for certain (see `weighed_within`).
    """
    if each.about.condition is Condition.WEIGHED:
        return ()
    return (-1.0, 1.0) if each.about.condition is Condition.DIRECTION else (0.0,)


def _rival(equations: CellEquations, each: _Tried, limit: float) -> Samples:
    """(n,) values at the limit of a condition."""
    moved = equations.values + each.moves
    moved[equations.names.index(each.about.parameter)] += each.gamma * (limit - each.about.mean)
    return np.maximum(moved, equations.lower)


def _matters(
    equations: CellEquations,
    each: _Tried,
    rivals: list[Samples],
    conditions: Conditions,
    of: tuple[str, ...] = ("p1", "p4"),
) -> bool:
    """Whether a contrast explains much, or moves p1 or p4, and logs as a whole say it as well."""
    names, values = equations.names, equations.values
    places = [names.index(name) for name in of if name in names]
    moved = max(
        (
            abs(rival[place] - values[place]) / (abs(values[place]) or np.inf)
            for rival in rivals
            for place in places
        ),
        default=0.0,
    )
    if not each.of_logs < _LEVEL:
        return False
    if conditions.steady:
        return moved > _MOVES_STEADY
    return each.share > _SHARES[not conditions.sines] or moved > _MOVES


def _contrast(equations: CellEquations, each: _Tried, chance: float) -> Contrast:
    """Say what a parameter is at either end of its condition, or what a mass would have to be."""
    about = each.about
    if about.condition is Condition.WEIGHED:
        least = largest = first = about.mean
        last = about.mean + each.gamma
    else:
        place = equations.names.index(about.parameter)
        middle = float(equations.values[place] + each.moves[place]) - each.gamma * about.mean
        least, largest = float(about.x.min()), float(about.x.max())
        first, last = middle + each.gamma * least, middle + each.gamma * largest
    return Contrast(
        parameter=about.parameter,
        condition=about.condition,
        least=least,
        largest=largest,
        first=first,
        last=last,
        share=each.share,
        chance=chance,
    )


def _pieces(log: Log, cells: int) -> list[tuple[Samples, Samples]]:
    """Return stamps since the start, and angles less their line, of each cell of a log."""
    pairs = zip(np.array_split(log.time, cells), np.array_split(log.angle, cells), strict=True)
    return [(time - log.time[0], angle) for time, angle in pairs]


def _repeated(values: Sequence[float], cells: int) -> Samples:
    return np.repeat(np.array(values, dtype=float), cells)


def _of_command(log: Log) -> float:
    """1 over the rms input, 0 of a log that nothing drives."""
    size = float(np.sqrt(np.mean(log.input**2)))
    return 1 / size if size else 0.0


def _omega_squared(log: Log) -> float:
    """Squared frequency in rad^2/s^2 of a sine, or that at which a motion is as fast as it is."""
    if log.excitation is not None:
        return log.excitation.omega**2
    return (log.rms_speed / (float(np.std(log.angle)) or np.inf)) ** 2


def _direction(log: Log) -> float:
    """Sign of the mean input; 0 of one that goes both ways."""
    size, mean = float(np.sqrt(np.mean(log.input**2))), float(np.mean(log.input))
    return float(np.sign(mean)) if abs(mean) > size / 2 else 0.0
