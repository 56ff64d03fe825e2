"""The figures of an identification, as plotly's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from butterfly.errors import InputError, nearest
from butterfly.identification.identification import Identification
from butterfly.model.parameters import LumpedParameters
from butterfly.report.estimate_figures import (
    correlation_map,
    frequency_response_figure,
    parameter_figure,
    ranked_figure,
)
from butterfly.report.figures import middle
from butterfly.report.log_figures import time_figure
from butterfly.report.parameter_table import parameter_rows

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


@dataclass(frozen=True)
class IdentificationPlots:
    """Figures of an identification.

    Parameters
    ----------
    identification
        With its logs.
    """

    identification: Identification

    def parameters(self, truth: LumpedParameters | None = None) -> Figure:
        """Draw the estimates with their intervals, beside the truth where it is known."""
        return parameter_figure(parameter_rows(self.identification.estimate.table(truth)))

    def correlations(self) -> Figure | None:
        """Draw how the errors of the parameters go together; None without a covariance."""
        return correlation_map(self.identification.estimate)

    def fits(self) -> Figure:
        """Draw the FIT of every log, the worst first."""
        return ranked_figure(self.identification)

    def frequency_response(self) -> Figure:
        """Draw gain and phase over frequency, measured, and the model at the measured swing."""
        return frequency_response_figure(self.identification)

    def time(self, log: str | int | None = None) -> Figure:
        """Draw measured and simulated angle of a log, by its name or number.

        Parameters
        ----------
        log
            The one with the middle FIT if not given.

        Raises
        ------
        InputError
            If there is no such log.
        """
        runs = self.identification.free_runs
        names = [run.log.name for run in runs]
        if log is None:
            log = middle([run.fit for run in runs])
        if isinstance(log, str):
            if log not in names:
                raise InputError("plot.time", "log", log, nearest(log, names))
            log = names.index(log)
        if not isinstance(log, int) or not -len(runs) <= log < len(runs):
            raise InputError("plot.time", "log", log, f"a number below {len(runs)}")
        return time_figure(runs[log], self.identification.misfit.logs[log].band)
