"""Initial state of a free swing that has only a few samples in a period."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_FEWEST_RAD = 1.0  # of phase in all samples
_FINEST = 0.6  # of half a period between samples
_SCANNED = 40  # frequencies


def sine_at_start(time: NDArray[np.float64], angle: NDArray[np.float64]) -> tuple[float, float]:
    """Return angle in rad and velocity in rad/s at the first of (n,) samples, by least squares.

    They are those of the offset and sine that fit best, over all frequencies scanned.
    """
    passed = time - time[0]
    slowest, fastest = _FEWEST_RAD, _FINEST * math.pi * (time.size - 1)
    fits = []
    for omega in np.geomspace(slowest, fastest, _SCANNED) / passed[-1]:
        turned = omega * passed
        columns = np.column_stack([np.ones(time.size), np.cos(turned), np.sin(turned)])
        offset, cosine, sine = np.linalg.lstsq(columns, angle, rcond=None)[0].tolist()
        residuals = angle - columns @ [offset, cosine, sine]
        fits.append((float(residuals @ residuals), offset + cosine, float(omega) * sine))
    return min(fits)[1:]
