"""Whether all conditions agree on one set of values: contrasts, from the equations at the optimum.

A model with a missing term still follows the logs, with values that depend on the conditions. So
let one parameter j follow one condition x linearly (the added mass, 1/command, swing^2, omega^2,
1/speed, time in the log, the sign of the input), all others re-optimised to first order.
With the cells' curvature H_c = J^T J and gradient s_c = J^T r, and x about its mean,

    q = H^-1 sum x_c H_c e_j,  a_c = x_c e_j - q,  S = sum a_c^T s_c,  I = sum a_c^T H_c a_c,

the slope is gamma = -S/I. Its standard error is that of leaving out clusters k (jackknife),

    e_k = (z_k + I_k gamma) / (1 - I_k/I),  t = gamma I / sqrt(sum e_k^2),

with 1/sum((I_k/I)^2) - 1 degrees of freedom. The values at the condition's limit x*, theta -
gamma q + gamma (x* - mean x) e_j, are a rival that the intervals include. A mass that is weighed
wrong is a contrast as well: of p1 and p3 together, in its logs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc, stdtr

from butterfly.arrays import Samples, unit_diagonal
from butterfly.identification.inference.blocks import Condition, Conditions
from butterfly.identification.inference.covariance import cluster_covariance, half_widths
from butterfly.identification.levels import (
    ACCUSED,
    CONFIDENCE,
    FEW,
    MATERIAL,
    MATTERS,
    ROUNDING,
    SHOWS,
)
from butterfly.identification.linearisation import Linearisation
from butterfly.model.terms import DISSIPATIVE, PARAMETERS

# of the largest torque, above which a contrast of steady responses counts: integration errors are
# below; without it 3 of 57 sound robots had one (2 above this)
_LEAST_TORQUE = 1e-4

_LIMITS = {Condition.DIRECTION: (-1.0, 1.0), Condition.WEIGHED: ()}
"""Values of conditions at which their disturbance vanishes, where these are not 0."""

_SCATTERS = ("coulomb", "p2", "p4")

_OF_SCALE = ("p1", "p4")
_OF_FRICTION = tuple(row.name for row in DISSIPATIVE)


@dataclass(frozen=True, kw_only=True)
class Contrast:
    """One parameter that follows one condition, though it should be constant."""

    parameter: str  # or, of a mass that is weighed wrong, "mass"
    condition: Condition
    least: float  # least, largest: of the condition, in SI units of `Conditions`, or kg
    largest: float
    first: float  # first, last: the parameter there; of a mass the given and the fitted value
    last: float
    share: float  # of the squared errors that it explains
    chance: float  # p-value, corrected for all contrasts that were tried

    @property
    def grows(self) -> bool:
        """Whether the parameter grows with the condition."""
        return self.last > self.first

    @property
    def play(self) -> float:
        """Gap in rad, by a delay in proportion to 1/speed: the encoder lags by half of it."""
        if self.condition is not Condition.SPEED:
            return 0.0
        return 2 * (self.last - self.first) / (self.largest - self.least)


class _Tried(NamedTuple):
    """A contrast that was tried."""

    parameter: str  # parameter, condition: of the contrast
    condition: Condition
    mean: float  # of the condition, weighted by information; of a mass its value in kg
    x: Samples  # (k,) the condition
    direction: Samples  # (k, n) along which the values move with a slope of 1
    gamma: float = 0.0  # the slope
    at_mean: Samples = np.empty(0)  # (n,) values with that slope, at the mean of the condition
    share: float = 0.0  # of the squared errors that it explains
    chance: float = 1.0  # p-value by the scatter between cells
    of_logs: float = 1.0  # the same by the scatter between logs

    def at(self, x: float, place: int) -> Samples:
        """(n,) values where the condition is x, the parameter being numbered ``place``."""
        moved = self.at_mean.copy()
        moved[place] += self.gamma * (x - self.mean)
        return moved


# a significant and relevant contrast, with limits of its condition and the (n,) values there
_Accepted = tuple[Contrast, _Tried, list[tuple[float, Samples]]]


class Rival(NamedTuple):
    """Values at the limit of a condition that a parameter follows."""

    values: Samples  # (n,)
    half_widths: Samples  # (n,) of their intervals, by the residuals with that contrast


def disagreements_of(
    equations: Linearisation, conditions: Conditions
) -> tuple[tuple[Contrast, ...], tuple[Rival, ...]]:
    """Return the significant and relevant contrasts, the best first, and their rivals."""
    accepted = _accepted(equations, conditions)
    rivals = (
        Rival(end, _widths_at(equations, each, limit, end))
        for _, each, ends in accepted
        for limit, end in ends
    )
    return tuple(contrast for contrast, *_ in accepted), tuple(rivals)


def contrasts_of(
    equations: Linearisation, conditions: Conditions
) -> tuple[tuple[Contrast, ...], list[Samples]]:
    """Return the same contrasts and those from log to log, and (n,) values of their rivals."""
    accepted = _accepted(equations, conditions)
    every = [*(each for each, *_ in accepted), *from_log_to_log(equations.of_logs)]
    found = tuple(sorted(every, key=lambda each: -each.share))
    if found and found[0].condition is Condition.LOG:
        differing = differing_values(equations, found[0].parameter)
        return found, [] if differing is None else [differing]
    return found, [end for *_, each in accepted for _, end in each]


def friction_rivals(equations: Linearisation, conditions: Conditions) -> list[Samples]:
    """Return (n,) values of which friction is that of the significant contrasts that move it.

    Where most of the error is no noise, it may stand for what the model lacks.
    """
    friction = np.isin(equations.names, _OF_FRICTION)
    of = tuple(name for name in _OF_FRICTION if name in PARAMETERS)
    accepted = _accepted(equations, conditions, of)
    return [np.where(friction, end, equations.values) for *_, e in accepted for _, end in e]


def _accepted(
    equations: Linearisation, conditions: Conditions, of: tuple[str, ...] = _OF_SCALE
) -> list[_Accepted]:
    asked = [*_of_parameters(equations, conditions), *_of_masses(equations, conditions)]
    tried = [found for each in asked if (found := _solved(equations, each))]
    tried.sort(key=lambda each: each.chance)
    accepted: list[_Accepted] = []
    for passed, each in enumerate(tried):
        chance = each.chance * (len(tried) - passed)  # Holm, Scand. J. Statist. 6, 1979
        if not chance < 1 - CONFIDENCE:
            break
        limits = _LIMITS.get(each.condition, (0.0,))
        if each.condition is Condition.TIME:  # whose disturbance vanishes nowhere
            limits = float(each.x.min()), float(each.x.max())
        place = 0 if not limits else equations.names.index(each.parameter)
        ends = [np.maximum(each.at(limit, place), equations.lower) for limit in limits]
        moved = (*of, *(("delay",) if each.condition is Condition.REGIME else ()))
        if _matters(equations, each, ends or [each.at_mean], moved):
            pairs = list(zip(limits, ends, strict=True))
            accepted.append((_contrast(each, place, chance), each, pairs))
    return sorted(accepted, key=lambda each: -each[0].share)


def score_of(equations: Linearisation, name: str) -> float | None:
    """Return the p-value of the score test of a parameter that is held; None if unidentifiable."""
    every = np.ones(equations.log.size)
    unit = np.outer(every, np.array(equations.names) == name)
    found = _solved(equations, _Tried(name, Condition.ALL, 0.0, every, unit))
    return None if found is None else max(found.chance, found.of_logs)


def weighed_within(contrasts: Sequence[Contrast]) -> float:
    """Return the least relative change of an added mass that makes logs agree; 0 if they do."""
    wrong = [each for each in contrasts if each.condition is Condition.WEIGHED]
    return min((abs(each.last / each.first - 1) for each in wrong), default=0.0)


def _of_parameters(equations: Linearisation, conditions: Conditions) -> Iterator[_Tried]:
    """Yield each parameter of the scale with each condition that differs from cell to cell."""
    for condition, x in conditions.values.items():
        for place, name in enumerate(equations.names):
            weight = equations.curvatures[:, place, place]
            # the time to cross a gap falls as 1/speed, and regimes of a clock may differ by a
            # message; a delay follows nothing else
            of_delay = condition in {Condition.SPEED, Condition.REGIME}
            follows = name in PARAMETERS and (name == "delay") is of_delay
            held = not follows or equations.on_bound[place]
            if held or not (np.ptp(x) > 0 and weight.sum() > 0):
                continue
            mean = float(weight @ x / weight.sum())
            direction = np.outer(x - mean, np.arange(len(equations.names)) == place)
            yield _Tried(name, condition, mean, x, direction)


def _of_masses(equations: Linearisation, conditions: Conditions) -> Iterator[_Tried]:
    """Yield an error of each added mass, where there are enough different ones."""
    names, masses = equations.names, conditions.masses
    effects = {mass.inertia_and_moment for mass in masses}
    # of two masses, one equal to the other would explain everything
    if len(effects) < FEW or not {"p1", "p3"} <= {*names}:
        return
    for mass in sorted({mass for mass in masses if mass.mass}):
        x = np.array([float(masses[number] == mass) for number in equations.log])
        moves = {"p1": mass.arm**2, "p3": mass.gravity * mass.arm}
        direction = np.outer(x, [moves.get(name, 0.0) for name in names])
        yield _Tried("mass", Condition.WEIGHED, mass.mass, x, direction)


def _solved(equations: Linearisation, asked: _Tried) -> _Tried | None:
    """Return a contrast with its slope and p-values; None if it is not identifiable."""
    rest, parts = equations.orthogonalised(asked.direction)
    information = float(parts.sum())
    if not information:
        return None
    scores = np.einsum("kn,kn->k", rest, equations.gradients)
    gamma, cost = -float(scores.sum()) / information, float(equations.squares.sum())
    explained = gamma**2 * information
    logs = np.unique(equations.log, return_inverse=True)[1]
    sums = (np.asarray(np.bincount(logs, each), dtype=float) for each in (scores, parts))
    of_logs, chance = _chance(*sums, gamma=gamma), _chance(scores, parts, gamma=gamma)
    return asked._replace(
        gamma=gamma,
        at_mean=equations.values - (asked.direction - rest)[0] * gamma,
        share=explained / cost if cost > 0 else 0.0,
        chance=chance,
        of_logs=of_logs if logs.max() >= FEW else chance,
    )


def _widths_at(equations: Linearisation, each: _Tried, limit: float, values: Samples) -> Samples:
    """(n,) half-widths of (n,) values at a condition's limit, the slope being estimated too."""
    unit = np.array([name == each.parameter for name in equations.names])
    slope = np.einsum("kmn,kn->km", equations.stack[0], np.outer(each.x - limit, unit)).ravel()
    left = equations.residuals + equations.rows @ (values - equations.values) + slope * each.gamma
    whole = replace(
        equations,
        names=(*equations.names, "slope"),
        values=np.append(values, each.gamma),
        lower=np.append(equations.lower, -np.inf),
        held=np.append(equations.on_bound, [False]),
        rows=np.column_stack([equations.rows, slope]),
        residuals=left,
        prior=None if equations.prior is None else equations.prior.padded(1),
    ).independent
    try:
        covariance, freedom = cluster_covariance(*whole.stack, whole.prior)
    except np.linalg.LinAlgError:  # no cell tells the slope from the rest
        return np.full(values.size, np.inf)
    return np.asarray(half_widths(covariance, freedom)[:-1])


