"""Least-squares fit of a sine and its harmonics to irregular samples, with standard errors."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples

HARMONICS = 3
"""Harmonics fitted by default: gravity and Coulomb friction are odd, an offset adds even ones."""

_BLOCKS = 10  # correlation within a tenth of the record is taken into account
_TO_PHASOR = np.array([1.0, -1.0])  # which is (cos part) - j (sin part)


@dataclass(frozen=True, kw_only=True, eq=False)
class SineFit:
    """x(t) = offset + Re sum_k phasors[k-1] e^(j k w t) + residual."""

    omega: float  # Fundamental frequency in rad/s
    offset: float  # Mean, in units of the signal
    phasors: NDArray[np.complex128]  # (H,) complex amplitudes; `phasors[0]` is the fundamental
    covariance: Samples  # (2, 2) of real and imaginary part of the fundamental
    residual_rms: float  # Root mean square of what is left over

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

    def on(self, basis: Samples) -> Samples:
        """Return the (n,) values of mean, sine and harmonics on the rows of `sine_basis`."""
        waves = np.column_stack([self.phasors.real, -self.phasors.imag]).ravel()
        return np.asarray(np.append(self.offset, waves) @ basis)

    def _error_along(self, direction: complex) -> float:
        unit = np.array([direction.real, direction.imag])
        return float(np.sqrt(unit @ self.covariance @ unit))


def sine_basis(time: Samples, omega: float, harmonics: int = HARMONICS) -> Samples:
    """Return (1 + 2 H, n) rows for `fit_basis`: 1, cos(k w t) and sin(k w t) for k = 1, 2, ..."""
    basis = np.empty((1 + 2 * harmonics, time.size))
    basis[0] = 1.0
    cosines, sines = basis[1::2], basis[2::2]
    angle = omega * time
    np.cos(angle, out=cosines[0])
    np.sin(angle, out=sines[0])
    for k in range(1, harmonics):  # the sum of two angles is cheaper than another cosine
        cosines[k] = cosines[k - 1] * cosines[0] - sines[k - 1] * sines[0]
        sines[k] = sines[k - 1] * cosines[0] + cosines[k - 1] * sines[0]
    return basis


def with_transient(basis: Samples, time: Samples, pole: complex | None) -> Samples:
    """Return the rows of a basis, with those of a transient if there is a pole in 1/s."""
    if pole is None:
        return basis
    transient = np.exp(pole * (time - time[0]))
    return np.vstack([basis, transient.real, transient.imag])


def fit_basis(
    basis: Samples,
    values: Samples,
    omega: float,
    harmonics: int = HARMONICS,
    equations: tuple[Samples, Samples] | None = None,
) -> SineFit:
    """Fit mean, fundamental and harmonics of a known frequency by linear least squares.

    The covariance is cluster-robust (Liang & Zeger, Biometrika 73, 1986) over ten blocks of time,
    as residuals are correlated from sample to sample (encoder steps, slow drifts). The basis may
    have other rows below those of `sine_basis`.
    """
    matrix, moments = equations or _equations(basis, values)
    normal = np.linalg.inv(matrix)
    coefficients = normal @ moments
    residual = values - coefficients @ basis
    edges = np.linspace(0, values.size, _BLOCKS + 1, dtype=np.intp)
    scores = np.array([basis[:, a:b] @ residual[a:b] for a, b in pairwise(edges.tolist())])
    correction = _BLOCKS / (_BLOCKS - 1) * (values.size - 1) / (values.size - basis.shape[0])
    covariance = correction * normal @ (scores.T @ scores) @ normal
    waves = coefficients[1 : 1 + 2 * harmonics]
    return SineFit(
        omega=omega,
        offset=float(coefficients[0]),
        phasors=waves[::2] - 1j * waves[1::2],
        covariance=covariance[1:3, 1:3] * np.outer(_TO_PHASOR, _TO_PHASOR),
        residual_rms=float(np.sqrt(np.mean(residual**2))),
    )


def fit_halves(basis: Samples, values: Samples, omega: float) -> tuple[SineFit, complex, complex]:
    """Fit a signal as a whole, and the phasors of its fundamental in its first and second half."""
    middle = values.size // 2
    (first, of_first), (second, of_second) = (
        _equations(basis[:, half], values[half]) for half in (slice(middle), slice(middle, None))
    )
    before, after = (
        complex(*(np.linalg.solve(matrix, moments)[1:3] * _TO_PHASOR))
        for matrix, moments in ((first, of_first), (second, of_second))
    )
    harmonics = basis.shape[0] // 2
    both = first + second, of_first + of_second
    return fit_basis(basis, values, omega, harmonics, both), before, after


def _equations(basis: Samples, values: Samples) -> tuple[Samples, Samples]:
    """Return the (m, m) matrix and the (m,) right-hand side of the normal equations."""
    return np.asarray(basis @ basis.T), np.asarray(basis @ values)
