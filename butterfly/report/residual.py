"""Residuals of all logs in sentences and a table, of one log in figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from butterfly.files import finite
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.residuals import LogResiduals, Residuals
from butterfly.identification.test_functions import ResidualTorque
from butterfly.model.parameters import JointKind
from butterfly.report.figures import add, look, seen_samples
from butterfly.report.finding_texts import finding_text
from butterfly.report.log_figures import correlation_figure
from butterfly.report.log_table import RESIDUAL_CAPTION, residual_row
from butterfly.report.page import Page, PageTable, Section

_EXPLAINED = (
    "The log with the largest error. Residual torque, averaged over short intervals in which the "
    "joint moves: a missing term that depends on time, angle or velocity shows as a curve. "
    "Autocorrelation of the free run's error, and its cross-correlation with past input: if sensor "
    "noise explains it, both stay within the bands."
)
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
        f"{100 * residuals.remaining:.2g} % after small changes of the parameters; sensor noise is "
        f"{100 * residuals.explained:.2g} %.",
        *(finding_text(finding, {}) for finding in residuals.missing.findings),
    ]


def residual_table(logs: Sequence[LogResiduals], picks: Sequence[int]) -> PageTable:
    """Make a table with a row per log, each of which chooses a log by its number."""
    rows = finite([{"log": log.label} | residual_row(log) for log in logs])
    table = PageTable.of("", rows, caption=RESIDUAL_CAPTION)
    return table.on_page()._replace(name="residuals", picks=picks)


def with_residual_figures(
    data: DataSet, estimate: Estimate, number: int, residuals: LogResiduals, page: Page
) -> Page:
    """Return a page with the residual torque and the correlations of a log, by its number."""
    setting = data.simulations.setting(number, estimate)
    torque = ResidualTorque.of(data.logs[number], setting.parameters, setting.zero)
    figures = {
        "torque": torque_figure(torque, data.joint),
        "correlations": correlation_figure(residuals),
    }
    return replace(page, lead=Section(title="At a glance", text=_EXPLAINED, figures=figures))


def torque_figure(residual: ResidualTorque, joint: JointKind, most: int = _MOST) -> Figure:
    """Draw the residual torque of a log against time, angle and velocity."""
    title = "residual force in N" if joint is JointKind.SLIDE else "residual torque in N m"
    way = joint.way
    columns = {
        "time in s": residual.time,
        f"angle in {way}": residual.angle,
        f"velocity in {way}/s": residual.velocity,
    }
    figure = make_subplots(rows=3, cols=1, vertical_spacing=0.11)
    some = seen_samples([residual.torque], most)
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
