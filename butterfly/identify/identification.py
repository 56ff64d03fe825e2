"""The whole job on one data set: read, check, respond, fit, validate."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from butterfly.identify.comparison import Comparison, best_gain, compare
from butterfly.identify.free_run import FitSummary, FreeRun, free_run
from butterfly.identify.harmonic_balance import fit_harmonic_balance
from butterfly.identify.thesis import DECIMATION, fit_thesis
from butterfly.logs.health import Health, examine
from butterfly.logs.manifest import Manifest, read_entry
from butterfly.progress import Track, untracked
from butterfly.signals.frequency_response import ResponsePoint, response_point

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.logs.log import InputKind, Log
    from butterfly.model.parameters import AddedMass, LumpedParameters


class Method(StrEnum):
    """Estimators to choose from."""

    HARMONIC_BALANCE = "harmonic-balance"
    THESIS = "thesis"


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification:
    """Everything that was learnt from one data set.

    Parameters
    ----------
    name, description
        Of the data set.
    input_kind
        What its input commands.
    logs, health
        The logs, repaired, and the record of what was found in each.
    points
        The steady response of each log.
    estimate
        The parameters.
    equilibria
        Encoder reading in rad of the hand at rest, per added mass.
    free_runs
        Simulation of each log with the estimate.
    comparisons
        Other parameters on the same logs.
    """

    name: str
    description: str
    input_kind: InputKind
    logs: tuple[Log, ...]
    health: tuple[Health, ...]
    points: tuple[ResponsePoint, ...]
    estimate: ParameterEstimate
    equilibria: dict[AddedMass, float]
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
    *,
    decimation: int = DECIMATION,
    against: Mapping[str, LumpedParameters] = MappingProxyType({}),
    track: Track = untracked,
) -> Identification:
    """Read a data set and identify the robot from it.

    Parameters
    ----------
    manifest
        The data set.
    method
        The estimator.
    decimation
        Of the thesis's method only.
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
    entries = track(manifest.logs, "Reading logs")
    recorded = [read_entry(manifest, entry) for entry in entries]
    examined = [examine(log, manifest.repair) for log in recorded]
    logs = [log for log, _ in examined]
    points = [response_point(log) for log in track(logs, "Fitting sines")]
    equilibria = equilibrium_angles(points)
    if method is Method.THESIS:
        estimate = fit_thesis(recorded, decimation)
        estimate = estimate.with_gain(
            best_gain(estimate.parameters, logs, points, equilibria, track=track)
        )
    else:
        estimate = fit_harmonic_balance(points)
    return Identification(
        name=manifest.name,
        description=manifest.description,
        input_kind=manifest.input,
        logs=tuple(logs),
        health=tuple(health for _, health in examined),
        points=tuple(points),
        estimate=estimate,
        equilibria=equilibria,
        free_runs=tuple(
            free_run(log, estimate.parameters, equilibria[log.added_mass])
            for log in track(logs, "Simulating logs")
        ),
        comparisons=tuple(
            compare(name, parameters, logs, points, equilibria, track=track)
            for name, parameters in against.items()
        ),
    )


def equilibrium_angles(points: Sequence[ResponsePoint]) -> dict[AddedMass, float]:
    """Median of the steady mean angles in rad of each added mass."""
    masses = sorted({point.added_mass for point in points})
    return {
        mass: float(np.median([p.angle.offset for p in points if p.added_mass == mass]))
        for mass in masses
    }
