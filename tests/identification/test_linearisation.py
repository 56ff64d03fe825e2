"""Equations about a point: their cells, steps and parts."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError
from butterfly.identification.linearisation import Linearisation
from tests.identification.simulated import equations_about


def test_factors_of_the_whole_are_those_of_its_cells_which_are_made_once(monkeypatch):
    random = np.random.default_rng(0)
    slopes = random.standard_normal((60, 3))
    both = equations_about(np.zeros(3), random.standard_normal(60), slopes)
    made = []
    factors = Linearisation._factors  # noqa: SLF001 - what costs
    monkeypatch.setattr(Linearisation, "_factors", lambda *of: made.append(of) or factors(*of))
    for count in (1, 10, 1):
        cells = both.cells(count)
        assert cells.ends.size == count
        np.testing.assert_allclose(cells.curvature, both.curvature)
        np.testing.assert_allclose(cells.gradient, both.gradient)
    assert len(made) == 1


def _of_logs(seed=0, logs=4, rows=30):
    random = np.random.default_rng(seed)
    parts = [(random.standard_normal(rows), random.standard_normal((rows, 3))) for _ in range(logs)]
    return Linearisation.of_logs(parts, ("p1", "p3", "p4"), np.ones(3)), parts


def test_equations_of_logs_are_their_rows_one_after_the_other():
    at, parts = _of_logs()
    np.testing.assert_array_equal(at.residuals, np.concatenate([errors for errors, _ in parts]))
    np.testing.assert_array_equal(at.by_log, [errors for errors, _ in parts])
    assert at.cost == pytest.approx(sum(errors @ errors for errors, _ in parts) / 2)


def test_without_some_logs_the_rest_is_as_if_these_had_never_been():
    at, parts = _of_logs()
    rest = Linearisation.of_logs([parts[0], parts[2]], at.names, at.values)
    np.testing.assert_allclose(at.without([1, 3]).curvature, rest.curvature)
    np.testing.assert_allclose(at.without([1, 3]).gradient, rest.gradient)
    assert at.without([1, 3]).log.tolist() == [0, 2]


def test_the_next_step_is_that_of_least_squares_and_decreases_as_much_as_it_says():
    at, _ = _of_logs()
    best, cost, *_ = np.linalg.lstsq(at.rows, -at.residuals, rcond=None)
    np.testing.assert_allclose(at.next_step, best)
    assert at.moved(best).cost == pytest.approx(float(cost[0]) / 2)
    assert at.decrease(best) == pytest.approx(at.cost - float(cost[0]) / 2)


def test_a_column_of_zeros_is_not_identifiable_and_is_named():
    at, _ = _of_logs()
    silent = replace(at, rows=at.rows * [1.0, 0.0, 1.0])
    assert silent.conditioning.singular
    assert silent.conditioning.weakest == ("p3",)
    with pytest.raises(IdentifiabilityError, match="p3 cannot be identified"):
        silent.conditioning.require()
