"""How well a joint explains logs as they are, or as they would be without a slip."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import ButterflyError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.physics import is_possible
from butterfly.identification.diagnostics.unit_errors.names import Slip
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.verdict import Level

FOLLOWED = 0.6
"""Misfit with which a slip undone must leave the logs at most."""

_MOST_STEPS = 200_000  # samples that are simulated for a trial, about
_NONE = 1e3  # misfit of logs that no joint explains
_HOPELESS = 1.0  # misfit without any terms, from which on terms do not help


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """How well a joint explains logs.

    Parameters
    ----------
    misfits
        (n,) 1 - FIT/100 of each log: 0 is perfect, 1 no better than a constant.
    """

    misfits: NDArray[np.float64]

    @property
    def misfit(self) -> float:
        """Median over the logs."""
        return float(np.median(self.misfits))


NOTHING = Trial(misfits=np.array([_NONE]))
"""Of logs that tell no parameters, or such as no joint can have."""


def attempt(undo: Callable[[DataSet], DataSet], data: DataSet, estimator: Estimator) -> Trial:
    """Undo a slip, estimate, and simulate; roughly at first, and no more if that is hopeless."""
    rough = attempt_roughly(undo, data, estimator)
    if rough is not NOTHING and rough.misfit > _HOPELESS:
        return rough
    return _attempted(undo, data, estimator)


def attempt_roughly(
    undo: Callable[[DataSet], DataSet], data: DataSet, estimator: Estimator
) -> Trial:
    """Undo a slip, estimate without terms, and simulate."""
    return _attempted(undo, data, estimator.roughly)


def _attempted(
    undo: Callable[[DataSet], DataSet],
    data: DataSet,
    estimate: Callable[[DataSet], Estimate],
) -> Trial:
    try:
        with np.errstate(all="ignore"):
            undone = undo(data)
            return judged(undone, estimate(undone))
    except (ButterflyError, np.linalg.LinAlgError, ArithmeticError):
        return NOTHING


def judged(data: DataSet, estimate: Estimate) -> Trial:
    """Simulate logs with an estimate, if a joint can be so.

    Logs are simulated whole, unless the estimate says otherwise: wrong units make any motion look
    as if small causes grew.
    """
    if not np.isfinite(estimate.values).all():
        return NOTHING
    if not is_possible(estimate, data.masses):
        return NOTHING
    whole = replace(estimate, horizon=estimate.horizon or math.inf)
    fits = data.simulations.fits(whole)
    misfits = np.nan_to_num(1 - fits / 100, nan=_NONE, posinf=_NONE)
    return Trial(misfits=np.minimum(misfits, _NONE))


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """A slip, and the misfit that is left without it.

    Parameters
    ----------
    finding
        That names it.
    misfit
        Median over the logs.
    last
        Whether it is far-fetched, and named after others that explain as much.
    """

    finding: Finding
    misfit: float
    last: bool = False

    @classmethod
    def of(cls, slip: Slip, factor: float, trial: Trial) -> Explanation:
        """Return what a trial of a whole data set without a slip says."""
        finding = Finding(
            kind=FindingKind.SLIP, parameters=(slip,), number=factor, severity=Level.WARNING
        )
        return cls(finding=finding, misfit=trial.misfit)

    def of_a_mass(self, other: Explanation) -> bool:
        """Whether this and another are of masses, between which the motion cannot choose."""
        return all(each.finding.parameters[0] == Slip.MASS for each in (self, other))


def thinned(data: DataSet) -> DataSet:
    """Return some of the logs, those of every added mass, as many as a trial may take."""
    sizes = [log.time.size for log in data.logs]
    count = max(4 * len(data.masses), int(_MOST_STEPS / np.mean(sizes)))
    if count >= len(sizes):
        return data
    kept: list[int] = []
    for mass in data.masses:
        own = [k for k, log in enumerate(data.logs) if log.added_mass == mass]
        share = max(4, round(count * len(own) / len(sizes)))
        picked = np.linspace(0, len(own) - 1, min(share, len(own))).round().astype(int)
        kept += [own[k] for k in picked]
    return data.take(sorted(kept))
