"""The frequency at which a signal moves most."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from butterfly.signals.resample import resample, uniform_grid

_MOST = 2**15  # samples that are looked at, where a signal has more


def dominant_frequency(
    time: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the frequency in rad/s of the one sine that explains most of a signal, and its share.

    Parameters
    ----------
    time, values
        (n,) samples; ``time`` in s need not be uniform.

    Returns
    -------
    omega, share
        In rad/s, and the share of the variance that it explains: 1 for a sine, 0 for a constant.
    """
    grid = np.linspace(time[0], time[-1], min(time.size, _MOST))
    if time.size <= _MOST:
        grid = uniform_grid(time)
    centred = resample(time, values, grid)
    centred -= centred.mean()
    power = float(centred @ centred)
    if not power > 0:
        return 0.0, 0.0
    size = 4 * grid.size
    spectrum = np.abs(np.fft.rfft(centred, size))
    spacing = 2 * np.pi / (size * (grid[1] - grid[0]))
    peak = (1 + int(np.argmax(spectrum[1:]))) * spacing

    def unexplained(omega: float) -> float:
        columns = np.column_stack([np.ones(grid.size), np.cos(omega * grid), np.sin(omega * grid)])
        rest = centred - columns @ np.linalg.lstsq(columns, centred)[0]
        return float(rest @ rest) / power

    found = minimize_scalar(
        unexplained, bounds=(max(peak - spacing, spacing / 8), peak + spacing), method="bounded"
    )
    return float(found.x), 1.0 - float(found.fun)
