"""Bring irregular samples to a uniform clock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def uniform_grid(time: NDArray[np.float64], step: float | None = None) -> NDArray[np.float64]:
    """Return uniform instants from the first stamp on, none after the last (25).

    Parameters
    ----------
    time
        (n,) stamps in s, not decreasing.
    step
        Sampling period in s; the mean one if not given, which keeps the number of samples.
    """
    if step is None:
        return np.linspace(time[0], time[-1], time.size)
    count = int(np.floor((time[-1] - time[0]) / step * (1 + 1e-12))) + 1
    return np.asarray(time[0] + step * np.arange(count))


def resample(
    time: NDArray[np.float64], values: NDArray[np.float64], grid: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Interpolate linearly at ``grid``, as the thesis's scripts do."""
    return np.interp(grid, time, values)
