import numpy as np
import pytest

from butterfly.identify.covariance import cluster_covariance


def _regression(rng, clusters, size):
    rows = rng.standard_normal((clusters, size, 2))
    noise = rng.standard_normal((clusters, size))
    flat = rows.reshape(-1, 2)
    estimate = np.linalg.lstsq(flat, noise.ravel(), rcond=None)[0]
    return rows, (flat @ estimate - noise.ravel()).reshape(clusters, size)


def test_with_clusters_of_one_it_is_hc2():
    rows, residuals = _regression(np.random.default_rng(0), 30, 1)
    x, e = rows[:, 0], residuals[:, 0]
    normal = np.linalg.inv(x.T @ x)
    leverage = np.einsum("ni,ij,nj->n", x, normal, x)
    hc2 = normal @ (x.T * (e**2 / (1 - leverage))) @ x @ normal
    np.testing.assert_allclose(cluster_covariance(rows, residuals)[0], hc2, rtol=1e-10)


def test_for_one_mean_the_degrees_of_freedom_are_students():
    rng = np.random.default_rng(1)
    values = rng.standard_normal((12, 1))
    covariance, freedom = cluster_covariance(np.ones((12, 1, 1)), values - values.mean())
    assert freedom[0] == pytest.approx(11)
    assert covariance[0, 0] == pytest.approx(np.var(values, ddof=1) / 12)


def test_it_is_unbiased_for_few_clusters():
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((8, 3, 2))
    flat = rows.reshape(-1, 2)
    hat = flat @ np.linalg.inv(flat.T @ flat) @ flat.T
    found = []
    for _ in range(4000):
        noise = rng.standard_normal(24)
        found.append(cluster_covariance(rows, (noise - hat @ noise).reshape(8, 3))[0])
    np.testing.assert_allclose(
        np.mean(found, axis=0), np.linalg.inv(flat.T @ flat), rtol=0.05, atol=1e-3
    )


def test_units_of_the_columns_do_not_matter():
    rows, residuals = _regression(np.random.default_rng(3), 20, 2)
    scale = np.array([1e6, 1e-6])
    covariance, freedom = cluster_covariance(rows, residuals)
    rescaled, same = cluster_covariance(rows * scale, residuals)
    np.testing.assert_allclose(rescaled * np.outer(scale, scale), covariance, rtol=1e-9)
    np.testing.assert_allclose(same, freedom, rtol=1e-9)
