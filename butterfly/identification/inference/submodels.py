"""One fit with every term, and what its equations say of fits with fewer.

About a fit with all terms the equations are linear. Those of a fit without some of them are the
same ones, the values of what is left out set to those of a joint that lacks it; so a fit with fewer
terms, or to fewer logs, and what it predicts of data that it has not seen, costs the solution of a
few equations and no simulation.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples, unit_diagonal
from butterfly.identification.equations import CellEquations
from butterfly.identification.levels import FEW, ROUNDING
from butterfly.model.parameters import value_if_absent
from butterfly.model.terms import FOLLOWERS

NEGLIGIBLE = 1e-6
"""Of a motion, how well it is predicted at best: rounding leaves more."""

_SINGULAR = 1e-11  # of the scaled normal equations, below which a combination is not determined


@dataclass(frozen=True, kw_only=True, eq=False)
class Submodels:
    """All fits that have some of the n parameters of equations in k cells."""

    equations: CellEquations
    # (k,) numbers of the parts of the data that are left out together, one after the other
    folds: NDArray[np.intp]
    # values of what is no parameter here, but was set
    settings: dict[str, float] = field(default_factory=dict)
    negligible: float = 0.0  # size of an error that is none, as rounding leaves it to exact data

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return self.equations.names

    def about(self, values: Samples) -> Submodels:
        """Return the same equations about other (n,) values."""
        own = self.equations
        residuals = own.residuals + own.rows @ (values - own.values)
        bound = values <= own.lower
        moved = replace(own, values=values, residuals=residuals, on_bound=bound)
        return replace(self, equations=moved)

    def fitted(self, kept: NDArray[np.bool_]) -> Samples:
        """Return (t, n) values of t fits with the parameters ``kept``; nan if undetermined."""
        return self._fitted(*self.equations.total, kept)

    def held_out(self, kept: NDArray[np.bool_]) -> Samples:
        """(t, k) squared errors of cells by fits to the other parts; nan if not determined."""
        found = self._left_out(kept, self.folds)
        if np.isfinite(found[0]).all() or np.unique(self.folds).size == self.folds.size:
            return found
        return self._left_out(kept, np.arange(self.folds.size))  # of parts, single cells

    def _left_out(self, kept: NDArray[np.bool_], folds: NDArray[np.intp]) -> Samples:
        parts, own = np.unique(folds), self.equations
        errors = np.empty((len(kept), folds.size))
        lost = np.full(len(kept), parts.size == 1)
        at_once = max(1, 4096 // len(kept))  # which bounds the memory that the fits take
        for some in np.split(parts, range(at_once, parts.size, at_once)):
            left_out = folds == some[:, None]
            curvature, gradient = (
                np.repeat(whole - np.tensordot(left_out, each, 1), len(kept), axis=0)
                for whole, each in zip(own.total, (own.curvature, own.gradient), strict=True)
            )
            fits = self._fitted(curvature, gradient, np.tile(kept, (some.size, 1)))
            for mine, values in zip(left_out, np.split(fits, some.size), strict=True):
                lost |= np.isnan(values).any(axis=1)
                errors[:, mine] = self.costs(values)[:, mine]
        errors = np.nan_to_num(errors, nan=np.inf, posinf=np.inf)
        return np.where(lost[:, np.newaxis], np.nan, errors)

    def costs(self, values: Samples) -> Samples:
        """(t, k) squared errors of the cells with (t, n) values."""
        steps, own = values - self.equations.values, self.equations
        bent = np.einsum("tn,knt->tk", steps, own.curvature @ steps.T)
        return np.asarray(np.maximum(own.cost + 2 * steps @ own.gradient.T + bent, 0.0))

    def _fitted(self, curvature: Samples, gradient: Samples, kept: NDArray[np.bool_]) -> Samples:
        """Solve for the parameters that are kept, without the others; what a bound stops stays."""
        # what says nothing without another one stays as it is when absent
        mute = [name in FOLLOWERS for name in self.names]
        without = [value_if_absent(name) for name in self.names]
        absent = np.where(mute, self.equations.values, without)
        return _bounded(self.equations, (curvature, gradient), kept, absent)


def submodels_of(
    equations: CellEquations, parts: Sequence[Hashable], negligible: float
) -> Submodels:
    """Return fits with fewer terms, which predict one of ``parts``, logs or stretches in turn."""
    cells = equations.independent
    few = cells.log.size > np.unique(cells.log).size
    folds = np.arange(cells.log.size) if few else folds_of([parts[k] for k in cells.log])
    return Submodels(equations=cells, folds=folds, negligible=negligible)


def folds_of(parts: Sequence[Hashable]) -> NDArray[np.intp]:
    """Return the number of each log's part; where there are too few parts, each log is one."""
    different = list(dict.fromkeys(parts))
    if len(different) < FEW:
        return np.arange(len(parts))
    return np.array([different.index(part) for part in parts])


