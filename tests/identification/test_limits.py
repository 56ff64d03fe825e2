"""The one bounded least squares, its covariances, and what a misfit may have made of values."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.stats import t as student

from butterfly.identification.estimate import Estimate
from butterfly.identification.fit import Fit
from butterfly.identification.infer import (
    Basis,
    bias_of,
    findings_of_bounds,
    infer,
)
from butterfly.identification.limits import (
    Evidence,
    Rival,
    cluster_covariance,
    half_widths,
    misfit_over_value,
    robust,
)
from butterfly.identification.linearisation import Regression, compressed
from butterfly.identification.trust import Ending, FindingKind
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Penalty
from tests.identification.simulated import cells


def _regression(rng, clusters, size):
    rows = rng.standard_normal((clusters, size, 2))
    noise = rng.standard_normal((clusters, size))
    flat = rows.reshape(-1, 2)
    estimate = np.linalg.lstsq(flat, noise.ravel(), rcond=None)[0]
    return rows, (flat @ estimate - noise.ravel()).reshape(clusters, size)


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


BASIS = Basis(method="test")


def _solved(jacobian, residuals, **more):
    """A fit whose logs have an equation each."""
    count = jacobian.shape[1]
    told = {"values": np.array([0.01, 0.1])[:count]}
    at = cells(("p1", "p3")[:count], jacobian[:, None], residuals[:, None], **told)
    return Fit(linearisation=at, **more)


def test_an_uncertain_added_mass_widens_the_covariance_by_what_it_adds_to_p1_and_p3():
    """All logs carry it: p1 is off by l^2 dm and p3 by g l dm, whatever the logs say."""
    rng, uncertainty, arm = np.random.default_rng(7), 1e-4, 0.1
    jacobian, residuals = rng.standard_normal((40, 2)), 1e-6 * rng.standard_normal(40)
    exact = AddedMass(mass=0.05, arm=arm)
    unsure = AddedMass(mass=0.05, arm=arm, mass_uncertainty=uncertainty)
    fit, basis = _solved(jacobian, residuals), replace(BASIS, left_out={})
    alone, wider = (
        infer(fit, replace(basis, masses=[mass] * 40)).covariance for mass in (exact, unsure)
    )
    moved = uncertainty * np.array([arm**2, arm * exact.gravity])
    np.testing.assert_allclose(wider - alone, np.outer(moved, moved), rtol=1e-6)


@pytest.mark.parametrize(("share", "ending"), [(0.05, "converged"), (0.3, "stopped")])
def test_a_fit_that_stopped_within_a_fraction_of_its_intervals_has_settled(share, ending):
    rng = np.random.default_rng(9)
    fit = _solved(rng.standard_normal((40, 2)), rng.standard_normal(40))
    found = infer(fit, BASIS)
    assert found.ending is Ending.CONVERGED
    moved = share * (found.upper - found.lower) / 2
    stopped = replace(fit, ending=Ending.STOPPED, unsettled=moved * [1.0, -1.0])
    assert infer(stopped, BASIS).ending == ending


def test_the_next_step_goes_to_the_least_squares():
    rng = np.random.default_rng(10)
    rows, residuals = rng.standard_normal((40, 2)), rng.standard_normal(40)
    expected = np.linalg.lstsq(rows, -residuals, rcond=None)[0]
    np.testing.assert_allclose(
        _solved(rows, residuals).linearisation.next_step, expected, rtol=1e-9
    )


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
    found = {}
    for bread in (None, float(np.count_nonzero(inside))):
        about = bread and np.array([[bread]])
        fit = _solved(root[:, None], root * (centre - values), bread=about)
        found[bread] = infer(fit, BASIS).standard_errors[0]
    assert found[float(np.count_nonzero(inside))] == pytest.approx(expected, rel=5e-3)
    assert found[None] < 0.95 * expected


def test_a_loss_that_is_not_convex_about_the_end_leaves_the_covariance_as_it_is():
    covariance = np.diag([2.0, 3.0])
    assert robust(covariance, np.eye(2), np.diag([1.0, -1.0])) is covariance


def test_half_widths_are_student_s_at_95_per_cent_and_hold_other_answers_to_either_side():
    values, freedom = np.array([1.0, -2.0]), np.array([3.0, 20.0])
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    half = half_widths(covariance, freedom)
    _, high = student.interval(0.95, freedom, values, np.sqrt(np.diag(covariance)))
    np.testing.assert_allclose(half, high - values)
    left_out = [np.array([5.0, -2.1]), np.array([0.9, -9.0])]
    plain = Evidence(values=values, half=half, least=np.array([0.0, -np.inf]))
    found = replace(plain, left_out=left_out).half_widths
    np.testing.assert_allclose(found, [4.0, 7.0])
    rivals = [Rival(np.array([0.0, -2.0]), np.array([0.5, 0.1]))]
    found = replace(plain, rivals=rivals).half_widths
    np.testing.assert_allclose(found, [1.5, half[1]])
    found = replace(plain, rivals=[Rival(np.array([0.0, -2.0]))]).half_widths
    np.testing.assert_allclose(found, [1.0 + half[0], half[1]])
    found = replace(plain, bias=np.array([3.0, 0.0]), simulator=np.array([0.0, 2.0])).half_widths
    np.testing.assert_allclose(found, [3.0, np.hypot(half[1], 1.96 * 2.0)], rtol=1e-4)
    lower, upper = replace(plain, left_out=left_out).limits
    np.testing.assert_allclose([lower, upper], [[0.0, -9.0], [5.0, 5.0]])


def test_the_order_in_which_evidence_is_found_does_not_matter():
    rng = np.random.default_rng(11)
    found = infer(_solved(rng.standard_normal((40, 2)), rng.standard_normal(40)), BASIS)
    rivals = [
        Rival(found.values + each, half, predicts=False)
        for each, half in zip(rng.standard_normal((3, 2)), (None, np.ones(2), None), strict=True)
    ]
    error = np.array([0.3, 0.1])
    at_once = found.with_evidence(*rivals, simulator=error)
    one_by_one = found.with_evidence(simulator=error)
    for each in reversed(rivals):
        one_by_one = one_by_one.with_evidence(each)
    for each in (one_by_one, Estimate.from_dict(at_once.to_dict()).with_evidence()):
        np.testing.assert_allclose(each.lower, at_once.lower, rtol=1e-12)
        np.testing.assert_allclose(each.upper, at_once.upper, rtol=1e-12)
        np.testing.assert_allclose(each.covariance, at_once.covariance, rtol=1e-12)
    assert (at_once.upper > found.upper).all()
    np.testing.assert_array_equal(found.with_evidence().upper, found.upper)


def test_a_bound_that_somebody_gave_cuts_limits_whatever_they_include():
    rng = np.random.default_rng(12)
    found = infer(_solved(rng.standard_normal((40, 2)), 1e-4 * rng.standard_normal(40)), BASIS)
    told = replace(found, least=np.array([-np.inf, 0.05]))
    for each in (told, Estimate.from_dict(told.to_dict())):
        wide = each.with_evidence(Rival(found.values - 1.0))
        assert wide.limits_of("p3", 0.0)[0] == 0.05
        assert wide.limits_of("p1", 0.0)[0] < -0.9


NAMES, TRUTH = ("p1", "p2"), np.array([2.0, -1.0])
RUNS, SAMPLES = 8, 200


def _drifting(rng, drift):
    """Rows, and what a fit to them leaves: noise, and a drift of each log."""
    time = np.tile(np.arange(SAMPLES), RUNS)
    rows = np.column_stack([np.sin(0.9 * time) + time / SAMPLES, rng.standard_normal(time.size)])
    errors = 0.1 * rng.standard_normal(time.size) + drift * time / SAMPLES
    target = rows @ TRUTH + errors
    values = np.linalg.lstsq(rows, target, rcond=None)[0]
    return rows, rows @ values - target, values


def _of_runs(rows, residuals, values):
    parts = zip(np.split(rows, RUNS), np.split(residuals, RUNS), strict=True)
    return cells(NAMES, *compressed(parts), values=values)


def test_a_misfit_is_weighed_beside_what_each_parameter_does_alone():
    rows, residuals, values = _drifting(np.random.default_rng(0), 0.5)
    equations = _of_runs(rows, residuals, values)
    found = misfit_over_value(equations.rows, equations.residuals, values)
    for k in range(2):
        other = rows[:, 1 - k]
        alone = rows[:, k] - other * (other @ rows[:, k]) / (other @ other)
        expected = np.linalg.norm(residuals) / (abs(values[k]) * np.linalg.norm(alone))
        assert found[k] == pytest.approx(expected)


@pytest.mark.parametrize(("pull", "kind"), [(2.0, "on-bound"), (5.0, "pulled")])
def test_a_bound_is_active_or_the_data_pull_beyond_it(pull, kind):
    rows, residuals, values = _drifting(np.random.default_rng(0), 0.5)
    equations = _of_runs(rows, residuals + rows @ [0.0, 0.1 * pull], values)
    held = replace(equations, held=np.array([False, True]))
    (found,) = findings_of_bounds(held, np.diag([1.0, 0.01]))
    assert (found.kind, found.parameters) == (kind, ("p2",))


def test_the_scale_and_values_that_look_precise_are_widened_by_a_misfit():
    """Beside 0.7 of its effect a value of 2 may be off by 1.4; p2's misfit is no half of it."""
    values, narrow = np.full(4, 2.0), np.array([0.5, 0.01, 0.01, 0.5])
    sizes = np.array([1.0, 0.7 / 0.4, 1.0, 1.0])  # of columns, by which 1.4 is 0.7, 0.4, ...
    rows = np.concatenate([np.diag(sizes), np.zeros((1, 4))])[:, None]
    residuals = np.zeros((5, 1))
    residuals[4] = 1.4
    names = ("p1", "p2", "p3", "coulomb")
    equations = cells(names, rows, residuals, values=values)
    bias = bias_of(equations, Evidence(values=values, half=narrow, least=np.zeros(4)))
    np.testing.assert_allclose(bias, [1.4, 0.0, 1.4, 0.0])


