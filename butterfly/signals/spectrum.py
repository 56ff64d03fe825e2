"""Uniform samples of a signal: amplitude, noise, periodogram and dominant frequency."""

from __future__ import annotations

import numpy as np
from scipy import fft
from scipy.optimize import minimize_scalar

from butterfly.arrays import Samples, blocks

_MOST = 2**15  # samples that are looked at, where a signal has more
_GLANCED = 2**12  # the same where a hundredth is near enough
_FINER = 4  # times a spectrum is finer than one value a period


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


def roughness(errors: Samples) -> float:
    """Mean square of the second differences of (n,) errors: 6 times the variance of white ones."""
    total, count = 0.0, errors.size - 2
    for part in blocks(count):
        bends = np.diff(errors[part.start : part.stop + 2], 2)
        total += float(bends @ bends)
    return total / count if count > 0 else 0.0


def white_variance(errors: Samples) -> float:
    """Variance of white noise that is as rough as (n,) errors."""
    return roughness(errors) / 6


def dominant_frequency(time: Samples, values: Samples, most: int = _MOST) -> tuple[float, float]:
    """Return the frequency in rad/s of the sine that explains most of a signal, and its share.

    The spectrum of the signal less a straight line peaks nearby, at one period in the signal or
    more: few periods, damping and noise move a peak. Least squares of a sine beside an offset say
    where it is. At most ``most`` samples are used.
    """
    grid = np.linspace(time[0], time[-1], min(time.size, most))
    if time.size <= most:
        grid = uniform_grid(time)
    centred = resample(time, values, grid)
    centred -= centred.mean()
    power = float(centred @ centred)
    line = np.linspace(-1.0, 1.0, grid.size)
    bent = centred - line * (line @ centred / (line @ line))
    if not bent @ bent > (np.finfo(float).eps * grid.size) ** 2 * power:  # a line alone
        return 0.0, 0.0
    size = _FINER * grid.size
    spectrum = np.abs(np.fft.rfft(bent, size))
    spacing = 2 * np.pi / (size * (grid[1] - grid[0]))
    peak = (_FINER + int(np.argmax(spectrum[_FINER:]))) * spacing

    def unexplained(omega: float) -> float:
        rows = np.vstack([np.ones(grid.size), np.cos(omega * grid), np.sin(omega * grid)])
        waves = np.linalg.lstsq(rows @ rows.T, rows @ centred)[0]
        return 1.0 - float(waves @ (rows @ centred)) / power

    reach = (_FINER - 1) * spacing  # within the peak's main lobe
    optimum = minimize_scalar(unexplained, bounds=(peak - reach, peak + reach), method="bounded")
    return float(optimum.x), 1.0 - float(optimum.fun)


def dominant_period(time: Samples, values: Samples) -> float:
    """Return the period in s of the sine that explains most of a signal, at most its length."""
    omega, _ = dominant_frequency(time, values, _GLANCED)
    length = float(time[-1] - time[0])
    return min(2 * np.pi / omega, length) if omega else length


def uniform_grid(time: Samples, step: float | None = None) -> Samples:
    """Return uniform instants from the first timestamp (25); without a step, as many as samples."""
    if step is None:
        return np.linspace(time[0], time[-1], time.size)
    count = int(np.floor((time[-1] - time[0]) / step * (1 + 1e-12))) + 1
    return np.asarray(time[0] + step * np.arange(count))


def resample(time: Samples, values: Samples, grid: Samples) -> Samples:
    """Interpolate linearly at ``grid``, as the thesis's scripts do."""
    return np.interp(grid, time, values)
