"""What `butterfly inspect` says about one log."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from butterfly.files import replacing
from butterfly.signals.amplitude import rms_amplitude
from butterfly.signals.periodogram import periodogram
from butterfly.signals.resample import resample, uniform_grid

if TYPE_CHECKING:
    from butterfly.logs.health import Health
    from butterfly.logs.log import Log


def health_rows(log: Log, health: Health) -> list[tuple[str, str]]:
    """Tabulate a log's clock, range, dominant frequency and findings, as names and texts."""
    grid = uniform_grid(log.time)
    swing = resample(log.time, log.angle, grid)
    swing = swing - swing.mean()
    omega, power = periodogram(swing, grid[1] - grid[0])
    bin_width = omega[0]
    return [
        ("samples", f"{health.samples}"),
        ("duration", f"{health.duration:.3f} s"),
        (
            "sampling interval",
            f"{1e3 * health.step:.3f} ms, jitter {1e3 * health.jitter:.3f} ms rms",
        ),
        ("longest interval", f"{1e3 * health.longest_gap:.2f} ms"),
        ("input", f"{log.input.min():.5g} … {log.input.max():.5g}"),
        ("angle", f"{log.angle.min():.5g} … {log.angle.max():.5g} rad"),
        (
            "amplitude (71)",
            f"{rms_amplitude(swing):.4g} rad about the mean {log.angle.mean():.4g} rad",
        ),
        ("dominant frequency", f"{omega[np.argmax(power)]:.3f} ± {bin_width / 2:.3f} rad/s"),
        ("findings", "; ".join(health.findings) or "none"),
    ]


def write_inspection(log: Log, health: Health, path: Path) -> None:
    """Draw a log against time as one HTML file that opens offline.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    from butterfly.report.figures import log_figure  # noqa: PLC0415 - slow to import

    titles = {"input": "input", "angle": "angle in rad", "velocity": "velocity in rad/s"}
    columns = {titles[name]: values for name, values in log.columns().items() if name in titles}
    middles = (log.time[1:] + log.time[:-1]) / 2
    figure = log_figure(log.time, columns, (middles, 1e3 * np.diff(log.time)))
    findings = "; ".join(health.findings) or "no findings"
    title = f"{escape(Path(log.source).name)}<br><sup>{escape(findings)}</sup>"
    figure.update_layout(title=title, template="plotly_white")
    with replacing(path) as draft:
        figure.write_html(draft, include_plotlyjs=True)
