"""Covariances against closed forms, and what widens them."""

import tracemalloc

import numpy as np
import pytest
from scipy.stats import t as student

from butterfly.identification.diagnostics.findings import Ending
from butterfly.identification.inference.covariance import cluster_covariance, honest_limits, robust
from butterfly.identification.inference.infer import infer
from butterfly.model.parameters import AddedMass
from tests.identification.cells import cells


def _regression(rng, clusters, size):
    rows = rng.standard_normal((clusters, size, 2))
    noise = rng.standard_normal((clusters, size))
    flat = rows.reshape(-1, 2)
    estimate = np.linalg.lstsq(flat, noise.ravel(), rcond=None)[0]
    return rows, (flat @ estimate - noise.ravel()).reshape(clusters, size)


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


def test_it_is_the_dense_formula():
    """CR2 and Satterthwaite's degrees of freedom with all matrices written out."""
    rng = np.random.default_rng(4)
    rows, residuals = _regression(rng, 7, 3)
    flat = rows.reshape(-1, 2)
    normal = np.linalg.inv(flat.T @ flat)
    maker = np.eye(21) - flat @ normal @ flat.T
    directions = np.zeros((2, 7, 21))  # by parameter and cluster: what multiplies the errors
    covariance = np.zeros((2, 2))
    for k in range(7):
        own = slice(3 * k, 3 * k + 3)
        values, axes = np.linalg.eigh(maker[own, own])
        influence = normal @ flat[own].T @ axes @ np.diag(values**-0.5) @ axes.T
        directions[:, k] = influence @ maker[own]
        score = influence @ residuals[k]
        covariance += np.outer(score, score)
    products = directions @ np.swapaxes(directions, 1, 2)
    trace = np.trace(products, axis1=1, axis2=2)
    found, freedom = cluster_covariance(rows, residuals)
    np.testing.assert_allclose(found, covariance, rtol=1e-9)
    np.testing.assert_allclose(freedom, trace**2 / np.sum(products**2, axis=(1, 2)), rtol=1e-9)


def test_its_memory_grows_with_the_number_of_clusters_only():
    rng = np.random.default_rng(5)
    peaks = []
    for clusters in (100, 400):
        rows, residuals = rng.standard_normal((clusters, 11, 11)), rng.standard_normal(11)
        tracemalloc.start()
        cluster_covariance(rows, np.tile(residuals, (clusters, 1)))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 5 * peaks[0]
    assert peaks[1] < 20e6


@pytest.mark.parametrize("seed", range(20))
def test_of_what_one_cluster_alone_determines_the_freedom_is_a_number(seed):
    """As the encoder's zero of each log is; rounding is all that is left of its sums."""
    rng = np.random.default_rng(seed)
    clusters, size = 6, 4
    own = np.eye(clusters)[:, np.newaxis, :] * rng.standard_normal((clusters, size, 1))
    rows = np.concatenate([rng.standard_normal((clusters, size, 1)), own], axis=2)
    flat = rows.reshape(-1, clusters + 1)
    noise = rng.standard_normal(clusters * size)
    residuals = noise - flat @ np.linalg.lstsq(flat, noise, rcond=None)[0]
    _, freedom = cluster_covariance(rows, residuals.reshape(clusters, size))
    assert np.all((freedom >= 1) & (freedom <= clusters))


def test_what_is_uncertain_besides_widens_the_covariance_by_what_it_moves_the_estimate():
    """A mean of values that are all off by the same unknown amount is off by it too."""
    values = np.random.default_rng(6).standard_normal((12, 1))
    rows, residuals, off = np.ones((12, 1, 1)), values - values.mean(), 0.7
    alone, freedom = cluster_covariance(rows, residuals)
    wider, more = cluster_covariance(rows, residuals, considered=np.full((12, 1, 1), off))
    assert wider[0, 0] == pytest.approx(alone[0, 0] + off**2)
    # Satterthwaite: a share of a variance that is known for certain has no end of freedom
    assert more[0] == pytest.approx(freedom[0] * (wider[0, 0] / alone[0, 0]) ** 2)


