"""One division of logs into blocks of time, for whatever takes or leaves out a part of a log.

Errors are alike within a log, so that what counts as independent is a log, or where there are few
of them a block.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

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
    starts = [0, *(np.flatnonzero(np.diff(cluster[order])) + 1).tolist(), order.size]
    for begin, end in pairwise(starts):
        for part in parts_of(end - begin, cells, begin):
            yield jacobian[order[part]], residuals[order[part]]


def parts_of(size: int, count: int, begin: int = 0) -> list[slice]:
    """Return the parts, all about as long, of so many samples or equations from one on."""
    each, longer = divmod(size, count)
    edges = [begin + k * each + min(k, longer) for k in range(count + 1)]
    return [slice(*pair) for pair in pairwise(edges)]


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