TERMS = ("p3", "p4", "compression")
VALUES = np.array([-0.04, 0.5, 0.3])


def _bounded(names=TERMS, truth=VALUES, about=None, noise=0.0, **more):
    """Exact rows for some values, those of the product kind about others."""
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((40, len(names))) * np.geomspace(1e-3, 1e3, len(names))
    unknowns = truth.copy()
    if "compression" in names:
        unknowns[2] = truth[1] * (truth[2] - (about or {}).get("compression", 0.0))
    target = rows @ unknowns + noise * rng.standard_normal(40)
    cluster = np.arange(40) // 4
    return Regression(
        names=names, rows=rows, target=target, cluster=cluster, about=about or {}, **more
    )


@pytest.mark.parametrize("about", [0.0, 0.1, 0.3, 0.5])
def test_a_parameter_that_enters_times_the_gain_is_found_about_any_value(about):
    regression = _bounded(about={"compression": about})
    solution = regression.solve()
    np.testing.assert_allclose(solution.values, VALUES, rtol=1e-9)
    assert not solution.on_bound.any()
    spoilt = regression.target.copy()
    spoilt[:4] += 100.0
    part = replace(regression, target=spoilt).solve(np.arange(40) >= 4)
    np.testing.assert_allclose(part.values, VALUES, rtol=1e-9)


