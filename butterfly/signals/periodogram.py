"""The periodogram as the thesis defines it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def periodogram(
    values: NDArray[np.float64], step: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Squared amplitudes |W_k|^2 of the unitary DFT (27)-(28), for k = 1 .. floor(N/2).

    Parameters
    ----------
    values
        (N,) uniform samples.
    step
        Sampling period in s.

    Returns
    -------
    omega, power
        Frequencies 2 pi k/(N step) in rad/s, and |W_k|^2 in units of ``values`` squared.
    """
    n = values.size
    spectrum = np.fft.rfft(values)[1 : n // 2 + 1] / np.sqrt(n)
    omega = 2 * np.pi / (n * step) * np.arange(1, n // 2 + 1, dtype=np.float64)
    return np.asarray(omega, dtype=np.float64), np.asarray(np.abs(spectrum) ** 2, dtype=np.float64)
