"""The whole job on one data set: read, check, respond, fit, validate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from butterfly.identify.comparison import Comparison, compare
from butterfly.identify.data import DataSet, read_data_set
from butterfly.identify.free_run import FitSummary, FreeRun, free_run_of
from butterfly.identify.input_kind import judge_input
from butterfly.identify.methods import Method, Options, estimate
from butterfly.progress import Track, untracked

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.logs.manifest import Manifest
    from butterfly.model.parameters import LumpedParameters


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification:
    """Everything that was learnt from one data set.

    Parameters
    ----------
    data
        The logs and their steady responses.
    estimate
        The parameters.
    free_runs
        Simulation of each log with the estimate.
    comparisons
        Other parameters on the same logs.
    """

    data: DataSet
    estimate: ParameterEstimate
    free_runs: tuple[FreeRun, ...]
    comparisons: tuple[Comparison, ...]

    @property
    def fits(self) -> NDArray[np.float64]:
        """(n,) FIT of each log in per cent."""
        return np.array([run.fit for run in self.free_runs])

    @property
    def summary(self) -> FitSummary:
        """Median, mean and worst FIT."""
        return FitSummary.of(self.fits)


def identify(
    manifest: Manifest,
    method: Method = Method.HARMONIC_BALANCE,
    options: Options | None = None,
    *,
    against: Mapping[str, LumpedParameters] = MappingProxyType({}),
    track: Track = untracked,
) -> Identification:
    """Read a data set and identify the robot from it.

    Parameters
    ----------
    manifest
        The data set.
    method, options
        The estimator, and what it is told.
    against
        Other parameters to simulate the logs with, by name; a p4 that is NaN is fitted.
    track
        Shows progress.

    Raises
    ------
    InputError
        If a log cannot be read or used.
    IdentifiabilityError
        If the logs cannot determine the parameters.
    """
    data = read_data_set(manifest, track)
    found = estimate(data, method, options)
    found = replace(found, verdict=(*found.verdict, *judge_input(found, data.input_kind)))
    zeros = data.equilibria
    return Identification(
        data=data,
        estimate=found,
        free_runs=tuple(
            free_run_of(found, log, zeros) for log in track(data.logs, "Simulating logs")
        ),
        comparisons=tuple(
            compare(name, parameters, data, track=track) for name, parameters in against.items()
        ),
    )
