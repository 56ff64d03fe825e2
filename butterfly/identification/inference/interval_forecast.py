"""Intervals as they will be after more logs: standard errors times quantiles of Student's t.

Both follow from the derivatives of the logs alone, as `cluster_covariance` has them: an interval
shrinks as its standard error does, and as the degrees of freedom grow that this rests on. So a few
more logs of the kind that a parameter rests on help more than many others. Errors are in such units
that the logs so far have the intervals that they show: what is not white, or rests on something
else, counts as often as it did before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.inference.blocks import independent_cells_of
from butterfly.identification.inference.covariance import expected_covariance, half_widths
from butterfly.identification.inference.equations import compressed
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.levels import PASSES, ROUNDING


class IntervalForecast:
    """Intervals of an estimate's n parameters after its logs and some more.

    ``logs``: (m, n) derivatives of the errors of each by the parameters; errors are taken to be
    white and alike in all logs.
    """

    def __init__(self, estimate: Estimate, logs: Sequence[Samples]) -> None:
        errors, names = estimate.standard_errors, estimate.names
        self._units = np.where(errors > 0, errors, 1.0)
        self._logs = [_CutLog(rows * self._units) for rows in logs]
        uncertain = estimate.known.uncertain
        given = [uncertain[n].uncertainty if n in uncertain else math.inf for n in names]
        precision = (self._units / np.array(given)) ** 2
        shown = sum(np.sum(log.cut(1) ** 2, axis=(0, 1)) for log in self._logs)
        # of what no log shows, so little that it makes no difference elsewhere
        self._least = ROUNDING * np.where(shown > 0, shown, np.max(shown) or 1.0)
        variance = 1.0  # of an error: with it standard errors are those of the estimate, on average
        for _ in range(PASSES if precision.any() else 1):
            self._weight = variance * precision
            covariance, freedom = self._expected(self._logs)
            variance *= float(np.exp(-np.mean(np.log(variance * np.diag(covariance)))))
        self._before = covariance
        self._shown = estimate.farther / half_widths(covariance, freedom)

    def half_widths(self, more: Samples, runs: int) -> Samples:
        """(n,) half-widths of the intervals after some runs of a log of (m, n) derivatives."""
        logs = [*self._logs, *([_CutLog(more * self._units)] * runs)]
        return self._shown * half_widths(*self._expected(logs))

    def errors(self, more: Samples) -> Samples:
        """(n,) standard errors after one more log of (m, n) derivatives, over those before."""
        after, _ = self._expected([*self._logs, _CutLog(more * self._units)])
        return np.asarray(np.sqrt(np.diag(after) / np.diag(self._before)))

    def _expected(self, logs: Sequence[_CutLog]) -> tuple[Samples, Samples]:
        """Return (n, n) covariance over an error's variance, and (n,) freedom, of some logs."""
        cells = independent_cells_of(len(logs), self._units.size)
        rows = np.concatenate([log.cut(cells) for log in logs])
        return expected_covariance(rows, self._weight + self._least)


class _CutLog:
    """The (m, n) derivatives of a log, cut into cells as often as it is asked for."""

    def __init__(self, rows: Samples) -> None:
        self._rows, self._cut = rows, dict[int, Samples]()

    def cut(self, cells: int) -> Samples:
        """(cells, n + 1, n) triangular factors of the derivatives in stretches of time."""
        if cells not in self._cut:
            parts = np.array_split(self._rows, cells)
            self._cut[cells], _ = compressed([(part, np.zeros(len(part))) for part in parts])
        return self._cut[cells]
