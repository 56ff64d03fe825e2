"""Errors are propagated to first order, along with all that goes together."""

import numpy as np

from butterfly.identification.quantities import Quantities
from butterfly.model.prior import Known


def test_derivatives_are_exact():
    found = Quantities(names=("a", "b"), values=np.array([1.2, 0.3]), covariance=np.eye(2))
    slopes = found.gradient(lambda of: of["a"] ** 3 * np.cos(of["b"]) / of["b"])
    a, b = found.values
    by_b = a**3 * (-np.sin(b) / b - np.cos(b) / b**2)
    np.testing.assert_allclose(slopes, [3 * a**2 * np.cos(b) / b, by_b], rtol=1e-14)


def test_a_division_by_zero_is_no_number_rather_than_an_end():
    told = Quantities.of({"a": Known(value=1.0), "b": Known(value=0.0, uncertainty=0.1)})
    assert told.find(lambda of: of["a"] / of["b"]).value == np.inf


def test_linear_relations_are_gaussian_conditioning_whether_they_were_used_or_not():
    """Against the joint Gaussian of all, conditioned on x0 = c0 + 2 c1 by its closed form."""
    rng = np.random.default_rng(0)
    root = rng.standard_normal((3, 3))
    lumped = Quantities(
        names=("x", "y", "z"), values=np.array([1.0, 2, 3]), covariance=root @ root.T
    )
    causes = Quantities.of(
        {"c": Known(value=0.3, uncertainty=0.4), "d": Known(value=0.5, uncertainty=0.2)}
    )
    formulas = {"x": lambda of: of["c"] + 2 * of["d"]}
    whole = np.block([[lumped.covariance, np.zeros((3, 2))], [np.zeros((2, 3)), causes.covariance]])
    values = np.concatenate([lumped.values, causes.values])
    gap = np.array([1.0, 0, 0, -1, -2])
    gain = whole @ gap / (gap @ whole @ gap)
    expected = values - gain * (gap @ values), whole - np.outer(gain, gap @ whole)

    fresh = lumped.told_of(causes, formulas, new=frozenset({"x"}))
    informed = Quantities(
        names=lumped.names, values=expected[0][:3], covariance=expected[1][:3, :3]
    )
    used = informed.told_of(causes, formulas, new=frozenset())
    for found in (fresh, used):
        assert found.names == ("x", "y", "z", "c", "d")
        np.testing.assert_allclose(found.values, expected[0])
        np.testing.assert_allclose(found.covariance, expected[1], atol=1e-14)


def test_what_is_exact_learns_nothing():
    lumped = Quantities(names=("x",), values=np.array([2.0]), covariance=np.array([[0.01]]))
    causes = Quantities.of({"c": Known(value=1.0)})
    found = lumped.told_of(causes, {"x": lambda of: 2 * of["c"]}, new=frozenset())
    assert found.find(lambda of: of["c"]) == Known(value=1.0)
