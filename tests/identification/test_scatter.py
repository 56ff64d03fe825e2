"""Scatter from log to log: what is planted is found, and its weights are those of the textbook."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from butterfly.identification.linearisation import Linearisation
from butterfly.identification.scatter import Likelihood, spread_of
from butterfly.identification.trust import FindingKind
from butterfly.model.prior import Known, Penalty

FOUR = ("p1", "p2", "p4", "coulomb")
VALUES = np.array([2.0, 0.5, 1.5, 0.8])


def logs_of(rng, count, noise, *, friction=0.0, gain=0.0, misfit=0.0, size=200):
    """Logs of a linear model about its true values, whose friction and gain scatter."""
    for _ in range(count):
        rows = rng.standard_normal((size, len(FOUR))) / size**0.5
        own = VALUES * rng.standard_normal(4) * [0.0, friction, gain, friction]
        basis = np.linalg.qr(rows)[0]
        more = basis @ rng.standard_normal(4) * misfit
        residuals = noise * rng.standard_normal(size) - rows @ own + more
        yield residuals, rows


def likelihood_of(logs, names=FOUR, values=VALUES, prior=None):
    """The likelihood of logs' (m,) residuals and (m, n) rows about some values."""
    residuals, rows = zip(*logs, strict=True)
    told = {"names": names, "values": values, "lower": np.full(len(names), -np.inf)}
    told |= {"ends": np.cumsum([each.size for each in residuals]), "log": np.arange(len(rows))}
    at = Linearisation(rows=np.concatenate(rows), residuals=np.concatenate(residuals), **told)
    return Likelihood(at, values, prior=prior)


@settings(max_examples=6)
@given(
    seed=st.integers(0, 2**32 - 1),
    friction=st.sampled_from([0.0, 0.1, 0.3]),
    gain=st.sampled_from([0.0, 0.03]),
)
def test_planted_scatter_is_found_and_none_where_none_is(seed, friction, gain):
    rng = np.random.default_rng(seed)
    likelihood = likelihood_of(logs_of(rng, 60, 1e-3, friction=friction, gain=gain))
    found = likelihood.best()
    findings = likelihood.findings(found)
    assert found.friction == pytest.approx(friction, rel=0.45, abs=0.01)
    assert found.gain == pytest.approx(gain, rel=0.55, abs=0.005)
    named = {finding.parameters for finding in findings}
    expected = [(("p2", "coulomb"), friction), (("p4",), gain)]
    assert named == {names for names, size in expected if size}
    assert all(each.kind is FindingKind.SCATTER for each in findings)


def test_a_misfit_of_every_log_is_told_from_noise():
    rng = np.random.default_rng(5)
    found = likelihood_of(logs_of(rng, 80, 1e-4, misfit=0.01)).best()
    assert found.misfit == pytest.approx(0.01, rel=0.2)


def test_whitened_errors_have_variance_one():
    rng = np.random.default_rng(1)
    likelihood = likelihood_of(logs_of(rng, 300, 1e-3, friction=0.2, gain=0.02))
    rows, residuals = likelihood.weighed(likelihood.best()).stack
    flat = residuals.ravel()
    assert flat @ flat / flat.size == pytest.approx(1.0, rel=0.1)
    np.testing.assert_allclose(residuals.T @ residuals / len(residuals), np.eye(4), atol=0.25)
    assert rows.shape == (300, 4, 4)


