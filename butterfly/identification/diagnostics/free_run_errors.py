"""The errors of free runs, and what parameters that a model has, or lacks, would change of them.

Measured less simulated angle is averaged over the steps of the simulation and differentiated by
what the estimate has found, by each log's start, and by the terms that the model lacks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.left_over import missing_terms, slow_velocity
from butterfly.identification.draws import covariance_root, honest_covariance
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import Setting
from butterfly.identification.segments import Segments
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.signals.window import first_counted

Samples = NDArray[np.float64]

_INDEPENDENT = 1e-6  # size over the largest, below which a direction is none


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One log and its free run, where its errors count (see `first_counted`).

    Parameters
    ----------
    log
        The log.
    setting
        What it is simulated with.
    first
        Number of the first sample that counts.
    trajectory
        The simulation.
    motion
        Rms of the measured angle about its mean, in rad.
    """

    log: Log
    setting: Setting
    first: int
    trajectory: Simulation | Segments
    motion: float

    @classmethod
    def of(cls, log: Log, setting: Setting) -> Run:
        """Make a log ready to be simulated."""
        first = first_counted(log)
        return cls(
            log=log,
            setting=setting,
            first=first,
            trajectory=setting.simulation(log, first),
            motion=float(np.std(log.angle[first:])),
        )

    def simulated(self) -> Samples:
        """Return the simulated angles in rad at all stamps."""
        setting = self.setting
        return self.trajectory.at_stamps(setting.parameters, setting.zero, setting.velocity)


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Simulated less measured angle of one log, and its derivatives.

    Parameters
    ----------
    run
        The log and its simulation.
    whole
        (m,) errors in rad.
    own
        (k, j) orthonormal directions in which the log's own start moves them, k of m after k
        where the log is simulated in segments, each from a start of its own.
    shared
        (m, n) derivatives by what logs share, less those directions.
    missing
        By term that the model lacks: (m,) derivatives by it, less those directions.
    reach
        (m,) standard deviations in rad that the parameters' own errors give the simulated angle,
        to first order; zeros where the estimate says nothing of them.
    """

    run: Run
    whole: Samples
    own: tuple[Samples, ...]
    shared: Samples
    missing: dict[str, Samples]
    reach: Samples

    def less_own(self, errors: Samples) -> Samples:
        """Take from (m, k) errors what a change of the log's own start explains."""
        return less(self.own, errors)


def free_run_errors(data: DataSet, estimate: Estimate) -> list[Run | Errors]:
    """Simulate and differentiate all logs of a data set.

    Returns
    -------
    The errors of each; the run alone where a simulation fails or nothing moves.
    """
    predictor, slow = data.simulations, slow_velocity(data.logs)
    runs = [Run.of(log, predictor.setting(k, estimate)) for k, log in enumerate(data.logs)]
    owners, missing = estimate.owners(data.unread), missing_terms(estimate, data.logs[0].added_mass)
    varied = _Varied(estimate.names, _root_of(estimate), owners, missing)
    return [_differentiated(run, varied, slow) or run for run in runs]


def _root_of(estimate: Estimate) -> Samples:
    """(n, n) root of the covariance, as wide as the intervals; zeros where there is none."""
    try:
        return covariance_root(honest_covariance(estimate))
    except IdentifiabilityError:
        return np.zeros((len(estimate.names),) * 2)


def less(directions: Sequence[Samples], errors: Samples) -> Samples:
    """Take from (m, k) errors the orthonormal directions of stretches, one after the other."""
    ends = np.cumsum([each.shape[0] for each in directions])[:-1]
    pairs = zip(directions, np.split(errors, ends), strict=True)
    return np.concatenate([part - each @ (each.T @ part) for each, part in pairs])


def less_shared(logs: Sequence[Errors], errors: Sequence[Samples]) -> list[Samples]:
    """Take from each log's (m, k) errors what a change of shared parameters explains, jointly.

    Each log counts as it does in output error, by the mean square of its errors over its motion.
    """
    weights = [1 / (log.run.motion * log.whole.size**0.5) for log in logs]
    rows = np.concatenate([w * log.shared for w, log in zip(weights, logs, strict=True)])
    wanted = np.concatenate([w * each for w, each in zip(weights, errors, strict=True)])
    sizes = np.linalg.norm(rows, axis=0)
    sizes[sizes == 0] = 1.0
    change = np.linalg.lstsq(rows / sizes, wanted, rcond=_INDEPENDENT)[0] / sizes[:, None]
    return [each - log.shared @ change for log, each in zip(logs, errors, strict=True)]


class _Varied(NamedTuple):
    """By what errors are differentiated.

    ``names`` of parameters that logs share, and the (n, n) ``root`` of their covariance;
    ``owners`` of those that some logs share; names of terms that are ``missing``.
    """

    names: tuple[str, ...]
    root: Samples
    owners: list[tuple[str, AddedMass | str | None]]
    missing: tuple[str, ...]


def _differentiated(run: Run, varied: _Varied, slow: float) -> Errors | None:
    """Return a log's errors; None if they are no numbers, or nothing moves.

    A log's own are the velocity and the true angle at its start, which the encoder has rounded: a
    change of it moves the readings by 1 less what one of the zero does. Stribeck friction that is
    missing is looked for below the velocity ``slow``.
    """
    names, root, owners, missing = varied
    setting, log = run.setting, run.log
    parameters = setting.parameters
    if "stribeck" in missing:
        parameters = replace(parameters, stribeck_velocity=slow)
    local = dict.fromkeys(["zero", "velocity", *(name for name, _ in owners)])
    asked = [*names, *local, *missing]
    with np.errstate(all="ignore"):
        errors, rows, mixture = run.trajectory.linearised(
            asked, parameters, setting.zero, setting.velocity
        )
        slopes = dict(zip(asked, (rows @ mixture).T, strict=True))
    finite = np.isfinite(errors).all() and all(np.isfinite(each).all() for each in slopes.values())
    if not (finite and run.motion > 0):
        return None
    if isinstance(run.trajectory, Segments):
        own = run.trajectory.directions(parameters, setting.zero)
    else:
        own = (_orthonormal(np.column_stack([1 - slopes["zero"], slopes["velocity"]])),)
    mine = {None, log.added_mass, log.name}
    shared = [slopes[name] for name in names]
    shared += [slopes[name] * (whose in mine) for name, whose in owners]
    return Errors(
        run=run,
        whole=errors,
        own=own,
        shared=less(own, np.column_stack(shared)),
        missing={name: less(own, slopes[name]) for name in missing},
        reach=np.linalg.norm(np.column_stack([slopes[name] for name in names]) @ root.T, axis=1),
    )


def _orthonormal(columns: Samples) -> Samples:
    """(m, j) orthonormal columns that span those of (m, k) that are felt at all."""
    sizes = np.linalg.norm(columns, axis=0)
    felt = sizes > _INDEPENDENT * columns.shape[0] ** 0.5
    left, singular, _ = np.linalg.svd(columns[:, felt] / sizes[felt], full_matrices=False)
    return np.asarray(left[:, singular > _INDEPENDENT * singular.max(initial=0.0)])
