"""Starts of segments that are fitted: how they move errors, and the step to better ones.

The effects of a segment's start are projected out of its errors and their derivatives, so that
fitted starts are no parameters of a fit (variable projection: Golub & Pereyra, Inverse Problems 19,
2003; Schittkowski, Numerical Data Fitting in Dynamical Systems, 2002). All segments of a log are
treated at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.identification.levels import ROUNDING, SHOWS

_SETTLED = 1e-4  # share of the squared errors that another start may still explain
_SHORTER = 0.25  # of a step that went too far


@dataclass(frozen=True, eq=False)
class StartEffects:
    """Directions in which the starts of s segments move m errors."""

    directions: Samples  # (m, j) orthonormal within each segment; 0 where one has fewer
    bounds: NDArray[np.int64]  # (s + 1,) numbers of the first error of each segment, and of all

    def take_away(self, rows: Samples) -> None:
        """Take from (m, ...) rows, in place, what other starts explain."""
        for column in rows.reshape(len(rows), -1).T:  # one at a time, which takes little memory
            for direction in self.directions.T:
                along = _spread(_sums(direction * column, self.bounds), self.bounds)
                np.subtract(column, direction * along, out=column)


@dataclass(eq=False)
class SegmentStarts:
    """Starts of s segments, how good they are, and how they are improved."""

    begins: Samples  # (s, 2) angle in rad from the encoder's zero, velocity in rad/s
    cost: Samples  # (s,) mean squared errors
    step: Samples  # (s, 2) to where these are least to first order
    settled: NDArray[np.bool_]  # (s,) whether no other start makes them much smaller
    effects: StartEffects
    share: Samples  # (s,) of the step that is tried next

    @classmethod
    def of(
        cls,
        begins: Samples,
        errors: Samples,
        moves: Samples,
        bounds: NDArray[np.int64],
        *,
        at_rest: NDArray[np.bool_],
        unit: float,
    ) -> SegmentStarts:
        """Assess starts by (m,) errors and their (m, 2) derivatives by angle and velocity.

        Of a segment that begins ``at_rest`` only the angle there is fitted: friction holds a joint
        at rest, so that derivatives by its velocity do not exist, and its acceleration determines
        the inertia. ``unit``: of velocities over that of angles, in 1/s.
        """
        a, b = moves[:, 0], unit * moves[:, 1]
        aa, ab, bb, squares = (_sums(x, bounds) for x in (a * a, a * b, b * b, errors**2))
        finite = np.isfinite(aa + ab + bb + squares)
        aa, ab, bb = (np.where(finite, x, 0.0) for x in (aa, ab, bb))
        # squared singular values of both columns, and the direction of the larger
        middle, half = (aa + bb) / 2, np.hypot((aa - bb) / 2, ab)
        largest = middle + half
        smallest = np.divide(aa * bb - ab**2, largest, out=np.zeros_like(aa), where=largest > 0)
        both = ~at_rest & (smallest > SHOWS**2 * largest)
        x, y = np.where(aa > bb, [largest - bb, ab], [ab, largest - aa])
        alone = at_rest | both
        x, y = np.where(alone, 1.0, x), np.where(alone, 0.0, y)
        size = np.hypot(x, y)
        x, y = (np.divide(each, size, out=np.zeros_like(x), where=size > 0) for each in (x, y))
        first, length = _unit(a * _spread(x, bounds) + b * _spread(y, bounds), bounds, finite)
        along = _sums(first * b, bounds)
        second, rest = _unit(b - first * _spread(along, bounds), bounds, finite & both)
        explained = np.array([_sums(each * errors, bounds) for each in (first, second)])
        explained[:, ~finite] = 0.0
        beside = -_over(explained[1], rest)
        forth = -_over(explained[0] + np.where(both, along, 0.0) * beside, length)
        counts = np.maximum(np.diff(bounds), 1)
        cost = squares / counts
        left = np.sum(explained**2, axis=0) / counts
        return cls(
            begins=begins.copy(),
            cost=cost,
            step=np.column_stack([x * forth, unit * (y * forth + beside)]),
            settled=~finite | (left <= np.maximum(_SETTLED * cost, ROUNDING**2)),
            effects=StartEffects(np.column_stack([first, second]), bounds),
            share=np.ones(len(begins)),
        )

    def replace(
        self,
        which: NDArray[np.intp],
        others: SegmentStarts,
        taken: NDArray[np.bool_] | None = None,
    ) -> None:
        """Take other starts in place of those numbered ``which``, or those of a mask alone."""
        mask = np.ones(which.size, dtype=bool) if taken is None else taken
        for name in ("begins", "cost", "step", "settled"):
            getattr(self, name)[which[mask]] = getattr(others, name)[mask]

    def take(self, which: NDArray[np.intp], tried: SegmentStarts) -> None:
        """Take those of tried starts in place of those numbered ``which`` that are better."""
        better = tried.cost < self.cost[which]
        self.share[which] *= np.where(better, 1 / _SHORTER, _SHORTER)
        np.minimum(self.share, 1.0, out=self.share)
        self.replace(which, tried, better)


def _sums(rows: Samples, bounds: NDArray[np.int64]) -> Samples:
    """(s, ...) sums of (m, ...) rows over segments, some of which may have none."""
    full = np.diff(bounds) > 0
    found = np.zeros((full.size, *rows.shape[1:]))
    found[full] = np.add.reduceat(rows, bounds[:-1][full], axis=0)
    return found


def _spread(values: Samples, bounds: NDArray[np.int64]) -> Samples:
    """(m, ...) values of (s, ...) segments, each at all its errors."""
    return np.repeat(values, np.diff(bounds), axis=0)


def _unit(
    column: Samples, bounds: NDArray[np.int64], wanted: NDArray[np.bool_]
) -> tuple[Samples, Samples]:
    """Return an (m,) column of length 1 in each wanted segment, 0 in others, and (s,) lengths."""
    lengths = np.where(wanted, np.sqrt(_sums(column**2, bounds)), 0.0)
    scale = _over(np.ones_like(lengths), lengths)
    spread = _spread(scale, bounds)
    return np.where(spread > 0, column, 0.0) * spread, lengths


def _over(values: Samples, sizes: Samples) -> Samples:
    """(s,) values over sizes; 0 where these are 0."""
    return np.divide(values, sizes, out=np.zeros_like(values), where=sizes > 0)
