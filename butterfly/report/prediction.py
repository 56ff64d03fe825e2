"""The report of a prediction: which samples lie inside the bands, and what the bands look like."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from plotly.graph_objects import Figure, Scatter
from plotly.subplots import make_subplots

from butterfly.identification.predict import OF_NEW_LOG, OF_PARAMETERS, Prediction
from butterfly.report.figures import GREY, PALETTE, Series

_DRAWN = 12  # logs at most, of which a figure shows the course
_BANDS = {OF_NEW_LOG: (PALETTE[4], 0.35), OF_PARAMETERS: (PALETTE[1], 0.8)}  # colour, opacity


def share_figure(predictions: Sequence[Prediction]) -> Figure:
    """Draw the share of measured samples inside each band, a point for each log."""
    labels = [escape(each.run.log.label) for each in predictions]
    figure = Figure(
        [
            Scatter(
                x=list(range(len(predictions))),
                y=[100 * each.bands[name].share(each.measured) for each in predictions],
                text=labels,
                name=f"band of {name}",
                mode="markers",
                marker={"color": colour, "size": 8},
                hovertemplate="%{text}: %{y:.1f} %",
            )
            for name, (colour, _) in _BANDS.items()
            if name in predictions[0].bands
        ]
    )
    figure.add_hline(y=95, line={"color": GREY, "width": 1, "dash": "dash"})
    figure.update_xaxes(title="number of the log")
    figure.update_yaxes(title="measured samples inside, %", range=[0, 102])
    figure.update_layout(height=380)
    return figure


def drawn_predictions(predictions: Sequence[Prediction]) -> list[Prediction]:
    """Return those that a page draws in time: all, or some from all over the list."""
    count = len(predictions)
    picked = np.unique(np.linspace(0, count - 1, min(count, _DRAWN)).round().astype(int))
    return [predictions[number] for number in picked]


def band_series(predictions: Sequence[Prediction], *, measured: bool) -> Series:
    """Return what a page needs to draw each prediction in time."""
    return Series.of_figures([band_figure(each, measured=measured) for each in predictions])


def band_figure(prediction: Prediction, *, measured: bool) -> Figure:
    """Draw angle and bands against time, and below both less the free run.

    The measured angle too, where there was one.
    """
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.55, 0.45]
    )
    way = prediction.run.log.added_mass.joint.way
    centre = prediction.run.simulated[prediction.samples]
    lines = {"free run": (centre, PALETTE[5])}
    if measured:
        lines["measured"] = prediction.measured, PALETTE[0]
    for row, about in ((1, np.zeros_like(centre)), (2, centre)):
        shown = {"mode": "lines", "showlegend": row == 1}
        for name, (colour, opacity) in _BANDS.items():
            if name not in prediction.bands:
                continue
            band = prediction.bands[name]
            outline = np.concatenate([band.upper - about, (band.lower - about)[::-1]])
            filled = Scatter(
                x=np.concatenate([prediction.time, prediction.time[::-1]]),
                y=outline.astype(np.float32),
                name=f"95 %, {name}",
                fill="toself",
                fillcolor=colour,
                opacity=opacity,
                line={"width": 0, "color": colour},
                hoverinfo="skip",
                **shown,
            )
            figure.add_trace(filled, row=row, col=1)
        for name, (angle, colour) in lines.items():
            drawn = Scatter(
                x=prediction.time,
                y=(angle - about).astype(np.float32),
                name=name,
                line={"width": 1, "color": colour},
                hovertemplate=f"%{{x:.2f}} s: %{{y:.4f}} {way}",
                **shown,
            )
            figure.add_trace(drawn, row=row, col=1)
    figure.update_yaxes(title=f"angle in {way}", row=1)
    figure.update_yaxes(title=f"less free run, {way}", row=2)
    figure.update_xaxes(title="time in s", row=2)
    figure.update_layout(height=460)
    return figure
