"""One division of logs into blocks of time, for whatever takes or leaves out a part of a log.

Errors are alike within a log, so that what counts as independent is a log, or where there are few
of them a block.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.identification.levels import FEW
from butterfly.logs.log import MIN_SAMPLES, Log

CELLS = 10
"""Blocks into which a log is cut: as many as tell their scatter within a quarter."""


def cells_of(logs: int, parameters: int) -> int:
    """Return into how many cells each log is cut: the cells are twice the parameters at least."""
    return max(CELLS, -(-2 * parameters // logs))


def independent_cells_of(logs: int, parameters: int) -> int:
    """Return into how many each is cut whose errors count as independent: none of many logs."""
    return cells_of(logs, parameters) if logs <= FEW else 1


def cut(
    jacobian: Samples, residuals: Samples, cluster: NDArray[np.intp], cells: int
) -> Iterable[tuple[Samples, Samples]]:
    """Yield the (m, n) and (m,) equations of each cell, one cluster after the other."""
    order = np.argsort(cluster, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(cluster[order])) + 1):
        for part in np.array_split(rows, cells):
            yield jacobian[part], residuals[part]


def edges_of(time: Samples, count: int) -> list[int]:
    """Return the samples at which blocks of a log begin; fewer than ``count`` if too short."""
    if time.size < MIN_SAMPLES:
        return []
    edges = [0]
    for k in np.searchsorted(time, np.linspace(time[0], time[-1], count + 1)[1:-1]).tolist():
        if min(k - edges[-1], time.size - k) >= MIN_SAMPLES:
            edges.append(k)
    return edges


def length_of(log: Log) -> float:
    """Return the length in s of the blocks of a log: whole periods of its drive."""
    length = float(log.time[-1] - log.time[0]) / CELLS
    if log.excitation is None:
        return length
    period = 2 * math.pi / log.excitation.omega
    return math.ceil(length / period) * period