def from_log_to_log(equations: Linearisation) -> Iterator[Contrast]:
    """Yield friction or gain that differs from log to log (adjusted F test); each log is a cell."""
    cost = float(equations.squares.sum())
    rows = np.count_nonzero(equations.rows.any(axis=1)) - len(equations.names)
    more = equations.log.size - 1
    if rows - more < 1 or not cost > 0:
        return
    for place in np.flatnonzero(np.isin(equations.names, _SCATTERS) & ~equations.on_bound).tolist():
        change = _in_each_log(equations, place)
        if change is None:
            continue
        explained = -float(change @ equations.gradients[:, place])
        left = max((cost - explained) / (rows - more), ROUNDING * cost)
        chance = float(fdtrc(more, rows - more, explained / more / left)) * len(_SCATTERS)
        scatter = float(np.std(change)) / (abs(float(equations.values[place])) or np.inf)
        share = 1 - left / (cost / rows)
        if chance < ACCUSED and scatter > MATTERS and _is_relevant(equations, share):
            values = equations.values[place] + change
            yield Contrast(
                parameter=equations.names[place],
                condition=Condition.LOG,
                least=0.0,
                largest=float(more),
                first=float(values.min()),
                last=float(values.max()),
                share=share,
                chance=chance,
            )


def differing_values(equations: Linearisation, name: str) -> Samples | None:
    """(n,) values if one of them were local to each log, with its mean; None if undetermined."""
    equations, place = equations.of_logs, equations.names.index(name)
    change = _in_each_log(equations, place)
    if change is None:
        return None
    pull = np.einsum("kn,k->n", equations.curvatures[:, :, place], change)
    values = equations.values - equations.inverse @ pull
    values[place] += change.mean()
    return np.asarray(values)


