"""Fits of sines, spectra, and the frequency response of sine logs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.optimize import least_squares, minimize_scalar

from butterfly.arrays import Samples, blocks
from butterfly.errors import InputError
from butterfly.logs.log import Log
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.signals import hold

if TYPE_CHECKING:
    import control

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


STEADY_SECONDS = 30.0
"""Length of the window at the end of a log, as in the thesis, without the transient."""

MIN_PERIODS = 3
"""Fewest whole periods in a window."""

LOUD = 0.1
"""Other motion relative to the swing above which a transient is fitted."""

_CALMER = 0.5  # largest residual with a transient, relative to that without

_CELLS = 64  # of a period, over which the input is averaged
_PER_PERIOD = 2 * HARMONICS  # samples that show the harmonics which are fitted
_FEWEST = 2 * (1 + 2 * HARMONICS)  # samples in both halves of a window, for what is fitted there

MIN_COHERENCE = 0.5
"""Least fraction of the input's variance that the commanded sine must explain."""


def steady_window(log: Log, omega: float, seconds: float = STEADY_SECONDS) -> NDArray[np.bool_]:
    """Return the (n,) mask of the last whole periods of a log, in at most `seconds`.

    Whole periods keep the sine, its harmonics and the mean orthogonal on a uniform clock. For
    slower sines the window has `MIN_PERIODS` periods; a shorter log is an InputError.
    """
    period = 2 * math.pi / omega
    available = float(log.time[-1] - log.time[0])
    whole = math.floor(available / period)
    if whole < MIN_PERIODS:
        raise InputError(
            log.source,
            "time",
            f"{available:.3g} s",
            f"at least {MIN_PERIODS} periods of {period:.3g} s",
        )
    count = max(math.floor(min(seconds, available) / period), MIN_PERIODS)
    return np.asarray(log.time > log.time[-1] - count * period)


def first_counted(log: Log, seconds: float = STEADY_SECONDS) -> int:
    """Return the number of the first sample that counts in the free-run error.

    For a sine it begins the last ``seconds``, since the start depends on how the joint came to
    rest.
    """
    return 0 if log.excitation is None else int(np.searchsorted(log.time, log.time[-1] - seconds))


@dataclass(frozen=True, kw_only=True, eq=False)
class ResponsePoint:
    """One log's steady response at the frequency of its input."""

    added_mass: AddedMass  # Of the log
    input: complex  # Complex amplitude of the input at the joint, including its hold
    angle: SineFit  # Sine fit of the angle
    # Relative change of the angle's amplitude from the window's first to its second half
    drift: float
    label: str  # Short name of the log
    # In 1/s, of a transient that still rings and was fitted too; None where there is none
    pole: complex | None = None
    detuning: float = 0.0  # Relative deviation of the input's frequency from the stated one

    @property
    def omega(self) -> float:
        """Frequency in rad/s."""
        return self.angle.omega

    @property
    def amplitude(self) -> float:
        """Amplitude of the angle's fundamental in rad."""
        return self.angle.amplitude

    @property
    def gain(self) -> complex:
        """Angle over input, in rad per unit of input (68) with its phase."""
        return self.angle.fundamental / self.input


def response_point(
    log: Log, seconds: float = STEADY_SECONDS, pole: complex | None = None
) -> ResponsePoint:
    """Fit the steady response of a log whose input is a sine, from its last `seconds`.

    A transient with `pole` is fitted too; a large one is found automatically (see
    `with_transient`). InputError if the log has no sine, is too short or too coarse, or has another
    input.
    """
    if log.excitation is None:
        raise InputError(log.source, "excitation", "none", "a sine with omega and amplitude")
    omega = log.excitation.omega
    rows = steady_window(log, omega, seconds)
    time, inputs, angle = log.time[rows], log.input[rows], log.angle[rows]
    _refuse_coarse(log, omega, time)
    basis = sine_basis(time, omega)
    command, first, second = fit_halves(basis[:3], inputs, omega)
    spread = float(np.std(inputs))
    explained = 1.0 - (command.residual_rms / spread) ** 2 if spread > 0 else 0.0
    if explained < MIN_COHERENCE:
        raise InputError(
            log.source,
            "input",
            f"a signal with {explained:.0%} of its variance at {omega:g} rad/s",
            f"a sine of {omega:g} rad/s",
        )
    response, before, after = fit_halves(basis, angle, omega)
    if pole is None and math.sqrt(2) * response.residual_rms > LOUD * response.amplitude:
        pole = pole_of(time, angle - response.on(basis))
        calmer = fit_basis(with_transient(basis, time, pole), angle, omega)
        pole = pole if calmer.residual_rms < _CALMER * response.residual_rms else None
    if pole is not None:
        response = fit_basis(with_transient(basis, time, pole), angle, omega)
    return ResponsePoint(
        added_mass=log.added_mass,
        input=_delivered(log, omega, time),
        angle=response,
        drift=(abs(after) - abs(before)) / response.amplitude,
        label=log.label,
        pole=pole,
        detuning=float(np.angle(second / first)) / (omega * (time[-1] - time[0]) / 2),
    )


