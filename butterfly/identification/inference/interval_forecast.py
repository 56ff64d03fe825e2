"""Intervals as they will be after more logs: standard errors times quantiles of Student's t.

Both follow from the derivatives of the logs alone, as `cluster_covariance` has them: an interval
shrinks with its standard error, and as the degrees of freedom grow. So a few more logs of the kind
that determine a parameter help more than many others. Predictions are scaled to the intervals that
the logs so far have: what errors that are not white, or other evidence, add stays in proportion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.inference.limits import (
    expected_covariance,
    half_widths,
    independent_cells_of,
)
from butterfly.identification.levels import ROUNDING, SPREADS
from butterfly.identification.linearisation import compressed


class IntervalForecast:
    """Intervals of an estimate's n parameters after its logs and some more.

    ``logs``: (m, n) derivatives of the errors of each by the parameters; errors are taken to be
    white and alike in all logs.
    """

    def __init__(self, estimate: Estimate, logs: Sequence[Samples]) -> None:
        errors, names = estimate.standard_errors, estimate.names
        self._units = np.where(errors > 0, errors, 1.0)
        self._logs = [self.log(rows) for rows in logs]
        uncertain = estimate.known.uncertain
        given = [uncertain[n].uncertainty if n in uncertain else math.inf for n in names]
        precision = (self._units / np.array(given)) ** 2
        units = np.outer(self._units, self._units)
        shown = sum(np.sum(log.cut(1) ** 2, axis=(0, 1)) for log in self._logs)
        # of what no log shows, so little that it makes no difference elsewhere
        self._least = ROUNDING * np.where(shown > 0, shown, np.max(shown) or 1.0)
        self._weight = precision * _variance(estimate.covariance / units, self._logs, precision)
        self._before, freedom = self._expected(self._logs)
        known = np.isfinite(estimate.farther)
        self._shown = np.where(known, estimate.farther, SPREADS * errors) / half_widths(
            self._before, freedom
        )

    def log(self, rows: Samples) -> CutLog:
        """Return a log of (m, n) derivatives, as others are."""
        return CutLog(rows * self._units)

    def half_widths(self, more: CutLog, runs: int) -> Samples:
        """(n,) half-widths of the intervals after some runs of another log."""
        return self._shown * half_widths(*self._expected([*self._logs, *[more] * runs]))

    def errors(self, more: CutLog) -> Samples:
        """(n,) standard errors after one more log, over those before."""
        after, _ = self._expected([*self._logs, more])
        return np.asarray(np.sqrt(np.diag(after) / np.diag(self._before)))

    def _expected(self, logs: Sequence[CutLog]) -> tuple[Samples, Samples]:
        """Return (n, n) covariance over an error's variance, and (n,) freedom, of some logs."""
        cells = independent_cells_of(len(logs), self._units.size)
        rows = np.concatenate([log.cut(cells) for log in logs])
        return expected_covariance(rows, self._weight + self._least)


class CutLog:
    """The (m, n) derivatives of a log, cut into cells as often as it is asked for."""

    def __init__(self, rows: Samples) -> None:
        self._rows, self._cut = rows, dict[int, Samples]()

    def cut(self, cells: int) -> Samples:
        """(cells, n + 1, n) triangular factors of the derivatives in stretches of time."""
        if cells not in self._cut:
            parts = np.array_split(self._rows, cells)
            self._cut[cells], _ = compressed([(part, np.zeros(len(part))) for part in parts])
        return self._cut[cells]


def _variance(covariance: Samples, logs: Sequence[CutLog], precision: Samples) -> float:
    """Return the mean variance of errors by which logs and known values have a covariance.

    C = (H/s + P)^-1 of n values, with H the information of logs and P the precision of what is
    known: so trace(CH)/s = n - trace(CP).
    """
    rows = np.concatenate([log.cut(1)[0] for log in logs])
    trace = precision.size - float(np.diag(covariance) @ precision)
    moved = float(np.einsum("kn,nm,km->", rows, covariance, rows))
    return moved / max(trace, ROUNDING)
