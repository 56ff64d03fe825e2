"""The one bounded least squares, against other solvers and numerical derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls

from butterfly.identification.blocks import cut
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.equations import Regression, compressed
from butterfly.identification.inference.infer import infer
from butterfly.model.prior import Penalty
from tests.identification.cells import cells

NAMES = ("p3", "p4", "compression")
TRUTH = np.array([-0.04, 0.5, 0.3])


def _regression(names=NAMES, truth=TRUTH, about=None, noise=0.0, **more):
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
    regression = _regression(about={"compression": about})
    solution = regression.solve()
    np.testing.assert_allclose(solution.values, TRUTH, rtol=1e-9)
    assert not solution.on_bound.any()
    spoilt = regression.target.copy()
    spoilt[:4] += 100.0
    part = replace(regression, target=spoilt).solve(np.arange(40) >= 4)
    np.testing.assert_allclose(part.values, TRUTH, rtol=1e-9)


def test_its_jacobian_is_the_derivative_of_its_residuals_where_it_has_converged():
    regression = _regression(about={"compression": TRUTH[2]})
    numerical = [
        (regression.residuals(TRUTH + h) - regression.residuals(TRUTH - h)) / (2 * h.sum())
        for h in 1e-6 * np.eye(3)
    ]
    np.testing.assert_allclose(regression.jacobian(TRUTH), np.transpose(numerical), rtol=1e-6)
    np.testing.assert_allclose(regression.residuals(TRUTH), 0.0, atol=1e-9)


def test_bounds_are_kept_as_nonnegative_least_squares_keeps_them():
    names = ("p2", "coulomb", "drag")
    regression = _regression(names, np.array([1.0, -0.2, 0.3]), noise=0.1)
    solution = regression.solve()
    expected = nnls(regression.rows, regression.target)[0]
    np.testing.assert_allclose(solution.values, expected, rtol=1e-6, atol=1e-9)
    assert solution.on_bound.tolist() == (solution.values == 0).tolist()
    assert solution.on_bound[1]


def test_a_value_below_its_bound_is_on_it_whatever_it_was_about_and_whoever_set_it():
    solution = _regression(truth=np.array([-0.04, 0.5, -0.2]), about={"compression": 0.1}).solve()
    assert solution.values[2] == 0.0
    assert solution.on_bound.tolist() == [False, False, True]
    solution = _regression(("p3", "p4"), np.array([-0.04, -0.5]), least={"p4": 0.0}).solve()
    assert solution.values[1] == 0.0
    assert solution.values[0] < 0


def test_an_estimate_is_cut_off_at_its_bounds_and_leaves_out_what_is_not_shared():
    rng = np.random.default_rng(1)
    jacobian = rng.standard_normal((60, 3))
    residuals = rng.standard_normal(60)
    rows, left = compressed(cut(jacobian, residuals, np.arange(60) % 12, 1))
    bounds = {"on_bound": np.array([False, True, True]), "lower": np.array([-np.inf, 0.0, -np.inf])}
    values = np.array([3.0, 0.05, 1.0])
    solved = cells(("p1", "coulomb", "zero"), rows, left, values=values, **bounds)
    left_out = {"heavy": np.array([9.0, 0.1])}
    found = infer(solved, method="any", left_out=left_out, shared=2)
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
