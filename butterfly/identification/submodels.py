"""Nested models of one fit with every term, from its linear equations.

About a fit with all terms the equations are linear. Those of a nested model are the same, its
missing terms held at the values of a joint without them. A fit with fewer terms, or to fewer
logs, and its prediction of held-out data, then costs a few linear equations and no simulation.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import ROUNDING, Samples, unit_diagonal
from butterfly.identification.linearisation import Linearisation
from butterfly.identification.parameter import FEW
from butterfly.model.parameters import value_if_absent
from butterfly.model.terms import FOLLOWERS

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
