"""Random effects from log to log, the weights that include them, and nested models of a fit."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.optimize import minimize

from butterfly.arrays import ROUNDING, Samples, unit_columns, unit_diagonal
from butterfly.identification.limits import CELLS
from butterfly.identification.linearisation import Linearisation
from butterfly.identification.trust import CLEARLY, FEW, MATTERS, Finding, FindingKind
from butterfly.model.parameters import value_if_absent
from butterfly.model.prior import Penalty
from butterfly.model.terms import DISSIPATIVE, FOLLOWERS, GROWING

NEGLIGIBLE = 1e-6
"""Share of a motion below which a prediction error is rounding."""

_SINGULAR = 1e-11  # eigenvalue over the largest, below which a combination is undetermined


@dataclass(frozen=True, kw_only=True, eq=False)
class Submodels:
    """All fits of subsets of the n parameters of equations in k cells."""

    equations: Linearisation
    # (k,) indices of the folds of the data, which are held out one at a time
    folds: NDArray[np.intp]
    # values that were set, as the Stribeck velocity, which is no parameter here
    settings: dict[str, float] = field(default_factory=dict)
    negligible: float = 0.0  # size of an error by rounding

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return self.equations.names

    def about(self, values: Samples) -> Submodels:
        """Return the same equations about other (n,) values."""
        moved = self.equations.moved(values - self.equations.values)
        return replace(self, equations=replace(moved, values=values, held=None))

    def fitted(self, masks: NDArray[np.bool_]) -> Samples:
        """Return (t, n) values of t fits of (t, n) masks of parameters; nan if undetermined."""
        return self._fitted(self.equations.curvature, self.equations.gradient, masks)

    def held_out(self, masks: NDArray[np.bool_]) -> Samples:
        """(t, k) squared errors of cells by fits without their fold; nan if undetermined."""
        errors = self._left_out(masks, self.folds)
        if np.isfinite(errors[0]).all() or np.unique(self.folds).size == self.folds.size:
            return errors
        return self._left_out(masks, np.arange(self.folds.size))  # each cell a fold

    def _left_out(self, masks: NDArray[np.bool_], folds: NDArray[np.intp]) -> Samples:
        parts, every = np.unique(folds), self.equations
        errors = np.empty((len(masks), folds.size))
        lost = np.full(len(masks), parts.size == 1)
        at_once = max(1, 4096 // len(masks))  # which bounds the memory that the fits take
        for some in np.split(parts, range(at_once, parts.size, at_once)):
            left_out = folds == some[:, None]
            curvature, gradient = (
                np.repeat(whole - np.tensordot(left_out, cells, 1), len(masks), axis=0)
                for whole, cells in (
                    (every.curvature, every.curvatures),
                    (every.gradient, every.gradients),
                )
            )
            fits = self._fitted(curvature, gradient, np.tile(masks, (some.size, 1)))
            for mine, values in zip(left_out, np.split(fits, some.size), strict=True):
                lost |= np.isnan(values).any(axis=1)
                errors[:, mine] = self.costs(values)[:, mine]
        errors = np.nan_to_num(errors, nan=np.inf, posinf=np.inf)
        return np.where(lost[:, np.newaxis], np.nan, errors)

    def costs(self, values: Samples) -> Samples:
        """(t, k) squared errors of the cells with (t, n) values."""
        steps, at = values - self.equations.values, self.equations
        bent = np.einsum("tn,knt->tk", steps, at.curvatures @ steps.T)
        return np.asarray(np.maximum(at.squares + 2 * steps @ at.gradients.T + bent, 0.0))

    def _fitted(self, curvature: Samples, gradient: Samples, masks: NDArray[np.bool_]) -> Samples:
        """(t, n) values of fits of (t, n) ``masks``; others are as if their term were absent."""
        # parameters that only another term identifies stay as they are when absent
        followers = [name in FOLLOWERS for name in self.names]
        without = [value_if_absent(name) for name in self.names]
        absent = np.where(followers, self.equations.values, without)
        return _bounded(self.equations, (curvature, gradient), masks, absent)


def submodels_of(
    equations: Linearisation, parts: Sequence[Hashable], negligible: float
) -> Submodels:
    """Return the nested models of equations; folds are ``parts`` of logs, or cells of few logs."""
    cells = equations.independent
    few = cells.log.size > np.unique(cells.log).size
    folds = np.arange(cells.log.size) if few else folds_of([parts[k] for k in cells.log])
    return Submodels(equations=cells, folds=folds, negligible=negligible)


def folds_of(parts: Sequence[Hashable]) -> NDArray[np.intp]:
    """Return the (n,) fold of each of n logs: its part, or the log itself where parts are few."""
    different = list(dict.fromkeys(parts))
    if len(different) < FEW:
        return np.arange(len(parts))
    return np.array([different.index(part) for part in parts])


def without_logs(equations: Linearisation, logs: Iterable[int]) -> Samples:
    """Return (n,) values without some logs, to first order (linear jackknife); or nan."""
    rest = equations.without(logs)
    partial, whole = (np.einsum("kii->i", system.curvatures) for system in (rest, equations))
    moved = (partial > ROUNDING**2 * whole) | (whole == 0)  # others are identified by these alone
    return np.asarray(
        _bounded(equations, (rest.curvature, rest.gradient), moved[np.newaxis], equations.values)[0]
    )


def _bounded(
    about: Linearisation, total: tuple[Samples, Samples], masks: NDArray[np.bool_], absent: Samples
) -> Samples:
    """(t, n) bounded solutions for (t, n) ``masks`` of parameters; nan if undetermined."""
    (curvature, gradient), at, lower = total, about.values, about.lower
    held, (count, size) = np.maximum(at, lower), masks.shape
    curvature = np.broadcast_to(curvature, (count, size, size))
    gradient = np.broadcast_to(gradient, masks.shape)
    values = np.where(masks, held, absent)
    idle = ~(np.einsum("tnn->tn", curvature) > 0) & (held <= lower)
    free = masks & ~idle
    rows = np.flatnonzero(free.any(axis=1))
    while rows.size:
        some = curvature[rows]
        pull = gradient[rows] + np.einsum("tm,tmn->tn", values[rows] - at, some)
        solved = values[rows] + _solved(some, -pull, free[rows])
        low = free[rows] & (solved < lower)
        values[rows] = np.where(free[rows], np.maximum(solved, lower), values[rows])
        free[rows] &= ~low
        rows = rows[low.any(axis=1) & free[rows].any(axis=1)]
    return values


def _solved(matrix: Samples, targets: Samples, free: NDArray[np.bool_]) -> Samples:
    """(t, n) solutions of (t, n, n) normal equations for ``free`` ones, else 0; nan if singular."""
    lost = np.asarray((free & ~(np.einsum("tnn->tn", matrix) > 0)).any(axis=1))
    scaled, scale = unit_diagonal(matrix)
    asked = free & ~lost[:, np.newaxis]
    both = asked[:, :, np.newaxis] & asked[:, np.newaxis, :]
    matrices = np.where(both, scaled, np.eye(scale.shape[1]))
    try:
        inverses = np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        inverses = np.full_like(matrices, np.nan)
    # an upper bound of the condition number, cheaper than its eigenvalues
    ratios = np.linalg.norm(matrices, axis=(1, 2)) * np.linalg.norm(inverses, axis=(1, 2))
    doubtful = ~(ratios < 1 / _SINGULAR)
    if doubtful.any():
        eigenvalues, axes = np.linalg.eigh(matrices[doubtful])
        eigenvalues[eigenvalues[:, 0] < _SINGULAR * eigenvalues[:, -1]] = np.nan
        inverses[doubtful] = axes / eigenvalues[:, None, :] @ np.swapaxes(axes, 1, 2)
    inverses[lost] = np.nan
    pulls = np.where(asked, targets / scale, 0.0)
    return np.asarray((inverses @ pulls[:, :, None])[:, :, 0] / scale)


_MOST = 100.0  # usual sizes, up to which the likeliest is sought
_BEGINS = 0.5, 0.01  # usual sizes, from which it is sought

FRICTION = frozenset({row.name for row in DISSIPATIVE} & GROWING)
"""Terms of friction."""

_USUAL = (0.003, 0.1, 0.02)
"""Usual misfit over the motion, and usual relative scatter of friction and of the gain: standard
deviations of their priors, the first in addition to the level of the noise."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scatter:
    """Standard deviations of the random effects, and those of k logs in n values."""

    misfit: float  # of errors by neither noise nor parameters, over the motion
    friction: float  # of every term of friction from log to log, over its value
    gain: float  # of p4 from log to log, over its value
    names: tuple[str, ...] = ()  # of the n values
    # (k, n) what each log is simulated with besides
    effects: Samples = field(default_factory=lambda: np.empty((0, 0)))
    noise: tuple[Samples, ...] = ()  # (m,) errors of each log, with the autocovariance of noise

    @property
    def sizes(self) -> Samples:
        """(3,) misfit, friction and gain."""
        return np.array([self.misfit, self.friction, self.gain])

    def own_of(self, names: Sequence[str]) -> Samples:
        """(k, m) deviations of each log from some values, by name; 0 of names without one."""
        effects = np.zeros((len(self.effects), len(names)))
        for place, name in enumerate(names):
            if name in self.names:
                effects[:, place] = self.effects[:, self.names.index(name)]
        return effects

    def weighed(self, at: Linearisation, values: Samples, effects: Samples) -> Linearisation:
        """Return equations of k logs about (n,) values, with errors of variance 1.

        The logs were simulated at these values and (k, n) ``effects`` besides.
        """
        return Likelihood(at, values, effects, noise=self.noise).weighed(self)

    def random_effects(self, at: Linearisation, step: Samples) -> Samples:
        """(k, n) predicted (BLUP) deviations of logs from values an (n,) step from `weighed` ones.

        With W'W = 1/V they are -D R'W'W (r + R step), D the variances of the effects.
        """
        rows, residuals = at.stack
        pull = np.einsum("kqn,kq->kn", rows, residuals + rows @ step)
        return np.asarray(-pull * (self.sizes[1:] ** 2 @ spread_of(at.names, at.values) ** 2))


