"""Types of arrays, and scaling."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float64]
"""Numbers; docstrings give their shape."""


def unit_columns(rows: Samples) -> tuple[Samples, Samples]:
    """Return (m, n) rows with columns scaled to length 1, and (n,) lengths, 1 instead of 0."""
    size = np.linalg.norm(rows, axis=0)
    size[size == 0] = 1.0
    return rows / size, size


def unit_diagonal(matrix: Samples) -> tuple[Samples, Samples]:
    """Return (n, n) matrices scaled to a diagonal of 1, and (n,) roots of it, 1 instead of 0."""
    size = np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 0.0))
    size[size == 0] = 1.0
    return matrix / (size[..., :, None] * size[..., None, :]), size
