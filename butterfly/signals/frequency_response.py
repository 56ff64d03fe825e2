"""Frequency-response points of sine logs, each from its steady response."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.logs.log import Log
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.signals import hold
from butterfly.signals.sine_fit import (
    HARMONICS,
    SineFit,
    fit_basis,
    fit_halves,
    sine_basis,
    with_transient,
)
from butterfly.signals.spectrum import resample, uniform_grid

if TYPE_CHECKING:
    import control

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