def spread_of(names: Sequence[str], values: Samples) -> Samples:
    """(2, n) values of the terms of friction, and of the gain; 0 of other parameters."""
    whose = [[name in FRICTION for name in names], [name == "p4" for name in names]]
    return np.where(whose, values, 0.0)


class Likelihood:
    """Minus twice the restricted log-likelihood of k logs, a function of `Scatter.sizes`.

    The logs were simulated at (n,) values and (k, n) ``effects`` besides. ``prior``: of the values,
    with weights for errors of variance 1. ``noise``: (m,) errors of each log, of which the noise
    has the autocovariance; those that the values leave if not given.
    """

    def __init__(
        self,
        at: Linearisation,
        values: Samples,
        effects: Samples | None = None,
        prior: Penalty | None = None,
        noise: Sequence[Samples] = (),
    ) -> None:
        self._at, self._values, count = at, values, values.size
        logs = [np.split(array, at.ends[:-1]) for array in (at.residuals, at.rows)]
        coordinates = [_coordinates(*log) for log in zip(*logs, strict=True)]
        self.noise = tuple(noise) or tuple(row[-1] for row in coordinates)
        sizes = np.array([along.size for _, along, *_ in coordinates])
        self._present = np.arange(sizes.max()) < sizes[:, None]
        shape = self._present.shape
        self._rows, self._residuals = np.zeros((*shape, count)), np.zeros(shape)
        self._noise = np.tile(np.eye(shape[1]), (shape[0], 1, 1))
        for k, (size, errors, part) in enumerate(zip(sizes, self.noise, coordinates, strict=True)):
            self._rows[k, :size], self._residuals[k, :size], basis, _ = part
            coloured = _coloured(basis, errors) + NEGLIGIBLE**2 * np.eye(size)
            self._noise[k, :size, :size] = coloured
        if effects is not None:
            self._residuals -= np.einsum("kqn,kn->kq", self._rows, effects)
        self._parts = self._parts_of(spread_of(at.names, values))
        self._both = np.concatenate([self._rows, -self._residuals[:, :, None]], axis=2)
        self._known, self._pull = np.zeros(count), np.zeros(count)
        if prior is not None:
            self._known, self._pull = prior.weight, -prior.gradient(values)

    def weighed(self, scatter: Scatter) -> Linearisation:
        """Return equations about the values with independent errors of variance 1."""
        root = np.linalg.cholesky(self._variance(scatter.sizes))
        white = np.linalg.solve(root, np.concatenate([self._rows, self._residuals[:, :, None]], 2))
        logs, size, _ = white.shape
        return replace(
            self._at,
            values=self._values,
            rows=white[:, :, :-1].reshape(-1, self._values.size),
            residuals=white[:, :, -1].ravel(),
            ends=size * np.arange(1, logs + 1),
        )

    def findings(self, scatter: Scatter) -> tuple[Finding, ...]:
        """Return the significant random effects of a likeliest scatter."""
        whole = self.expanded(scatter.sizes)[0]
        groups = ([name for name in self._at.names if name in FRICTION], ["p4"])
        return tuple(
            Finding(FindingKind.SCATTER, tuple(group), number=float(scatter.sizes[k]))
            for k, group in enumerate(groups, start=1)
            # twice the logarithm of a likelihood ratio is a squared normal deviate
            if scatter.sizes[k] > MATTERS
            and self.expanded(self.best(without=k).sizes)[0] - whole > CLEARLY**2
        )

    def expanded(self, sizes: Samples) -> tuple[float, Samples]:
        """Return minus twice the log-likelihood, and its (3,) derivatives.

        It is log|V| + log|R'WR| + e'We with W = 1/V and e the residuals at the best parameters; a
        part dV of V changes it by the trace of dV times W - WR (R'WR)^-1 R'W - We e'W.
        """
        variance = self._variance(sizes)
        weight = np.linalg.inv(variance)
        weighed = weight @ self._both
        width = self._both.shape[2]
        sums = self._both.reshape(-1, width).T @ weighed.reshape(-1, width)
        normal = sums[:-1, :-1] + np.diag(self._known)
        normal += np.diag(np.where(np.diag(normal) > 0, 0.0, 1.0))  # of parameters without effect
        scale = np.sqrt(np.diag(normal))
        eigenvalues, axes = np.linalg.eigh(normal / np.outer(scale, scale))
        eigenvalues = np.maximum(eigenvalues, np.finfo(float).eps * eigenvalues[-1])
        inverse = (axes / eigenvalues) @ axes.T / np.outer(scale, scale)
        pull = sums[:-1, -1] + self._pull
        change = inverse @ pull
        logarithms = np.linalg.slogdet(variance)[1].sum() + np.log(eigenvalues).sum()
        logarithms += 2 * np.log(scale).sum()
        rows, residuals = weighed[:, :, :-1], weighed[:, :, -1] - weighed[:, :, :-1] @ change
        slope = weight - rows @ inverse @ np.swapaxes(rows, 1, 2)
        slope -= residuals[:, :, None] * residuals[:, None, :]
        slopes = 2 * sizes * (self._parts.reshape(sizes.size, -1) @ slope.ravel())
        return float(logarithms + sums[-1, -1] - pull @ change), slopes

    def best(self, without: int | None = None) -> Scatter:
        """Return the likeliest scatter; the size numbered ``without`` is 0."""
        usual = np.array(_USUAL)
        # root of the mean variance of a coordinate, as the autocovariance of residuals has it
        noise = np.diagonal(self._noise, axis1=1, axis2=2)[self._present]
        if noise.size:  # empty where no parameter moves any log
            usual[0] += CLEARLY * float(np.sqrt(noise.mean()))
        usual[np.arange(usual.size) == without] = 0.0

        def cost(shares: Samples) -> tuple[float, Samples]:
            value, slopes = self.expanded(shares * usual)
            return value + float(shares @ shares), slopes * usual + 2 * shares

        bounds = [(0.0, _MOST)] * usual.size  # beyond, a step would find V singular
        # from large and from small sizes: at 0 the likelihood is flat
        begins = (np.full(usual.size, share) for share in _BEGINS)
        ends = [minimize(cost, x, jac=True, method="L-BFGS-B", bounds=bounds) for x in begins]
        misfit, friction, gain = (min(ends, key=lambda end: end.fun).x * usual).tolist()
        return Scatter(misfit=misfit, friction=friction, gain=gain)

    def _parts_of(self, spread: Samples) -> Samples:
        """(3, k, q, q) parts of the variance of the logs by misfit, friction and gain of size 1."""
        identity = np.eye(self._present.shape[1]) * self._present[:, :, None]
        moved = self._rows * spread[:, None, None, :]
        return np.concatenate([identity[None], moved @ np.swapaxes(moved, 2, 3)])

    def _variance(self, sizes: Samples) -> Samples:
        """(k, q, q) V of each log, regularised by rounding errors for exact data."""
        variance = self._noise + np.tensordot(sizes**2, self._parts, 1)
        count = variance.shape[1]
        least = count * np.finfo(float).eps * np.trace(variance, axis1=1, axis2=2)
        return np.asarray(variance + least[:, None, None] * np.eye(count))


