"""Amplitude of a nearly sinusoidal signal from its mean square."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def rms_amplitude(centred: NDArray[np.float64]) -> float:
    """Amplitude sqrt(2 S/T) of a centred, uniformly sampled signal, S its integrated square (71).

    White noise of variance s^2 biases it to sqrt(A^2 + 2 s^2); `fit_sine` does not have this bias.
    """
    return float(np.sqrt(2.0 * np.mean(centred**2)))
