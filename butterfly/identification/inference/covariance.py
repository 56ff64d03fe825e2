"""Covariance of a regression whose errors are independent between clusters, and its intervals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.special import stdtrit

from butterfly.arrays import Samples
from butterfly.identification.levels import CONFIDENCE, ROUNDING, SPREADS
from butterfly.model.prior import Penalty


def robust(covariance: Samples, weighted: Samples, bread: Samples) -> Samples:
    """Return the covariance of an M-estimate from that of its weighted least squares.

    The weights depend on the residuals, so that the gradient changes by ``bread`` (n, n), less than
    the ``weighted`` normal equations have it (Huber & Ronchetti, Robust Statistics, 2nd ed. 2009,
    section 7.6). Where the bread is not positive definite, the covariance stays.
    """
    if np.linalg.eigvalsh(bread / np.sqrt(np.outer(np.diag(weighted), np.diag(weighted))))[0] <= 0:
        return covariance
    change = np.linalg.solve(bread, weighted)
    return np.asarray(change @ covariance @ change.T)


def cluster_covariance(
    rows: Samples,
    residuals: Samples,
    prior: Penalty | None = None,
    considered: Samples | None = None,
) -> tuple[Samples, Samples]:
    """Return the (p, p) bias-reduced cluster-robust covariance (CR2) and (p,) degrees of freedom.

    Unbiased when the weights are right, and consistent when they are not; few and unequal clusters
    are accounted for by Satterthwaite degrees of freedom, one number per parameter, for Student's t
    (Bell & McCaffrey, Survey Methodology 28, 2002). With X_g the (m, p) weighted rows of cluster g,
    N = (X^T X + W)^-1, W the weights of a prior, and A_g = (I - X_g N X_g^T)^(-1/2), the influence
    of a cluster's (m,) residuals is A_g X_g N. Two parts add with infinite degrees of freedom: the
    prior, and ``considered`` (n, m, k), derivatives of the residuals by k quantities that are not
    estimated, each times its standard uncertainty (Schmidt's considered parameters).
    """
    weight = np.zeros(rows.shape[2]) if prior is None else prior.weight
    scale = np.sqrt(np.sum(rows**2, axis=(0, 1)) + weight)
    rows, weight = np.asarray(rows / scale), weight / scale**2
    flat = rows.reshape(-1, rows.shape[2])
    normal = np.linalg.inv(flat.T @ flat + np.diag(weight))
    residual_maker = np.eye(rows.shape[1]) - rows @ normal @ np.swapaxes(rows, 1, 2)
    eigenvalues, axes = np.linalg.eigh(residual_maker)
    # a cluster that alone determines a parameter leaves no residual
    roots = np.maximum(eigenvalues, ROUNDING) ** -0.5
    influence = np.einsum("nij,nj,nkj->nik", axes, roots, axes) @ rows @ normal
    scores = np.einsum("nip,ni->np", influence, residuals)
    covariance = np.asarray(scores.T @ scores)
    freedom = _satterthwaite(rows, np.asarray(normal), influence)
    given = np.zeros_like(covariance)
    if prior is not None:
        given += prior.variance * (normal * weight) @ normal
    if considered is not None:
        moved = normal @ np.einsum("nip,nik->pk", rows, considered)
        given += moved @ moved.T
    if given.any():
        scatter = np.diag(covariance)
        both, moving = scatter + np.diag(given), scatter > 0
        share = np.divide(scatter, both, out=np.ones_like(scatter), where=moving)
        covariance, freedom = covariance + given, freedom / share**2
    return covariance / np.outer(scale, scale), freedom


def _satterthwaite(rows: Samples, normal: Samples, influence: Samples) -> Samples:
    """(p,) degrees of freedom tr(P)^2/tr(P^2), with one matrix P for each parameter.

    P = D - B N B^T over clusters: D the squared length of each cluster's influence on the
    parameter, and the rows of B that influence times X_g. It is never formed, so that memory grows
    with the number of clusters only.
    """
    lengths = np.sum(influence**2, axis=1)  # (n, p): the diagonals of D
    b = np.einsum("nij,nip->pnj", rows, influence)  # (p, n, p)
    shared = np.swapaxes(b, 1, 2) @ b @ normal  # (p, p, p): B^T B N
    overlap = np.einsum("pnj,jk,pnk->np", b, normal, b)
    trace = lengths.sum(axis=0) - np.trace(shared, axis1=1, axis2=2)
    squares = (lengths**2 - 2 * lengths * overlap).sum(axis=0)
    squares += np.einsum("pij,pji->p", shared, shared)
    # P has no negative eigenvalue, so that these bounds are violated by rounding only, which is all
    # that remains where one cluster alone determines a parameter.
    squares = np.clip(squares, trace**2 / rows.shape[0], trace**2)
    return np.asarray(np.divide(trace**2, squares, out=np.ones_like(trace), where=squares > 0))


def widened(
    values: Samples, covariance: Samples, left_out: Sequence[Samples], rivals: Sequence[Samples]
) -> Samples:
    """(n, n) covariance, enlarged along partial estimates, as if limits, and along rivals."""
    if left_out:
        distances = np.array(left_out) - values
        covariance = covariance + distances.T @ distances / SPREADS**2
    if rivals:
        distances = np.array(rivals) - values
        covariance = covariance + distances.T @ distances / len(rivals)
    return covariance


def half_widths(covariance: Samples, freedom: Samples) -> Samples:
    """(n,) half-widths of Student's intervals at `CONFIDENCE`."""
    quantiles = stdtrit(freedom, 0.5 + CONFIDENCE / 2)
    return np.asarray(quantiles * np.sqrt(np.diag(covariance)), dtype=float)


def honest_limits(
    values: Samples,
    covariance: Samples,
    freedom: Samples,
    left_out: Iterable[Samples],
    rivals: Iterable[Samples] = (),
) -> tuple[Samples, Samples]:
    """Return (n,) Student's limits at `CONFIDENCE`, widened to include estimates of partial data.

    These differ by errors of the model, which more logs do not reduce. Of rivals, fits that predict
    as well, any may be right: the limits include the same half-widths about each.
    """
    half = half_widths(covariance, freedom)
    likely, partial = np.array([values, *rivals]), np.array([values, *left_out])
    lower = np.minimum(likely.min(axis=0) - half, partial.min(axis=0))
    upper = np.maximum(likely.max(axis=0) + half, partial.max(axis=0))
    return lower, upper
