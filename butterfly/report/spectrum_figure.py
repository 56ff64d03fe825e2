"""At which frequencies the model misses something: spectra of a log and of what is left over."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure, Scatter

from butterfly.identification.diagnostics.misfit import LogMisfit
from butterfly.identification.free_run import FreeRun
from butterfly.report.figures import GREY, PALETTE
from butterfly.report.series import Series, packable
from butterfly.signals.spectrum import periodogram, resample, uniform_grid

Samples = NDArray[np.float64]

_POINTS = 250  # of a curve, evenly over the logarithm of the frequency
_MOST_SAMPLES = 2**20  # that a spectrum is taken of
_NAMES = ("measured angle", "measured − simulated", "what the sensor explains")


def spectrum_figure(run: FreeRun, misfit: LogMisfit) -> Figure:
    """Draw amplitudes of the angle, and of what the model leaves over of it, over frequency.

    Parameters
    ----------
    run
        A log, simulated.
    misfit
        What is left over of it.
    """
    omega, *curves = _curves(run, misfit)
    way = run.log.added_mass.joint.way
    figure = Figure()
    lines = (
        {"color": GREY, "width": 1},
        {"color": PALETTE[0], "width": 1.4},
        {"color": PALETTE[5], "width": 1.2, "dash": "dash"},
    )
    hover = f"%{{x:.3g}} rad/s: %{{y:.3g}} {way}"
    for name, line, values in zip(_NAMES, lines, curves, strict=True):
        figure.add_trace(
            Scatter(x=omega, y=values, name=name, line=line, mode="lines", hovertemplate=hover)
        )
    figure.update_xaxes(title="ω in rad/s", type="log")
    figure.update_yaxes(title=f"amplitude in {way}", type="log")
    figure.update_layout(height=340)
    return figure


def spectrum_series(runs: Sequence[FreeRun], misfits: Sequence[LogMisfit]) -> Series:
    """Return what a page needs to draw `spectrum_figure` of each run."""
    curves = [
        [[packable(curve, logarithmic=True) for curve in _curves(*each)]]
        for each in zip(runs, misfits, strict=True)
    ]
    return Series.of(spectrum_figure(runs[0], misfits[0]), curves)


def _curves(run: FreeRun, misfit: LogMisfit) -> tuple[Samples, ...]:
    """Return frequencies in rad/s, and amplitudes of a sine that would look so.

    Of several frequencies that share a point, it is the largest amplitude.
    """
    log = run.log
    every = max(1, log.time.size // _MOST_SAMPLES)
    time = log.time[::every]
    grid = uniform_grid(time)
    columns = [
        resample(time, each[::every], grid) for each in (log.angle, log.angle - run.simulated)
    ]
    step = float(grid[1] - grid[0])
    with np.errstate(over="ignore", invalid="ignore"):  # of a run that ran away there is none
        spectra = [periodogram(values - values.mean(), step) for values in columns]
    omega = spectra[0][0]
    edges = np.unique(np.searchsorted(omega, np.geomspace(omega[0], omega[-1], _POINTS + 1)[:-1]))
    peaks = [np.sqrt(4 * np.maximum.reduceat(power, edges) / grid.size) for _, power in spectra]
    sensor = np.full(edges.size, 2 * misfit.sensor.spread / np.sqrt(grid.size))
    return (omega[edges], *peaks, sensor)