def _solved(jacobian, residuals, bread=None):
    count = jacobian.shape[1]
    more = {"values": np.array([0.01, 0.1])[:count], "ending": Ending.CONVERGED, "bread": bread}
    return cells(("p1", "p3")[:count], jacobian[:, None], residuals[:, None], **more)


def test_an_uncertain_added_mass_widens_the_covariance_by_what_it_adds_to_p1_and_p3():
    """All logs carry it: p1 is off by l^2 dm and p3 by g l dm, whatever the logs say."""
    rng, uncertainty, arm = np.random.default_rng(7), 1e-4, 0.1
    jacobian, residuals = rng.standard_normal((40, 2)), 1e-6 * rng.standard_normal(40)
    exact = AddedMass(mass=0.05, arm=arm)
    unsure = AddedMass(mass=0.05, arm=arm, mass_uncertainty=uncertainty)
    alone, wider = (
        infer(
            _solved(jacobian, residuals), method="test", left_out={}, masses=[mass] * 40
        ).covariance
        for mass in (exact, unsure)
    )
    moved = uncertainty * np.array([arm**2, arm * exact.gravity])
    np.testing.assert_allclose(wider - alone, np.outer(moved, moved), rtol=1e-6)


@pytest.mark.parametrize(("share", "ending"), [(0.05, "converged"), (0.3, "stopped")])
def test_a_fit_that_stopped_within_a_fraction_of_its_intervals_has_settled(share, ending):
    rng = np.random.default_rng(9)
    equations = _solved(rng.standard_normal((40, 2)), rng.standard_normal(40))
    found = infer(equations, method="test", left_out={})
    assert found.ending is Ending.CONVERGED
    moved = share * (found.upper - found.lower) / 2
    stopped = equations.stopped(moved * [1.0, -1.0])
    assert infer(stopped, method="test", left_out={}).ending == ending


def test_the_next_step_goes_to_the_least_squares():
    rng = np.random.default_rng(10)
    rows, residuals = rng.standard_normal((40, 2)), rng.standard_normal(40)
    expected = np.linalg.lstsq(rows, -residuals, rcond=None)[0]
    np.testing.assert_allclose(_solved(rows, residuals).next_step, expected, rtol=1e-9)


def test_the_standard_error_of_a_robust_location_is_that_of_m_estimates():
    """Huber's: sum psi^2 over (sum psi')^2, which weights taken as given would make too small."""
    rng = np.random.default_rng(8)
    values = np.where(rng.random(2000) < 0.2, 10.0, 1.0) * rng.standard_normal(2000)
    centre, bend = 0.0, 1.0
    for _ in range(100):
        weight = np.minimum(1, bend / np.abs(values - centre))
        centre = weight @ values / weight.sum()
    psi = np.clip(centre - values, -bend, bend)
    inside = np.abs(values - centre) < bend
    expected = np.sqrt(np.sum(psi**2)) / np.count_nonzero(inside)
    root = np.sqrt(weight)
    found = {
        bread: infer(
            _solved(root[:, None], root * (centre - values), bread and np.array([[bread]])),
            method="test",
            left_out={},
        ).standard_errors[0]
        for bread in (None, float(np.count_nonzero(inside)))
    }
    assert found[float(np.count_nonzero(inside))] == pytest.approx(expected, rel=5e-3)
    assert found[None] < 0.95 * expected


def test_a_loss_that_is_not_convex_about_the_end_leaves_the_covariance_as_it_is():
    covariance = np.diag([2.0, 3.0])
    assert robust(covariance, np.eye(2), np.diag([1.0, -1.0])) is covariance


def test_limits_are_student_s_at_95_per_cent_and_hold_estimates_of_partial_data():
    values, freedom = np.array([1.0, -2.0]), np.array([3.0, 20.0])
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    lower, upper = honest_limits(values, covariance, freedom, [])
    low, high = student.interval(0.95, freedom, values, np.sqrt(np.diag(covariance)))
    np.testing.assert_allclose((lower, upper), (low, high))
    left_out = [np.array([5.0, -2.1]), np.array([0.9, -9.0])]
    wider = honest_limits(values, covariance, freedom, left_out)
    np.testing.assert_array_equal(wider, ([lower[0], -9.0], [5.0, upper[1]]))
