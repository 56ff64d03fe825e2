"""One log against its free run in time: both angles, their difference, and its band."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from butterfly.identification.diagnostics.misfit import ErrorBand
from butterfly.identification.free_run import FreeRun
from butterfly.identification.inference.intervals import CONFIDENCE
from butterfly.report.figures import GREY, PALETTE, SHADE, add, seen_samples
from butterfly.report.series import Series, packable

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    Curves = tuple[NDArray[np.floating], ...]

_STEP = 0.02  # s between drawn points
_MOST, _LEAST = 150_000, 600  # points of all the logs of a page, and of each


def time_figure(run: FreeRun, band: ErrorBand | None, *, most: int = _MOST) -> Figure:
    """Measured and simulated angle of one log, and their difference, against time.

    Parameters
    ----------
    run
        The log, simulated.
    band
        Within which a reading of it is expected; None if nothing says so.
    most
        Points that are enough.
    """
    time, angle, simulated, lower, upper, difference = _curves(run, band, most)
    way = run.log.added_mass.joint.way
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.62, 0.38]
    )
    lines = {"mode": "lines", "hovertemplate": f"%{{x:.2f}} s: %{{y:.4f}} {way}"}
    add(figure, 1, time, angle, name="measured", line={"color": PALETTE[0], "width": 1.5}, **lines)
    dashed = {"color": PALETTE[5], "width": 1.5, "dash": "dot"}
    add(figure, 1, time, simulated, name="simulated", line=dashed, **lines)
    edge = {"mode": "lines", "line": {"color": GREY, "width": 0}, "hoverinfo": "skip"}
    add(figure, 2, time, lower, showlegend=False, **edge)
    name = f"{100 * CONFIDENCE:.0f} % band of parameters and sensor"
    add(figure, 2, time, upper, name=name, fill="tonexty", fillcolor=SHADE, **edge)
    thin = {"color": PALETTE[0], "width": 1}
    add(figure, 2, time, difference, name="difference", showlegend=False, line=thin, **lines)
    figure.update_yaxes(title=f"angle in {way}", row=1)
    figure.update_yaxes(title=f"measured −<br>simulated in {way}", row=2)
    figure.update_xaxes(title="time in s", row=2)
    figure.update_layout(height=500)
    return figure


def time_series(runs: Sequence[FreeRun], bands: Sequence[ErrorBand | None]) -> Series:
    """Return what a page needs to draw `time_figure` of each run."""
    most = max(_MOST // len(runs), _LEAST)
    return Series.of(
        time_figure(runs[0], bands[0], most=_LEAST),
        [
            [[packable(curve) for curve in _curves(*each, most)]]
            for each in zip(runs, bands, strict=True)
        ],
    )


def _curves(run: FreeRun, band: ErrorBand | None, most: int) -> Curves:
    """Return (n,) times in s, and measured, simulated, limits and difference of angles in rad."""
    log, difference = run.log, run.log.angle - run.simulated
    reach = np.full_like(difference, np.nan)
    if band is not None:
        reach = np.interp(log.time, band.time, band.reach, left=np.nan, right=np.nan)
    every = max(1, round(_STEP / log.mean_step))
    some = seen_samples([log.angle, difference], most, every=every)
    columns = (log.angle, run.simulated, -reach, reach, difference)
    with np.errstate(over="ignore"):  # what ran away is not drawn
        return log.time[some], *(column[some].astype(np.float32) for column in columns)
