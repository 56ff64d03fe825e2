"""What knowledge beside the logs does to an estimate, and whether it agrees with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.inference.covariance import cluster_covariance
from butterfly.identification.inference.identifiability import SINGULAR_CONDITION
from butterfly.identification.normal_equations import SolvedEquations
from butterfly.identification.prior import Prior
from butterfly.model.known import Knowledge
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import GROWING
from butterfly.verdict import Level

Samples = NDArray[np.float64]

CLEARLY_APART = 3.0
"""Standard errors between what was known and what the logs, or another source, say."""

_RARE = 0.9985  # one-sided level of a contradiction, as that many standard errors have it
_MATTERS = 0.01  # share of what is known, less than which is no contradiction
_TELLS = 1e-4  # share of the prior's variance, below which the logs say nothing of the parameter


def disagreements(
    prior: Prior | None, names: Sequence[str], values: Samples, covariance: Samples, rows: Samples
) -> list[Finding]:
    """Tell which priors the logs contradict, by the (m, n) weighted equations, theirs among them.

    The estimate less the prior has the variance C + s - 2 v N, with C that of the estimate, s that
    of the prior and v N what the normal equations would have for it.
    """
    if prior is None:
        return []
    scale = np.linalg.norm(rows, axis=0)
    normal = np.diag(np.linalg.inv((rows / scale).T @ (rows / scale))) / scale**2
    findings = []
    for k in np.flatnonzero(prior.told).tolist():
        own = prior.variance / prior.weight[k]
        variance = float(covariance[k, k] + own - 2 * prior.variance * normal[k])
        if variance < _TELLS * own:
            continue
        apart = float(abs(values[k] - prior.mean[k]) / np.sqrt(variance))
        if apart > CLEARLY_APART:
            findings.append(
                Finding(
                    kind=FindingKind.PRIOR_APART,
                    parameters=(names[k],),
                    number=apart,
                    severity=Level.CARE,
                )
            )
    return findings


def scale_apart(
    solved: SolvedEquations,
    rows: Samples,
    residuals: Samples,
    known: Knowledge,
    carried: Mapping[int, AddedMass],
) -> list[Finding]:
    """Tell whether the added masses contradict parameters that are known exactly.

    Residuals do not change if all torques grow alike, those of the masses among them; so their
    derivative by the known ones' common factor is that of all others, with the sign turned. One
    parameter more, and its step to where the logs would have it, by the (k, m, n) rows and (k, m)
    residuals of k logs that carried these masses, in order.
    """
    told = tuple(name for name in known.scale if name in known.exact)
    masses = list(carried.values())
    names = list(solved.names)
    loads = {"p1": [m.inertia for m in masses], "p3": [m.gravity_moment for m in masses]}
    lost = any(any(load) and name not in names for name, load in loads.items())
    if not told or lost or len({mass.inertia_and_moment for mass in masses}) <= 1:
        return []
    grown = np.tile(np.where([n in GROWING for n in names], solved.values, 0.0), (len(masses), 1))
    for name in set(loads) & set(names):
        grown[:, names.index(name)] += loads[name]
    column = -np.einsum("kmn,kn->km", rows, grown)
    whole = np.concatenate([rows, column[:, :, None]], axis=2)
    flat = whole.reshape(-1, len(names) + 1)
    size = np.linalg.norm(flat, axis=0)
    if not (size > 0).all() or np.linalg.cond(flat / size) > SINGULAR_CONDITION:
        return []
    step = np.linalg.lstsq(flat / size, -residuals.ravel(), rcond=None)[0] / size
    covariance, freedom = cluster_covariance(whole, residuals + whole @ step)
    share, error = float(step[-1]), float(np.sqrt(covariance[-1, -1]))
    sure = max(CLEARLY_APART, float(stdtrit(freedom[-1], _RARE)))
    if abs(share) <= max(sure * error, _MATTERS):
        return []
    return [
        Finding(kind=FindingKind.KNOWN_APART, parameters=told, number=share, severity=Level.CARE)
    ]