def test_one_parameter_of_equal_logs_is_the_textbook_s_analysis_of_variance():
    """Of logs with the same row, tau^2 + sigma^2 is the variance between their own estimates.

    The prior aside, whose pull the same sum has: the restricted likelihood in closed form.
    """
    rng = np.random.default_rng(2)
    count, size, noise, scatter = 12, 500, 1e-3, 0.15
    row = np.ones((size, 1)) / size**0.5
    own = scatter * rng.standard_normal(count)
    logs = [(noise * rng.standard_normal(size) - row[:, 0] * each, row) for each in own]
    likelihood = likelihood_of(logs, ("coulomb",), np.ones(1))
    found = likelihood.best()
    estimates = np.array([-row[:, 0] @ errors for errors, row in logs])
    between = np.sum((estimates - estimates.mean()) ** 2)
    floor = np.mean(likelihood._noise)  # noqa: SLF001 - what the textbook is given

    def minus_twice_log(tau):
        variance = tau**2 + floor + found.misfit**2
        return (count - 1) * np.log(variance) + between / variance + (tau / 0.1) ** 2

    closed = minimize_scalar(minus_twice_log, bounds=(0, 1), method="bounded").x
    assert found.friction == pytest.approx(closed, rel=1e-3)
    effects = found.random_effects(likelihood.weighed(found), np.zeros(1))
    assert effects[:, 0] == pytest.approx(estimates, rel=1e-2)


@pytest.mark.parametrize("unit", [1.0, 1e-6])
def test_knowledge_of_a_parameter_takes_its_error_for_no_scatter_whatever_its_unit(unit):
    """All logs are off by as much: with the value known well, that is what they scatter about."""
    values, off = VALUES / unit, np.array([0.0, 0.3, 0.0, 0.0])
    logs = logs_of(np.random.default_rng(3), 20, 1e-3)
    logs = [(left + rows @ off, unit * rows) for left, rows in logs]
    prior = Penalty.of(FOUR, {"p2": Known(value=values[1], uncertainty=1e-6 / unit)})
    assert likelihood_of(logs, FOUR, values).best().friction < 0.02
    assert likelihood_of(logs, FOUR, values, prior).best().friction > 0.1


def test_logs_that_do_not_see_a_parameter_have_fewer_coordinates():
    rng = np.random.default_rng(4)
    logs = list(logs_of(rng, 30, 1e-3, friction=0.2))
    blind = np.diag([1.0, 1.0, 0.0, 1.0])
    logs[::2] = [(residuals, rows @ blind) for residuals, rows in logs[::2]]
    likelihood = likelihood_of(logs)
    found = likelihood.best()
    assert found.friction == pytest.approx(0.2, rel=0.4)
    rows, residuals = likelihood.weighed(found).stack
    assert np.count_nonzero(rows.any(axis=2), axis=1).tolist() == [3, 4] * 15
    assert not residuals[::2, 3].any()


def test_coloured_errors_weigh_as_their_autocovariance_says():
    """Of a first-order process with memory a the sum has the variance 1/(1 - a)^2 a sample."""
    rng = np.random.default_rng(6)
    memory, size, variances = 0.8, 4000, []
    for _ in range(40):
        noise = rng.standard_normal(size)
        for k in range(1, size):
            noise[k] += memory * noise[k - 1]
        row = np.ones((size, 1)) / size**0.5
        likelihood = likelihood_of([(noise, row)], ("coulomb",), np.ones(1))
        variances.append(likelihood._noise[0, 0, 0])  # noqa: SLF001 - what is claimed
    expected = 1 / (1 - memory) ** 2
    assert np.mean(variances) == pytest.approx(expected, rel=0.2)


def test_a_share_of_the_scatter_is_never_of_inertia_or_gravity():
    spread = spread_of(("p1", "p3", "p4", "drag", "bias"), np.arange(1.0, 6.0))
    np.testing.assert_array_equal(spread, [[0, 0, 0, 4, 0], [0, 0, 3, 0, 0]])


def test_a_parameter_without_any_effect_takes_no_part():
    """As Coulomb friction of a joint that has none, on its bound."""
    rng = np.random.default_rng(8)
    blind = np.diag([1.0, 1.0, 1.0, 0.0])
    logs = [(residuals, rows @ blind) for residuals, rows in logs_of(rng, 30, 1e-3, friction=0.2)]
    assert 0.05 < likelihood_of(logs).best().friction < 0.5
