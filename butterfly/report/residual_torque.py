"""What the model leaves over of one log: its torque, and the correlations of its errors."""

from __future__ import annotations

from html import escape
from textwrap import wrap
from typing import TYPE_CHECKING

from plotly.graph_objects import Scatter
from plotly.subplots import make_subplots

from butterfly.files import replacing
from butterfly.model.parameters import JointKind
from butterfly.report.figures import PALETTE
from butterfly.report.misfit import draw_correlations

if TYPE_CHECKING:
    from pathlib import Path

    from butterfly.identify.judgement.misfit import LogMisfit
    from butterfly.identify.judgement.residual_torque import ResidualTorque
    from butterfly.report.verdict import SaidVerdict

_WIDEST = 140  # characters of a line above the figure


def write_residual(
    residual: ResidualTorque,
    misfit: LogMisfit,
    verdict: SaidVerdict,
    path: Path,
    *,
    joint: JointKind = JointKind.HINGE,
) -> None:
    """Draw what is left over in one log as one HTML file that opens offline.

    Parameters
    ----------
    residual, misfit
        Of the log.
    verdict
        On the estimate that leaves it.
    path
        The file.
    joint
        That made the log.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    way = joint.way
    panels = {
        "time in s": residual.time,
        f"angle in {way}": residual.angle,
        f"velocity in {way}/s": residual.velocity,
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
        figure.update_yaxes(
            title="force in N" if joint is JointKind.SLIDE else "torque in N m", row=row
        )
    draw_correlations(figure, misfit, first=4)
    looks = escape(residual.left_over.words("the motor's torque"))
    lines = [f"Left over in {escape(residual.label)}: torque like {looks}"]
    lines += [f"<sub>{escape(line)}</sub>" for line in wrap(verdict.sentence, _WIDEST)]
    margin = {"t": 80 + 22 * len(lines)}
    place = {"y": 1, "yanchor": "top", "yref": "container", "pad": {"t": 20}}
    heading = {"text": "<br>".join(lines)} | place
    figure.update_layout(title=heading, margin=margin, template="plotly_white", height=1500)
    with replacing(path) as draft:
        figure.write_html(draft, include_plotlyjs=True)
