"""Whether given added masses and prior values agree with the logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import stdtrit

from butterfly.arrays import Samples, unit_columns
from butterfly.errors import InputError
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.inference.covariance import cluster_covariance
from butterfly.identification.inference.equations import CellEquations
from butterfly.identification.inference.identifiability import SINGULAR_CONDITION, growth
from butterfly.identification.levels import ACCUSED, CLEARLY, MATTERS
from butterfly.model.parameters import AddedMass, rounded
from butterfly.model.prior import LAG, NO_PRIOR, Prior
from butterfly.model.terms import TERMS

OF_SCALES: dict[str, dict[str, float]] = {
    "mass_scale": {},
    "gravity_scale": {},
    "input_scale": {"p4": 1.0},
    "angle_scale": {"p4": 1.0, "coulomb": 1.0, "stribeck": 1.0, "bias": 1.0},
    "time_scale": {row.name: float(row.seconds) for row in TERMS.values() if row.seconds},
}
"""Exponents with which parameters grow with a scale of `butterfly.model.prior.SCALES`."""


def moved_by_givens(
    cells: CellEquations, carried: Sequence[AddedMass], known: Prior
) -> Samples | None:
    """Return the effect of uncertain added masses, arms and scales on the residuals of k cells.

    A mass that is off by dm adds dm (l^2 r_1 + g l r_3) to the residuals of its logs, an arm that
    is off by dl adds dl m (2 l r_1 + g r_3), with r_1 and r_3 their derivatives by p1 and p3. Equal
    masses are taken to be the same piece of metal, equal arms the same hole. A scale moves all
    masses, or the parameters that grow with it; a lag of the logger moves the delay.

    Of (k, m, n) rows it is (k, m, q) for q uncertain quantities, each times its standard
    uncertainty; None if all are exact. InputError if a parameter is known exactly although what is
    added to it, or drives it, is not.
    """
    count, values = len(cells.rows), cells.named
    inertia, gravity = (
        np.array([getattr(each, name) for each in carried] or np.zeros(count))
        for name in ("inertia", "gravity_moment")
    )
    moves: dict[tuple[str, float], Samples] = {}
    for position, added in enumerate(carried):
        for key, by_inertia, by_gravity in _moves(added):
            move = moves.setdefault(key, np.zeros((2, count)))
            move[:, position] = by_inertia, by_gravity
    columns = [_moved(cells, {"p1": each[0], "p3": each[1]}) for each in moves.values()]
    for scale, share in known.scales.items():
        grows = OF_SCALES[scale]
        if "p4" in grows and "p4" in known.fixed:
            grows = grows | {"p4": np.nan}  # it is not among the names, and refused
        by = {name: np.full(count, power * values.get(name, 0.0)) for name, power in grows.items()}
        of_masses = 1.0 if scale == "mass_scale" else grows.get("p1", 0.0)
        by["p1"] = by.get("p1", 0.0) + of_masses * inertia
        by["p3"] = gravity * (scale in {"mass_scale", "gravity_scale"})
        columns.append(share * _moved(cells, by))
    late = known.values[LAG].uncertainty if LAG in known.values else 0.0
    if late and ("delay" in cells.names or "delay" in known.fixed):
        columns.append(late * _moved(cells, {"delay": np.ones(count)}))
    return np.stack(columns, axis=2) if columns else None


def _moved(cells: CellEquations, by: Mapping[str, Samples]) -> Samples:
    """Return (k, m) changes of the residuals if parameters change by (k,) amounts."""
    result = np.zeros(cells.rows.shape[:2])
    for name, change in by.items():
        if not change.any():
            continue
        if name not in cells.names:
            expected = f"exact masses and scales, or {name} with an uncertainty"
            raise InputError(
                "known", name, "exact although masses or scales are uncertain", expected
            )
        result += cells.rows[:, :, cells.names.index(name)] * change[:, None]
    return result


def _moves(added: AddedMass) -> list[tuple[tuple[str, float], float, float]]:
    """Return the effects of a mass's and its arm's standard uncertainty on inertia and gravity."""
    uncertain = (
        ("mass", added.mass, added.mass_uncertainty, 1),
        ("arm", added.arm, added.arm_uncertainty, 2),
    )
    return [
        ((what, rounded(v)), power * u / v * added.inertia, u / v * added.gravity_moment)
        for what, v, u, power in uncertain
        if u and v
    ]


def prior_contradictions(
    cells: CellEquations, covariance: Samples, known: Prior = NO_PRIOR
) -> list[Finding]:
    """Return the priors that the logs contradict, by the (n, n) covariance of the estimate.

    The estimate less the prior has the variance C + s - 2 v N, with C that of the estimate, s that
    of the prior, N the inverse of the normal equations and v the variance of a row. A finding on
    what is assumed, a guess among the ``known``, says what that is.
    """
    prior, (rows, _) = cells.prior, cells.with_prior
    if prior is None:
        return []
    scaled, scale = unit_columns(rows)
    normal = np.diag(np.linalg.inv(scaled.T @ scaled)) / scale**2
    findings = []
    for k in np.flatnonzero(prior.active).tolist():
        given = prior.variance / prior.weight[k]
        variance = float(covariance[k, k] + given - 2 * prior.variance * normal[k])
        if variance < MATTERS**2 * given:
            continue  # the logs have no information on the parameter
        distance = float(abs(cells.values[k] - prior.mean[k]) / np.sqrt(variance))
        if distance > CLEARLY:
            own = known.values.get(cells.names[k])
            assumed = [str(own)] if own is not None and own.heavy else []
            names = (cells.names[k], *assumed)
            findings.append(Finding(FindingKind.PRIOR_CONFLICT, names, number=distance))
    return findings


def scale_errors(cells: CellEquations, carried: Sequence[AddedMass], known: Prior) -> list[Finding]:
    """Return whether the added masses of k cells contradict parameters that are known exactly.

    Residuals do not change with a common factor of all torques, so their derivative by that of the
    known ones is minus that of all others. Its step is the factor that the logs of k cells support.
    """
    fixed = tuple(name for name in known.scale() if name in known.fixed)
    names, rows, residuals = cells.names, cells.rows, cells.residuals
    lost = any(load and n not in names for mass in carried for n, load in mass.loads.items())
    if not fixed or lost or len({mass.inertia_and_moment for mass in carried}) <= 1:
        return []
    grown = np.array([growth(names, cells.values, mass) for mass in carried])
    column = -np.einsum("kmn,kn->km", rows, grown)
    whole = np.concatenate([rows, column[:, :, None]], axis=2)
    flat, size = unit_columns(whole.reshape(-1, len(names) + 1))
    if np.linalg.cond(flat) > SINGULAR_CONDITION:
        return []
    step = np.linalg.lstsq(flat, -residuals.ravel(), rcond=None)[0] / size
    covariance, freedom = cluster_covariance(whole, residuals + whole @ step)
    share, error = float(step[-1]), float(np.sqrt(covariance[-1, -1]))
    quantile = float(stdtrit(freedom[-1], 1 - ACCUSED / 2))
    if abs(share) <= max(quantile * error, MATTERS):
        return []
    return [Finding(FindingKind.KNOWN_CONFLICT, fixed, number=share)]
