"""Residuals of all logs in sentences and a table, of one log on a page."""

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
from butterfly.report.page import Fact, Page, PageTable, Section
from butterfly.result import versions
from butterfly.verdict import Verdict

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
    "twenty does not."
)
_MOST = 6000  # instants of a panel


def residual_sentences(residuals: Residuals) -> list[str]:
    """Say how large the residuals of all logs are, and what explains them."""
    count = len(residuals.logs)
    logs = "log" if count == 1 else "logs"
    some = f"{residuals.outside} of {count}" if residuals.outside else f"none of {count}"
    return [
        f"In {some} {logs} the error exceeds sensor noise (95 % bands). "
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


def residual_page(
    residual: ResidualTorque,
    residuals: LogResiduals,
    verdict: Verdict,
    summary: Sequence[str],
    *,
    joint: JointKind = JointKind.HINGE,
) -> Page:
    """Put together the page of one log's residual, by an estimate of that verdict."""
    what, unit = ("force", "N") if joint is JointKind.SLIDE else ("torque", "N m")
    torque = Section(
        title=f"Residual {what}",
        text="Averaged over short intervals in which the joint moves, against time, angle and "
        "velocity. A missing term that depends on one of them shows as a curve.",
        figures={"torque": _torque_figure(residual, f"{what} in {unit}", joint.way)},
    )
    errors = Section(
        title="Residual of the free run",
        text="Autocorrelation of the residual, and its cross-correlation with past input. If "
        "sensor noise explains the residual, both curves stay within the bands.",
        figures={"correlations": correlation_figure(residuals)},
    )
    return Page(
        name=residual.label,
        description="Residual of one log",
        kind="residual",
        verdict=verdict,
        facts=[
            Fact(
                "error of the free run", f"{100 * residuals.relative:.2g} %", "of the motion, rms"
            ),
            Fact("over sensor noise", f"{residuals.times:.3g} ×", "encoder resolution and noise"),
            Fact("correlations", "outside" if residuals.outside else "inside", "bands"),
        ],
        summary=[*summary],
        sections=[torque, errors],
        numbers={"data": {"name": residual.label}, "versions": versions()},
    )


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
