"""Residuals of all logs in sentences and a table, of one log in figures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from butterfly.identification.diagnostics.residuals import LogResiduals, Residuals
from butterfly.identification.test_functions import ResidualTorque
from butterfly.model.parameters import JointKind
from butterfly.report.figures import add, look, seen_samples
from butterfly.report.finding_texts import finding_text
from butterfly.report.log_figures import correlation_figure
from butterfly.report.page import PageTable

HEADERS = (
    *(
        "log",
        "error in % of motion",
        "after small changes",
        "sensor noise in %",
        "times noise",
        "bands",
    ),
    "missing terms explain in %",
)

_CAPTION = (
    "Error: rms of measured minus simulated motion, in % of the rms motion, averaged over steps of "
    "the simulation. Next: the part that no small change of the parameters removes, and the error "
    "that encoder resolution and noise explain. Bands: whether autocorrelation and "
    "cross-correlation with the input stay within 95 % bands of sensor noise; one good log in "
    "twenty does not. A misfit of 0.1 % of the motion counts for nothing: where the error is no "
    "larger, the bands are as wide as the curves can be, and nothing is tested."
)
EXPLAINED = (
    "The log with the largest error. Residual torque, averaged over short intervals in which the "
    "joint moves: a missing term that depends on time, angle or velocity shows as a curve. "
    "Autocorrelation of the free run's error, and its cross-correlation with past input: if sensor "
    "noise explains it, both stay within the bands."
)
"""What `residual_figures` shows."""

_MOST = 6000  # instants of a panel


def residual_sentences(residuals: Residuals) -> list[str]:
    """Say how large the residuals of all logs are, and what explains them."""
    count, outside = len(residuals.logs), residuals.outside
    lead = f"In {outside} of {count} logs the error exceeds"
    if count == 1:
        lead = "The error exceeds" if outside else "The error does not exceed"
    elif not outside:
        lead = f"In none of the {count} logs does the error exceed"
    return [
        f"{lead} sensor noise (95 % bands). "
        f"Over all logs the error is {100 * residuals.relative:.2g} % of the motion, "
        f"{100 * residuals.left:.2g} % after small changes of the parameters; sensor noise is "
        f"{100 * residuals.explained:.2g} %.",
        *(finding_text(each, {}) for each in residuals.missing.findings),
    ]


def residual_table(logs: Iterable[LogResiduals], picks: Sequence[int] = ()) -> PageTable:
    """Make a table with a row per log, each of which may choose a log by its number."""
    rows = []
    for log in logs:
        shares = [100 * each / log.motion for each in (log.error, log.left, log.explained)]
        numbers = [f"{share:.2g}" if np.isfinite(share) else "–" for share in shares]
        times = f"{log.times:.1f}" if np.isfinite(log.times) else "–"
        missing = f"{100 * log.share:.0f}" if log.share else "–"
        rows.append((log.label, *numbers, times, "outside" if log.outside else "inside", missing))
    return PageTable(name="residuals", headers=HEADERS, rows=rows, caption=_CAPTION, picks=picks)


def residual_figures(
    residual: ResidualTorque, residuals: LogResiduals, joint: JointKind
) -> dict[str, Figure]:
    """Return the residual torque of a log, and the correlations of its free run's error."""
    title = "residual force in N" if joint is JointKind.SLIDE else "residual torque in N m"
    torque = _torque_figure(residual, title, joint.way)
    return {"torque": torque, "correlations": correlation_figure(residuals)}


def _torque_figure(residual: ResidualTorque, title: str, way: str) -> Figure:
    columns = {
        "time in s": residual.time,
        f"angle in {way}": residual.angle,
        f"velocity in {way}/s": residual.velocity,
    }
    figure = make_subplots(rows=3, cols=1, vertical_spacing=0.11)
    some = seen_samples([residual.torque], _MOST)
    torque = residual.torque[some].astype(np.float32)
    for row, (below, values) in enumerate(columns.items(), start=1):
        colour, _ = look(row - 1)
        style = {"line": {"color": colour, "width": 1}, "mode": "lines" if row == 1 else "markers"}
        style["marker"] = {"color": colour, "size": 3, "opacity": 0.8}
        add(figure, row, values[some], torque, showlegend=False, **style)
        figure.update_xaxes(title=below, row=row)
        figure.update_yaxes(title=title, row=row)
    figure.update_layout(height=880)
    return figure