def _delivered(log: Log, omega: float, time: Samples) -> complex:
    """Return the phasor of the held input, periods weighted by their samples of the angle."""
    periods = round((log.time[-1] - time[0]) * omega / (2 * math.pi))
    span = 2 * math.pi / omega * periods
    edges = np.linspace(log.time[-1] - span, log.time[-1], periods * _CELLS + 1)
    means = hold.mean(log.time, log.input, edges, log.between_samples)
    turned = np.exp(-0.5j * omega * (edges[1:] + edges[:-1])) / np.sinc(1 / _CELLS)
    samples = np.histogram(time, edges[::_CELLS])[0]
    return complex(2 * (means * turned).reshape(-1, _CELLS).mean(axis=1) @ samples / samples.sum())


def _refuse_coarse(log: Log, omega: float, time: Samples) -> None:
    """Refuse a log sampled too slowly for its sine."""
    step = 2 * math.pi / (_PER_PERIOD * omega)
    mean_step = (time[-1] - time[0]) / max(time.size - 1, 1)
    if mean_step > step or time.size < _FEWEST:
        value = f"a mean sampling interval of {mean_step:.3g} s"
        raise InputError(
            log.source, "time", value, f"at most {step:.2g} s for a sine of {omega:g} rad/s"
        )


_SAMPLES = 1000  # that are enough to fit two numbers
_PADDED = 8


def pole_of(time: Samples, values: Samples) -> complex:
    """Return the pole in 1/s of the decay Re{c e^(pole t)} that fits (n,) values best."""
    grid = uniform_grid(time, max((time[-1] - time[0]) / _SAMPLES, float(np.diff(time).mean())))
    samples = resample(time, values, grid)
    since = grid - grid[0]
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(samples.size), _PADDED * samples.size))
    peak = (
        2 * np.pi * np.fft.rfftfreq(_PADDED * samples.size, grid[1] - grid[0])[np.argmax(spectrum)]
    )

    def residuals(pole: Samples) -> Samples:
        wave = np.exp(-abs(pole[0]) * since)
        basis = np.column_stack([wave * np.cos(pole[1] * since), wave * np.sin(pole[1] * since)])
        return np.asarray(samples - basis @ np.linalg.lstsq(basis, samples, rcond=None)[0])

    length = float(since[-1])
    fit = least_squares(residuals, [1.0 / length, peak], x_scale=[1.0 / length, 1.0 / length])
    return complex(-abs(fit.x[0]), fit.x[1])


def measured_response(
    points: Iterable[ResponsePoint], added_mass: AddedMass = NO_ADDED_MASS
) -> control.FrequencyResponseData:
    """Return the measured response with one added mass: angle over input, in rad per unit.

    Logs of one frequency are combined by least squares, which weights larger swings more.
    """
    taken = [
        point
        for point in points
        if point.added_mass.inertia_and_moment == added_mass.inertia_and_moment
    ]
    if not taken:
        raise InputError(
            "measured response", "added mass", added_mass, "an added mass of logs with sines"
        )
    inputs = np.array([point.input for point in taken])
    angles = np.array([point.angle.fundamental for point in taken])
    omegas, which = np.unique([point.omega for point in taken], return_inverse=True)
    gains = []
    for k in range(omegas.size):
        rows = which == k
        gains.append(np.vdot(inputs[rows], angles[rows]) / np.vdot(inputs[rows], inputs[rows]))
    import control  # noqa: PLC0415 - slow

    return control.frd(gains, omegas, inputs=["command"], outputs=["angle"], name="measured")
