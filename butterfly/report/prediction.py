"""The report of a prediction: which samples lie inside the bands, and what the bands look like."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from plotly.graph_objects import Figure, Scatter
from plotly.subplots import make_subplots

from butterfly.identify.prediction import OF_NEW_LOG, OF_PARAMETERS
from butterfly.report.figures import PALETTE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.identify.prediction import Prediction

_DRAWN = 12  # logs at most, of which a figure shows the course
_FILLS = {OF_NEW_LOG: "rgba(86, 180, 233, 0.30)", OF_PARAMETERS: "rgba(213, 94, 0, 0.45)"}
_COLOURS = {OF_NEW_LOG: PALETTE[4], OF_PARAMETERS: PALETTE[5]}


def share_figure(predictions: Sequence[Prediction]) -> Figure:
    """Draw the share of measured samples inside each band, a point for each log."""
    labels = [each.run.log.label for each in predictions]
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
            for name, colour in _COLOURS.items()
            if name in predictions[0].bands
        ]
    )
    figure.add_hline(y=95, line={"color": "#888888", "width": 1, "dash": "dash"})
    figure.update_xaxes(title="number of the log")
    figure.update_yaxes(title="measured samples inside, %", range=[0, 102])
    figure.update_layout(height=380)
    return figure


def band_figures(predictions: Sequence[Prediction], *, measured: bool) -> dict[str, Figure]:
    """Draw predictions in time, by the labels of their logs: all, or some from all over the list.

    Parameters
    ----------
    predictions
        With bands.
    measured
        Whether their logs were measured.
    """
    count = len(predictions)
    picked = np.unique(np.linspace(0, count - 1, min(count, _DRAWN)).round().astype(int))
    return {
        f"{number}: {predictions[number].run.log.label}": _band_figure(
            predictions[number], measured=measured
        )
        for number in picked.tolist()
    }


def _band_figure(prediction: Prediction, *, measured: bool) -> Figure:
    """Angle and bands against time, and below both less the free run."""
    centre = prediction.run.simulated[prediction.samples]
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.55, 0.45]
    )
    time = prediction.time.astype(np.float32)

    def line(row: int, values: NDArray[np.float64], **style: object) -> None:
        trace = Scatter(x=time, y=values.astype(np.float32), mode="lines", **style)
        figure.add_trace(trace, row=row, col=1)

    for row, about in ((1, np.zeros_like(centre)), (2, centre)):
        for name, fill in _FILLS.items():
            if name not in prediction.bands:
                continue
            band, shown = prediction.bands[name], {"showlegend": row == 1, "legendgroup": name}
            edge = {"width": 0, "color": _COLOURS[name]}
            line(
                row,
                band.lower - about,
                line=edge,
                hoverinfo="skip",
                **shown | {"showlegend": False},
            )
            line(
                row,
                band.upper - about,
                line=edge,
                fill="tonexty",
                fillcolor=fill,
                name=f"band of {name}",
                hoverinfo="skip",
                **shown,
            )
        free = {"color": PALETTE[5], "width": 1}
        line(row, centre - about, name="free run", line=free, showlegend=row == 1)
        if measured:
            style = {"color": PALETTE[0], "width": 1}
            line(row, prediction.measured - about, name="measured", line=style, showlegend=row == 1)
    title = f"{prediction.run.log.label}: angle in rad"
    figure.update_yaxes(title=title, row=1)
    figure.update_yaxes(title="less free run, rad", row=2)
    figure.update_xaxes(title="time in s", row=2)
    figure.update_layout(height=460)
    return figure
