"""Whether all conditions agree on one set of values: contrasts, from the equations at the optimum.

A model with a missing term still follows the logs, with values that depend on the conditions. So
let one parameter j follow one condition x linearly (the added mass, 1/command, swing^2, omega^2,
1/speed, time in the log, the sign of the input), all others re-optimised to first order.
With the cells' curvature H_c = J^T J and gradient s_c = J^T r about the least squares theta, and x
about its mean,

    q = H^-1 sum x_c H_c e_j,  a_c = x_c e_j - q,  S = sum a_c^T s_c,  I = sum a_c^T H_c a_c,

the slope is gamma = -S/I. Its standard error is that of leaving out clusters k (jackknife),

    e_k = (z_k + I_k gamma) / (1 - I_k/I),  t = gamma I / sqrt(sum e_k^2),

with 1/sum((I_k/I)^2) - 1 degrees of freedom. The values at the condition's limit x*, theta -
gamma q + gamma (x* - mean x) e_j, are a rival that the intervals include. A mass that is weighed
wrong is a contrast as well: of p1 and p3 together, in its logs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc, stdtr

from butterfly.arrays import ROUNDING, Samples, unit_diagonal
from butterfly.identification.limits import Rival, cluster_covariance, half_widths
from butterfly.identification.linearisation import Linearisation
from butterfly.identification.trust import ACCUSED, CLEARLY, FEW, MATERIAL, MATTERS, SHOWS
from butterfly.logs.log import Log, slow_interval
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import CHANGING, DISSIPATIVE, OF_SCALE, PARAMETERS
from butterfly.signals.frequency_response import white_variance
from butterfly.verdict import CONFIDENCE


class Condition(StrEnum):
    """A condition that a parameter may follow."""

    MASS = "added mass"
    COMMAND = "command"
    SWING = "swing"
    FREQUENCY = "frequency"
    SPEED = "speed"
    TIME = "time"
    DIRECTION = "direction"
    REGIME = "regime"
    WEIGHED = "weighed"
    LOG = "log"
    ALL = "all"


@dataclass(frozen=True, kw_only=True, eq=False)
class Conditions:
    """Conditions of k cells, and added masses of their logs."""

    # by condition: (k,) inertia of the added mass in kg m^2, 1/rms input, mean squared swing in
    # rad^2, omega^2 in rad^2/s^2 (the others' mean in logs without a full period), 1/speed, time
    # since the start in s, sign of the input, share in which the clock is slow
    values: Mapping[Condition, Samples]
    masses: tuple[AddedMass, ...]  # of the n logs

    @classmethod
    def of(cls, logs: Sequence[Log], cells: int) -> Conditions:
        """Compute them from logs, each cut into some cells."""
        angles = (part for log in logs for part in np.array_split(log.angle, cells))
        times = (part - log.time[0] for log in logs for part in np.array_split(log.time, cells))
        of_logs = [_of_log(log) for log in logs]
        values = {
            **{n: np.repeat([row[n] for row in of_logs], cells) for n in of_logs[0]},
            Condition.SWING: np.array([np.var(part) for part in angles]),
            Condition.TIME: np.array([part.mean() for part in times]),
        }
        if limit := slow_interval(logs):
            slow = (log.is_slow(limit)[-log.time.size :] for log in logs)
            parts = (part.mean() for mask in slow for part in np.array_split(mask, cells))
            values[Condition.REGIME] = np.fromiter(parts, np.float64)
        if cells == 1:
            del values[Condition.TIME]
        whole = ~np.isnan(squares := values[Condition.FREQUENCY])
        if whole.any():
            squares[~whole] = squares[whole].mean()
        else:
            del values[Condition.FREQUENCY]
        # of fewer logs of either sign, differences are not significant
        signs = values[Condition.DIRECTION][::cells]
        if min(np.sum(signs > 0), np.sum(signs < 0)) < 2 * FEW:
            del values[Condition.DIRECTION]
        return cls(values=values, masses=tuple(log.added_mass for log in logs))


def pace_of(log: Log) -> float:
    """Return the angular frequency in rad/s at which a log moves: of its drive, or rms."""
    if log.excitation is not None:
        return log.excitation.omega
    return log.rms_speed / (log.rms_motion or np.inf)


def _repeats(log: Log) -> bool:
    """Whether a log holds a full period: its angle is on one side, the other, the first again.

    Each time by half the amplitude of a sine as large, and what noise adds to it.
    """
    if log.excitation is not None:
        return True
    off = log.angle - log.angle.mean()
    noise = math.sqrt(white_variance(log.angle))
    sides = np.sign(off[abs(off) > log.rms_motion / math.sqrt(2) + CLEARLY * noise])
    return bool(np.count_nonzero(np.diff(sides)) > 1)


def _of_log(log: Log) -> dict[Condition, float]:
    """Return conditions that are constant in a log: 0 without input, motion or one direction.

    A log without a full period has no frequency: NaN.
    """
    size, mean = float(np.sqrt(np.mean(log.input**2))), float(np.mean(log.input))
    return {
        Condition.MASS: log.added_mass.inertia,
        Condition.COMMAND: 1 / size if size else 0.0,
        Condition.FREQUENCY: pace_of(log) ** 2 if _repeats(log) else np.nan,
        Condition.SPEED: log.lag_per_play,
        Condition.DIRECTION: float(np.sign(mean)) if abs(mean) > size / 2 else 0.0,
    }


# of the largest torque, above which a contrast of steady responses counts: integration errors are
# below; without it 3 of 57 sound robots had one (2 above this)
_LEAST_TORQUE = 1e-4

_LIMITS = {Condition.DIRECTION: (-1.0, 1.0), Condition.WEIGHED: ()}
"""Values of conditions at which their disturbance vanishes, where these are not 0."""

_OF_FRICTION = tuple(row.name for row in DISSIPATIVE)
_FRICTION_OF_ALL = tuple(name for name in _OF_FRICTION if name in PARAMETERS)


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


class _Significant(NamedTuple):
    """A contrast that is no chance."""

    contrast: Contrast
    tried: _Tried
    ends: list[tuple[float, Samples]]  # limits of its condition, and the (n,) values there

    def matters(self, equations: Linearisation, of: Sequence[str]) -> bool:
        """Whether it is significant between logs too, and explains much or moves some values."""
        also = ("delay",) if self.tried.condition is Condition.REGIME else ()
        mask = np.isin(equations.names, [*of, *also]) & (equations.values != 0)
        there = np.array([end for _, end in self.ends] or [self.tried.at_mean])
        moved = np.max(np.abs(there[:, mask] / equations.values[mask] - 1), initial=0.0)
        if not self.tried.of_logs < 1 - CONFIDENCE:
            return False
        return bool(self.tried.share > MATERIAL or moved > MATTERS)


def disagreements_of(
    equations: Linearisation,
    conditions: Conditions,
    *,
    between_logs: bool = False,
    large: bool = False,
) -> tuple[tuple[Contrast, ...], list[Rival]]:
    """Return the significant and relevant contrasts, the best first, and their rivals.

    ``between_logs``: Those from log to log, too, whose rival counts if it is the best of all.
    ``large``: Whether most of the error is no noise, and may stand for what the model lacks: then
    rivals are as uncertain as the fit, whatever contrasts leave of the residuals, and friction has
    rivals of its own, by the contrasts that move it.
    """
    fitted, equations = equations.values, _at_least_squares(equations)
    significant = _significant(equations, conditions)
    relevant = [
        disagreement for disagreement in significant if disagreement.matters(equations, OF_SCALE)
    ]
    relevant.sort(key=lambda disagreement: -disagreement.tried.share)
    rivals = [
        Rival(
            end,
            None if large else _widths_at(equations, disagreement.tried, limit, end),
            predicts=False,
        )
        for disagreement in relevant
        for limit, end in disagreement.ends
    ]
    contrasts = [disagreement.contrast for disagreement in relevant]
    if between_logs:
        contrasts += from_log_to_log(equations.whole_logs)
        contrasts.sort(key=lambda contrast: -contrast.share)
        if contrasts and contrasts[0].condition is Condition.LOG:
            differing = differing_values(equations, contrasts[0].parameter)
            rivals += [] if differing is None else [Rival(differing, predicts=False)]
    friction = np.isin(equations.names, _OF_FRICTION)
    rivals += [
        Rival(np.where(friction, end, fitted), predicts=False)
        for disagreement in (significant if large else ())
        if disagreement.matters(equations, _FRICTION_OF_ALL)
        for _, end in disagreement.ends
    ]
    return tuple(contrasts), rivals


def _at_least_squares(equations: Linearisation) -> Linearisation:
    """Return the equations about their solution, which a fit need not reach where it is flat."""
    return equations.moved(equations.next_step)


def _significant(equations: Linearisation, conditions: Conditions) -> list[_Significant]:
    """Return the contrasts that are no chance, the least likely first."""
    asked = [*_of_parameters(equations, conditions), *_of_masses(equations, conditions)]
    tried = [solved for trial in asked if (solved := _solved(equations, trial))]
    tried.sort(key=lambda trial: trial.chance)
    significant: list[_Significant] = []
    for passed, trial in enumerate(tried):
        chance = trial.chance * (len(tried) - passed)  # Holm, Scand. J. Statist. 6, 1979
        if not chance < 1 - CONFIDENCE:
            break
        limits = _LIMITS.get(trial.condition, (0.0,))
        if trial.condition is Condition.TIME:  # whose disturbance vanishes nowhere
            limits = float(trial.x.min()), float(trial.x.max())
        place = 0 if not limits else equations.names.index(trial.parameter)
        ends = [(limit, np.maximum(trial.at(limit, place), equations.lower)) for limit in limits]
        significant.append(_Significant(_contrast(trial, place, chance), trial, ends))
    return significant


def score_of(equations: Linearisation, name: str) -> float | None:
    """Return the p-value of the score test of a parameter that is held; None if unidentifiable."""
    every = np.ones(equations.log.size)
    unit = np.outer(every, np.array(equations.names) == name)
    tried = _solved(equations, _Tried(name, Condition.ALL, 0.0, every, unit))
    return None if tried is None else max(tried.chance, tried.of_logs)


def weighed_within(contrasts: Sequence[Contrast]) -> float:
    """Return the least relative change of an added mass that makes logs agree; 0 if they do."""
    wrong = [contrast for contrast in contrasts if contrast.condition is Condition.WEIGHED]
    return min((abs(contrast.last / contrast.first - 1) for contrast in wrong), default=0.0)


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
    sums = (np.asarray(np.bincount(logs, weights), dtype=float) for weights in (scores, parts))
    of_logs, chance = _chance(*sums, gamma=gamma), _chance(scores, parts, gamma=gamma)
    return asked._replace(
        gamma=gamma,
        at_mean=equations.values - (asked.direction - rest)[0] * gamma,
        share=explained / cost if cost > 0 else 0.0,
        chance=chance,
        of_logs=of_logs if logs.max() >= FEW else chance,
    )


def _widths_at(equations: Linearisation, tried: _Tried, limit: float, values: Samples) -> Samples:
    """(n,) half-widths of (n,) values at a condition's limit, the slope being estimated too."""
    unit = np.array([name == tried.parameter for name in equations.names])
    slope = np.einsum("kmn,kn->km", equations.stack[0], np.outer(tried.x - limit, unit)).ravel()
    residuals = (
        equations.residuals + equations.rows @ (values - equations.values) + slope * tried.gamma
    )
    whole = replace(
        equations,
        names=(*equations.names, "slope"),
        values=np.append(values, tried.gamma),
        lower=np.append(equations.lower, -np.inf),
        held=np.append(equations.on_bound, [False]),
        rows=np.column_stack([equations.rows, slope]),
        residuals=residuals,
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
    for place in np.flatnonzero(np.isin(equations.names, CHANGING) & ~equations.on_bound).tolist():
        change = _in_each_log(equations, place)
        if change is None:
            continue
        explained = -float(change @ equations.gradients[:, place])
        variance = max((cost - explained) / (rows - more), ROUNDING * cost)
        chance = float(fdtrc(more, rows - more, explained / more / variance)) * len(CHANGING)
        scatter = float(np.std(change)) / (abs(float(equations.values[place])) or np.inf)
        share = 1 - variance / (cost / rows)
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
    equations, place = equations.whole_logs, equations.names.index(name)
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


def _is_relevant(equations: Linearisation, share: float) -> bool:
    """Whether a share of the squared errors exceeds the errors of the integration."""
    torques = np.abs(equations.values) * np.sqrt(np.diag(equations.curvature))
    return bool(share * equations.squares.sum() > (_LEAST_TORQUE * torques.max()) ** 2)


def _contrast(tried: _Tried, place: int, chance: float) -> Contrast:
    """Return a contrast: a parameter at both ends of its condition, or a mass given and fitted."""
    least, largest = float(tried.x.min()), float(tried.x.max())
    if tried.condition is Condition.WEIGHED:
        least = largest = tried.mean
        first, last = tried.mean, tried.mean + tried.gamma
    else:
        first, last = (float(tried.at(x, place)[place]) for x in (least, largest))
    return Contrast(
        parameter=tried.parameter,
        condition=tried.condition,
        least=least,
        largest=largest,
        first=first,
        last=last,
        share=tried.share,
        chance=chance,
    )