def _coordinates(residuals: Samples, rows: Samples) -> tuple[Samples, Samples, Samples, Samples]:
    """Return (q, n) R, (q,) U'r, (m, q) U of a log, and (m,) residuals less their projection."""
    basis, triangle = np.linalg.qr(rows)
    scaled, lengths = unit_columns(triangle)
    vectors, sizes, right = np.linalg.svd(scaled, full_matrices=False)
    mask = sizes > np.finfo(float).eps * residuals.size * sizes[0]
    basis = basis @ vectors[:, mask]
    along = basis.T @ residuals
    return sizes[mask, None] * right[mask] * lengths, along, basis, residuals - basis @ along


def _coloured(basis: Samples, residuals: Samples) -> Samples:
    """(q, q) variance of errors like (m,) residuals along columns, tapered within a cell."""
    count = residuals.size
    lags = max(count // CELLS, 1)
    length = next_fast_len(count + lags, real=True)
    covariance = irfft(np.abs(rfft(residuals, length)) ** 2, length)[:lags] / count
    covariance *= 1 - np.arange(lags) / lags
    even = np.zeros(length)
    even[:lags] = covariance
    even[length - lags + 1 :] = covariance[:0:-1]
    spectrum = np.maximum(rfft(even).real, 0.0)
    both_sides = np.where((np.arange(spectrum.size) * 2) % length == 0, 1.0, 2.0)
    lines = rfft(basis, length, axis=0)
    return np.asarray(((lines.conj().T * (spectrum * both_sides)) @ lines).real / length)