def without_logs(equations: CellEquations, logs: Iterable[int]) -> Samples:
    """Return (n,) values without some logs, to first order (the linear jackknife), or nan."""
    rest = equations.without(logs)
    own, all_ = (np.einsum("kii->i", each.curvature) for each in (rest, equations))
    moved = (own > ROUNDING**2 * all_) | (all_ == 0)  # what only these move stays
    return np.asarray(_bounded(equations, rest.total, moved[np.newaxis], equations.values)[0])


def _bounded(
    about: CellEquations, total: tuple[Samples, Samples], kept: NDArray[np.bool_], absent: Samples
) -> Samples:
    """(t, n) values that solve equations for what is kept, within bounds; nan if untold."""
    (curvature, gradient), at, lower = total, about.values, about.lower
    held, (count, size) = np.maximum(at, lower), kept.shape
    curvature = np.broadcast_to(curvature, (count, size, size))
    gradient = np.broadcast_to(gradient, kept.shape)
    values = np.where(kept, held, absent)
    idle = ~(np.einsum("tnn->tn", curvature) > 0) & (held <= lower)
    free = kept & ~idle
    rows = np.flatnonzero(free.any(axis=1))
    while rows.size:
        own = curvature[rows]
        pull = gradient[rows] + np.einsum("tm,tmn->tn", values[rows] - at, own)
        reached = values[rows] + _solved(own, -pull, free[rows])
        low = free[rows] & (reached < lower)
        values[rows] = np.where(free[rows], np.maximum(reached, lower), values[rows])
        free[rows] &= ~low
        rows = rows[low.any(axis=1) & free[rows].any(axis=1)]
    return values


def _solved(matrix: Samples, targets: Samples, free: NDArray[np.bool_]) -> Samples:
    """Solve (t, n, n) normal equations for those ``free``, others being 0; nan if untold."""
    lost = np.asarray((free & ~(np.einsum("tnn->tn", matrix) > 0)).any(axis=1))
    scaled, scale = unit_diagonal(matrix)
    asked = free & ~lost[:, np.newaxis]
    both = asked[:, :, np.newaxis] & asked[:, np.newaxis, :]
    matrices = np.where(both, scaled, np.eye(scale.shape[1]))
    try:
        inverses = np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        inverses = np.full_like(matrices, np.nan)
    # no less than the largest eigenvalue over the smallest, which take longer to find
    ratios = np.linalg.norm(matrices, axis=(1, 2)) * np.linalg.norm(inverses, axis=(1, 2))
    unsure = ~(ratios < 1 / _SINGULAR)
    if unsure.any():
        eigenvalues, axes = np.linalg.eigh(matrices[unsure])
        eigenvalues[eigenvalues[:, 0] < _SINGULAR * eigenvalues[:, -1]] = np.nan
        inverses[unsure] = axes / eigenvalues[:, None, :] @ np.swapaxes(axes, 1, 2)
    inverses[lost] = np.nan
    pulls = np.where(asked, targets / scale, 0.0)
    return np.asarray((inverses @ pulls[:, :, None])[:, :, 0] / scale)
