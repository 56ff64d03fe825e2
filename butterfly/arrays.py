"""What arrays hold, by name."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float64]
"""Numbers; docstrings give their shape."""

ROUNDING: float = float(np.finfo(float).eps) ** 0.5
"""Relative size, the root of the machine's precision, below which rounding hides what there is."""
