"""Uniform samples of a signal: amplitude, periodogram and dominant frequency."""

from __future__ import annotations

import numpy as np
from scipy import fft
from scipy.optimize import minimize_scalar

from butterfly.arrays import Samples

_MOST = 2**15  # samples that are looked at, where a signal has more


def periodogram(values: Samples, step: float) -> tuple[Samples, Samples]:
    """Squared amplitudes |W_k|^2 of the unitary DFT (27)-(28), for k = 1 .. floor(N/2).

    Returns frequencies 2 pi k/(N step) in rad/s, and |W_k|^2 in units of the samples squared.
    """
    n = values.size
    spectrum = fft.rfft(values)[1 : n // 2 + 1] / np.sqrt(n)
    omega = 2 * np.pi / (n * step) * np.arange(1, n // 2 + 1, dtype=np.float64)
    return np.asarray(omega, dtype=np.float64), np.asarray(np.abs(spectrum) ** 2, dtype=np.float64)


def rms_amplitude(centred: Samples) -> float:
    """Amplitude sqrt(2 S/T) of a centred, uniformly sampled signal, S its integrated square (71).

    White noise of variance s^2 biases it to sqrt(A^2 + 2 s^2); `fit_basis` does not have this bias.
    """
    return float(np.sqrt(2.0 * np.mean(centred**2)))


def dominant_frequency(time: Samples, values: Samples) -> tuple[float, float]:
    """Return the frequency in rad/s of the sine that explains most of a signal, and its share."""
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


def uniform_grid(time: Samples, step: float | None = None) -> Samples:
    """Return uniform instants from the first timestamp (25); without a step, as many as samples."""
    if step is None:
        return np.linspace(time[0], time[-1], time.size)
    count = int(np.floor((time[-1] - time[0]) / step * (1 + 1e-12))) + 1
    return np.asarray(time[0] + step * np.arange(count))


def resample(time: Samples, values: Samples, grid: Samples) -> Samples:
    """Interpolate linearly at ``grid``, as the thesis's scripts do."""
    return np.interp(grid, time, values)
