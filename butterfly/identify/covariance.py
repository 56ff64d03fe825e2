"""Covariance of a regression whose errors are independent between clusters, not within."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_LEAST_FREEDOM = 1e-6  # a cluster that alone determines a parameter leaves no residual to judge by


def compress(
    jacobian: NDArray[np.float64], residuals: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Reduce one cluster of m equations in p parameters to p, which say the same of them.

    Returns
    -------
    (p, p) triangular factor R of the (m, p) Jacobian Q R, and (p,) residuals Q^T r.
    """
    count = jacobian.shape[1]
    basis, triangle = np.linalg.qr(jacobian)
    rows, rest = np.zeros((count, count)), np.zeros(count)
    rows[: triangle.shape[0]] = triangle
    rest[: triangle.shape[0]] = basis.T @ residuals
    return rows, rest


def cluster_covariance(
    rows: NDArray[np.float64], residuals: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the bias-reduced cluster-robust covariance (CR2) and its degrees of freedom.

    Unbiased when the weights are right, and consistent when they are not; few and unequal clusters
    are accounted for by Satterthwaite degrees of freedom, one number per parameter (Bell &
    McCaffrey, Survey Methodology 28, 2002).

    Parameters
    ----------
    rows
        (n, m, p) weighted regressors of n clusters of m equations each.
    residuals
        (n, m) weighted residuals.

    Returns
    -------
    covariance, freedom
        (p, p), and (p,) degrees of freedom for Student's t.
    """
    clusters, size, count = rows.shape
    scale = np.linalg.norm(rows, axis=(0, 1))
    rows = rows / scale
    flat = rows.reshape(-1, count)
    normal = np.linalg.inv(flat.T @ flat)
    keeps = np.eye(clusters * size) - flat @ normal @ flat.T
    keeps = keeps.reshape(-1, clusters, size)
    own = np.array([keeps[k * size : (k + 1) * size, k] for k in range(clusters)])
    share, axes = np.linalg.eigh(own)
    share = np.maximum(share, _LEAST_FREEDOM)
    reduce = np.einsum("nij,nj,nkj->nik", axes, share**-0.5, axes)
    influence = np.einsum("nij,njk,kp->nip", reduce, rows, normal)
    scores = np.einsum("nip,ni->np", influence, residuals)
    spread = np.einsum("lni,nip->pln", keeps, influence)
    products = np.swapaxes(spread, 1, 2) @ spread
    freedom = np.trace(products, axis1=1, axis2=2) ** 2 / np.sum(products**2, axis=(1, 2))
    return scores.T @ scores / np.outer(scale, scale), freedom
