"""Least-squares fit of a sine and its harmonics to irregular samples, with standard errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

HARMONICS = 3
"""Harmonics fitted by default: gravity and Coulomb friction are odd, an offset adds even ones."""

_BLOCKS = 10  # correlation within a tenth of the record is taken into account


@dataclass(frozen=True, kw_only=True, eq=False)
class SineFit:
    """x(t) = offset + Re sum_k phasors[k-1] e^(j k w t) + residual.

    Parameters
    ----------
    omega
        Fundamental frequency in rad/s.
    offset
        Mean, in units of the signal.
    phasors
        (H,) complex amplitudes; ``phasors[0]`` is the fundamental.
    covariance
        (2, 2) of real and imaginary part of the fundamental.
    residual_rms
        Root mean square of what is left over.
    """

    omega: float
    offset: float
    phasors: NDArray[np.complex128]
    covariance: NDArray[np.float64]
    residual_rms: float

    @property
    def fundamental(self) -> complex:
        """Complex amplitude of the fundamental."""
        return complex(self.phasors[0])

    @property
    def amplitude(self) -> float:
        """Amplitude of the fundamental."""
        return abs(self.fundamental)

    @property
    def phase(self) -> float:
        """Phase of the fundamental against cos(w t), in rad."""
        return float(np.angle(self.fundamental))

    @property
    def amplitude_error(self) -> float:
        """Standard error of `amplitude`."""
        return self._error_along(np.exp(1j * self.phase))

    @property
    def phase_error(self) -> float:
        """Standard error of `phase` in rad."""
        return self._error_along(1j * np.exp(1j * self.phase)) / self.amplitude

    @property
    def distortion(self) -> float:
        """Root sum of squares of the harmonics over the fundamental."""
        return float(np.linalg.norm(self.phasors[1:]) / self.amplitude)

    def _error_along(self, direction: complex) -> float:
        unit = np.array([direction.real, direction.imag])
        return float(np.sqrt(unit @ self.covariance @ unit))


def fit_sine(
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    omega: float,
    harmonics: int = HARMONICS,
    pole: complex | None = None,
) -> SineFit:
    """Fit mean, fundamental and harmonics of a known frequency by linear least squares.

    The covariance is the cluster-robust one (Liang & Zeger, Biometrika 73, 1986) over ten blocks
    of time, so that residuals that are correlated from sample to sample, as encoder steps and
    slow drifts are, do not make it too small.

    Parameters
    ----------
    time, values
        (n,) samples; ``time`` in s need not be uniform.
    omega
        Fundamental frequency in rad/s.
    harmonics
        Number of multiples of ``omega`` fitted, the fundamental included.
    pole
        In 1/s; if given, a transient Re{c e^(pole t)} of any amplitude and phase is fitted too.
    """
    angles = np.outer(time, omega * np.arange(1, harmonics + 1))
    columns = [np.ones(time.size), np.cos(angles), np.sin(angles)]
    if pole is not None:
        transient = np.exp(pole * (time - time[0]))
        columns += [transient.real, transient.imag]
    design = np.column_stack(columns)
    normal = np.linalg.inv(design.T @ design)
    coefficients = normal @ (design.T @ values)
    residual = values - design @ coefficients
    starts = np.linspace(0, time.size, _BLOCKS, endpoint=False, dtype=np.intp)
    scores = np.add.reduceat(design * residual[:, None], starts, axis=0)
    correction = _BLOCKS / (_BLOCKS - 1) * (time.size - 1) / (time.size - design.shape[1])
    covariance = correction * normal @ (scores.T @ scores) @ normal
    fundamental = np.array([1, 1 + harmonics])  # columns of cos(w t) and sin(w t)
    flip = np.array([1.0, -1.0])  # the phasor is (cos part) - j (sin part)
    return SineFit(
        omega=omega,
        offset=float(coefficients[0]),
        phasors=coefficients[1 : 1 + harmonics]
        - 1j * coefficients[1 + harmonics : 1 + 2 * harmonics],
        covariance=covariance[np.ix_(fundamental, fundamental)] * np.outer(flip, flip),
        residual_rms=float(np.sqrt(np.mean(residual**2))),
    )
