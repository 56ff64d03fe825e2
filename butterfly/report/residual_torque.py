"""What the model leaves over of one log: its torque, and the correlations of its errors."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from plotly.graph_objects import Scatter
from plotly.subplots import make_subplots

from butterfly.files import replacing
from butterfly.report.figures import PALETTE
from butterfly.report.misfit import draw_correlations

if TYPE_CHECKING:
    from pathlib import Path

    from butterfly.identify.judgement.misfit import LogMisfit
    from butterfly.identify.judgement.residual_torque import ResidualTorque


def write_residual(residual: ResidualTorque, misfit: LogMisfit, path: Path) -> None:
    """Draw what is left over in one log as one HTML file that opens offline.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    panels = {
        "time in s": residual.time,
        "angle in rad": residual.angle,
        "velocity in rad/s": residual.velocity,
    }
    figure = make_subplots(rows=5, cols=1, vertical_spacing=0.07)
    for row, (title, values) in enumerate(panels.items(), start=1):
        style = {"mode": "lines" if row == 1 else "markers", "showlegend": False}
        colour = PALETTE[row - 1]
        trace = Scatter(
            x=values,
            y=residual.torque,
            line={"color": colour, "width": 1},
            marker={"color": colour, "size": 3, "opacity": 0.5},
            **style,
        )
        figure.add_trace(trace, row=row, col=1)
        figure.update_xaxes(title=title, row=row)
        figure.update_yaxes(title="torque in N m", row=row)
    draw_correlations(figure, misfit, first=4)
    looks = escape(residual.left_over.words("the motor's torque"))
    title = f"Left over in {escape(residual.label)}: torque like {looks}"
    figure.update_layout(title=title, template="plotly_white", height=1500)
    with replacing(path) as draft:
        figure.write_html(draft, include_plotlyjs=True)