def _in_each_log(equations: Linearisation, place: int) -> Samples | None:
    """(k,) deviations of a value in each log from their mean; None if not identifiable."""
    pulls = equations.curvatures[:, :, place]
    reduced = np.diag(pulls[:, place]) - pulls @ equations.inverse @ pulls.T
    scaled, size = unit_diagonal(reduced)
    powers, axes = np.linalg.eigh(scaled)
    if not (np.diag(reduced) > 0).all() or powers[1:].min(initial=1.0) < SHOWS:
        return None
    axes, powers = axes[:, 1:], powers[1:]  # the least is that of a change common to all logs
    return np.asarray(-(axes / powers) @ (axes.T @ (equations.gradients[:, place] / size)) / size)


def _chance(scores: Samples, parts: Samples, *, gamma: float) -> float:
    """Two-sided p-value of a slope, by the scatter of clusters (see above)."""
    information = parts.sum()
    shares = parts / information
    freedom = 1 / float(np.sum(shares**2)) - 1
    errors = (scores + parts * gamma) / np.maximum(1 - shares, ROUNDING)
    size = float(np.sqrt(np.sum(errors**2)))
    if not freedom > 0 or not size > 0:
        return 1.0
    return float(2 * stdtr(freedom, -abs(gamma) * information / size))


