"""The page of what the model leaves over of one log: its torque, and the errors of its free run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from plotly.graph_objects import Scatter
from plotly.subplots import make_subplots

from butterfly.identification.diagnostics.misfit import LogMisfit
from butterfly.identification.diagnostics.residual_torque import ResidualTorque
from butterfly.model.parameters import JointKind
from butterfly.model.terms import TERMS
from butterfly.report.figures import look, seen_samples
from butterfly.report.misfit import bands_left, correlation_figure
from butterfly.report.page import Fact, Page, Section, Table, write_html
from butterfly.verdict import Verdict

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_MOST = 6000  # instants of a panel


def write_residual(
    residual: ResidualTorque,
    misfit: LogMisfit,
    verdict: Verdict,
    path: Path,
    *,
    joint: JointKind = JointKind.HINGE,
) -> None:
    """Write what is left over in one log as one HTML file that opens offline.

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
    write_html(residual_page(residual, misfit, verdict, joint=joint), path)


def residual_page(
    residual: ResidualTorque,
    misfit: LogMisfit,
    verdict: Verdict,
    *,
    joint: JointKind = JointKind.HINGE,
) -> Page:
    """Put together the page of what is left over in one log (see `write_residual`)."""
    what = "force" if joint is JointKind.SLIDE else "torque"
    looks = residual.left_over.words(f"the motor's {what}")
    shares = [
        (TERMS[name].looks_like, f"{100 * share:.1f}")
        for name, share in residual.left_over.shares.items()
    ]
    table = Table(
        headers=("missing term", "share of the variance that it explains, in %"), rows=shares
    )
    return Page(
        name=residual.label,
        description="What the model, all its terms, leaves over of one log",
        kind="residual",
        verdict=verdict,
        facts=[
            Fact("error of the free run", f"{100 * misfit.relative:.2g} %", "of the motion, rms"),
            Fact("beside its sensor", f"{misfit.times:.3g} ×", "what encoder and noise explain"),
            Fact("correlations", bands_left(misfit), "bands"),
        ],
        summary=[f"The {what} that is left over looks like {looks}"],
        sections=[
            Section(
                title=f"The {what} left over",
                text="Averaged over short bumps, where the joint moves; against time, angle and "
                "velocity. What depends on one of them alone is a curve there.",
                figures={"torque": _torque_figure(residual, what, joint)},
                tables=(table,) if shares else (),
            ),
            Section(
                title="The errors of the free run",
                text="How like itself the error is a while later, and how like the input before "
                "it. Where encoder and noise explain it, both curves stay inside the bands.",
                figures={"correlations": correlation_figure(misfit)},
            ),
        ],
        numbers={},
    )


def _torque_figure(residual: ResidualTorque, what: str, joint: JointKind) -> Figure:
    panels = {
        "time in s": residual.time,
        f"angle in {joint.way}": residual.angle,
        f"velocity in {joint.way}/s": residual.velocity,
    }
    unit = "N" if joint is JointKind.SLIDE else "N m"
    figure = make_subplots(rows=3, cols=1, vertical_spacing=0.11)
    some = seen_samples([residual.torque], _MOST)
    torque = residual.torque[some].astype(np.float32)
    for row, (title, values) in enumerate(panels.items(), start=1):
        colour, _ = look(row - 1)
        style = {"mode": "lines" if row == 1 else "markers", "showlegend": False}
        trace = Scatter(
            x=values[some].astype(np.float32),
            y=torque,
            line={"color": colour, "width": 1},
            marker={"color": colour, "size": 3, "opacity": 0.5},
            **style,
        )
        figure.add_trace(trace, row=row, col=1)
        figure.update_xaxes(title=title, row=row)
        figure.update_yaxes(title=f"{what} in {unit}", row=row)
    figure.update_layout(height=880)
    return figure
