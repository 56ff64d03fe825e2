"""A transient that still rings beside a steady sine: its pole."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from butterfly.signals.resample import resample, uniform_grid

_SAMPLES = 1000  # that are enough to fit two numbers
_PADDED = 8


def pole_of(time: NDArray[np.float64], values: NDArray[np.float64]) -> complex:
    """Return the pole in 1/s of the decaying oscillation Re{c e^(pole t)} that fits best.

    Parameters
    ----------
    time, values
        (n,) what a fit of the steady response leaves over.
    """
    grid = uniform_grid(time, max((time[-1] - time[0]) / _SAMPLES, float(np.diff(time).mean())))
    left = resample(time, values, grid)
    since = grid - grid[0]
    spectrum = np.abs(np.fft.rfft(left * np.hanning(left.size), _PADDED * left.size))
    peak = 2 * np.pi * np.fft.rfftfreq(_PADDED * left.size, grid[1] - grid[0])[np.argmax(spectrum)]

    def residuals(pole: NDArray[np.float64]) -> NDArray[np.float64]:
        wave = np.exp(-abs(pole[0]) * since)
        basis = np.column_stack([wave * np.cos(pole[1] * since), wave * np.sin(pole[1] * since)])
        return np.asarray(left - basis @ np.linalg.lstsq(basis, left, rcond=None)[0])

    length = float(since[-1])
    found = least_squares(residuals, [1.0 / length, peak], x_scale=[1.0 / length, 1.0 / length])
    return complex(-abs(found.x[0]), found.x[1])