def _matters(
    equations: Linearisation, each: _Tried, rivals: list[Samples], of: tuple[str, ...]
) -> bool:
    """Whether a contrast is significant between logs too, and explains much or moves parameters."""
    kept = np.isin(equations.names, of) & (equations.values != 0)
    moved = np.max(np.abs(np.array(rivals)[:, kept] / equations.values[kept] - 1), initial=0.0)
    if not each.of_logs < 1 - CONFIDENCE:
        return False
    return bool(each.share > MATERIAL or moved > MATTERS)


def _is_relevant(equations: Linearisation, share: float) -> bool:
    """Whether a share of the squared errors exceeds the errors of the integration."""
    torques = np.abs(equations.values) * np.sqrt(np.diag(equations.curvature))
    return bool(share * equations.squares.sum() > (_LEAST_TORQUE * torques.max()) ** 2)


def _contrast(each: _Tried, place: int, chance: float) -> Contrast:
    """Return a contrast: a parameter at both ends of its condition, or a mass given and fitted."""
    least, largest = float(each.x.min()), float(each.x.max())
    if each.condition is Condition.WEIGHED:
        least = largest = each.mean
        first, last = each.mean, each.mean + each.gamma
    else:
        first, last = (float(each.at(x, place)[place]) for x in (least, largest))
    return Contrast(
        parameter=each.parameter,
        condition=each.condition,
        least=least,
        largest=largest,
        first=first,
        last=last,
        share=each.share,
        chance=chance,
    )