def test_its_jacobian_is_the_derivative_of_its_residuals_where_it_has_converged():
    regression = _bounded(about={"compression": VALUES[2]})
    numerical = [
        (regression.residuals(VALUES + h) - regression.residuals(VALUES - h)) / (2 * h.sum())
        for h in 1e-6 * np.eye(3)
    ]
    np.testing.assert_allclose(regression.jacobian(VALUES), np.transpose(numerical), rtol=1e-6)
    np.testing.assert_allclose(regression.residuals(VALUES), 0.0, atol=1e-9)


def test_bounds_are_kept_as_nonnegative_least_squares_keeps_them():
    names = ("p2", "coulomb", "drag")
    regression = _bounded(names, np.array([1.0, -0.2, 0.3]), noise=0.1)
    solution = regression.solve()
    expected = nnls(regression.rows, regression.target)[0]
    np.testing.assert_allclose(solution.values, expected, rtol=1e-6, atol=1e-9)
    assert solution.on_bound.tolist() == (solution.values == 0).tolist()
    assert solution.on_bound[1]


def test_a_value_below_its_bound_is_on_it_whatever_it_was_about_and_whoever_set_it():
    solution = _bounded(truth=np.array([-0.04, 0.5, -0.2]), about={"compression": 0.1}).solve()
    assert solution.values[2] == 0.0
    assert solution.on_bound.tolist() == [False, False, True]
    solution = _bounded(("p3", "p4"), np.array([-0.04, -0.5]), least={"p4": 0.0}).solve()
    assert solution.values[1] == 0.0
    assert solution.values[0] < 0


def test_an_estimate_is_cut_off_at_its_bounds_and_leaves_out_what_is_not_shared():
    rng = np.random.default_rng(1)
    jacobian = rng.standard_normal((60, 3))
    residuals = rng.standard_normal(60)
    rows, left = compressed((jacobian[k::12], residuals[k::12]) for k in range(12))
    bounds = {"held": np.array([False, True, True]), "lower": np.array([-np.inf, 0.0, -np.inf])}
    values = np.array([3.0, 0.05, 1.0])
    solved = cells(("p1", "coulomb", "zero"), rows, left, values=values, **bounds)
    left_out = {"heavy": np.array([9.0, 0.1])}
    found = infer(Fit(linearisation=solved), replace(BASIS, left_out=left_out, shared=2))
    assert found.names == ("p1", "coulomb")
    assert found.covariance.shape == (2, 2)
    assert found.lower[1] == 0.0
    assert found.upper[0] == 9.0
    assert found.on_bound == ("coulomb",)
    (bound,) = [each for each in found.findings if each.kind is FindingKind.ON_BOUND]
    assert bound.parameters == ("coulomb",)
    scores = [
        np.linalg.inv(jacobian.T @ jacobian) @ jacobian[k::12].T @ residuals[k::12]
        for k in range(12)
    ]
    plain = np.sum([np.outer(s, s) for s in scores], axis=0)[:2, :2]
    ratio = np.diag(found.covariance) / np.diag(plain)
    assert np.all((ratio > 1) & (ratio < 2))  # CR2 is somewhat wider than CR0


def test_what_is_known_of_a_value_is_known_of_its_multiple_by_as_many_standard_deviations():
    """3 (x - 1) of an x of 2 with a standard deviation of 0.5 is 3 with one of 1.5."""
    prior = Penalty(mean=np.array([2.0]), weight=np.array([1 / 0.5**2]))
    turned = prior.turned(np.array([3.0]), np.array([1.0]))
    assert turned.mean[0] == pytest.approx(3.0)
    assert turned.weight[0] == pytest.approx(1 / 1.5**2)
