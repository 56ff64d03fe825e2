"""What differs between conditions and from log to log: contrasts, and scatter that is planted."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.agreement import (
    Condition,
    Conditions,
    differing_values,
    disagreements_of,
    weighed_within,
)
from butterfly.identification.estimate import Estimate
from butterfly.identification.fit import Fit
from butterfly.identification.infer import Basis, agreement_of, infer, without_each_mass
from butterfly.identification.linearisation import Linearisation, compressed
from butterfly.identification.scatter import Likelihood
from butterfly.identification.trust import Finding, FindingKind
from butterfly.model.parameters import AddedMass
from butterfly.report.parameter_table import causes, contrast_text
from tests.identification.simulated import cells

LOGS, CELLS, ROWS = 12, 10, 40
LOG = np.repeat(np.arange(LOGS), CELLS)
NAMES = ("p1", "p3", "p4")
TRUTH = np.array([0.003, 0.05, 0.02])
UNITS = TRUTH
MASSES = tuple(AddedMass(mass=0.05 * (k % 4), arm=0.1) for k in range(LOGS))
COMMAND = np.repeat(1 + np.arange(LOGS) % 3, CELLS).astype(float)
TIME = np.tile(np.arange(CELLS), LOGS).astype(float)


def _conditions(**values):
    known = {Condition.COMMAND: COMMAND, Condition.TIME: TIME}
    known[Condition.MASS] = np.repeat([mass.inertia for mass in MASSES], CELLS)
    return replace(Conditions(values=known, masses=MASSES), **values)


def _problem(seed, change=None, noise=0.05):
    """Rows, and equations about the fit of a linear model whose values differ from cell to cell.

    ``change``: (k, n) added to the true values.
    """
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((LOGS * CELLS, ROWS, 3)) / UNITS
    values = TRUTH + (np.zeros((LOGS * CELLS, 3)) if change is None else change)
    target = np.einsum("kmn,kn->km", rows, values)
    target += noise * rng.standard_normal(target.shape)
    flat = rows.reshape(-1, 3)
    found = np.linalg.lstsq(flat * UNITS, target.ravel(), rcond=None)[0] * UNITS
    factors, left = compressed(zip(rows, rows @ found - target, strict=True))
    return rows, target, cells(NAMES, factors, left, values=found, log=LOG)


def _fit(equations, **values):
    """A fit and what inference knows beside it."""
    basis = Basis(**{"method": "any", "masses": MASSES} | values)
    return Fit(linearisation=equations), basis


def _following(x, slope, name="p4"):
    change = np.zeros((LOGS * CELLS, 3))
    change[:, NAMES.index(name)] = slope * x
    return change


@pytest.mark.parametrize("condition", [Condition.COMMAND, Condition.TIME])
def test_a_parameter_that_follows_a_condition_is_named_with_what_a_fit_with_it_finds(condition):
    x = {Condition.COMMAND: COMMAND, Condition.TIME: TIME}[condition]
    rows, target, equations = _problem(1, _following(x, 0.002))
    (best, *_), rivals = disagreements_of(equations, _conditions())
    assert (best.parameter, best.condition) == ("p4", condition)
    more = (rows[..., 2] * x[:, None])[..., None]
    wider = np.concatenate([rows, more], axis=2).reshape(-1, 4)
    scale = np.append(UNITS, UNITS[2])
    anew = np.linalg.lstsq(wider * scale, target.ravel(), rcond=None)[0] * scale
    np.testing.assert_allclose(rivals[0].values, anew[:3], rtol=1e-6)  # at the limit, where x is 0
    assert best.first == pytest.approx(anew[2] + anew[3] * x.min(), rel=1e-6)
    assert best.last == pytest.approx(anew[2] + anew[3] * x.max(), rel=1e-6)
    left, least = (
        np.sum((wider[:, :n] @ values - target.ravel()) ** 2)
        for n, values in ((3, equations.values), (4, anew))
    )
    assert best.share == pytest.approx(1 - least / left, rel=1e-6)


def test_intervals_hold_what_would_be_at_the_limit():
    _, _, equations = _problem(2, _following(COMMAND, 0.002))
    found = infer(*_fit(equations, conditions=_conditions()))
    plain = infer(*_fit(equations))
    place = NAMES.index("p4")
    assert not plain.lower[place] <= TRUTH[place] <= plain.upper[place]
    assert found.lower[place] <= TRUTH[place] <= found.upper[place]
    assert Estimate.from_dict(found.to_dict()).agreement == found.agreement


def test_friction_that_follows_a_condition_is_a_rival_of_friction_alone():
    """It explains 2 % of the squared error, and moves friction by more than 1 %."""
    _, _, equations = _problem(4, _following(COMMAND, 0.009 * UNITS[2]))
    of_friction = replace(equations, names=("p1", "p3", "coulomb"))
    assert disagreements_of(of_friction, _conditions()) == ((), [])
    contrasts, (rival,) = disagreements_of(of_friction, _conditions(), large=True)
    assert not contrasts
    np.testing.assert_array_equal(rival.values[:2], equations.values[:2])
    fit, basis = _fit(of_friction, conditions=_conditions())
    plain, wide = (
        infer(fit, replace(basis, large=large)).limits_of("coulomb", 0.0) for large in (False, True)
    )
    assert not plain[0] <= TRUTH[2] <= plain[1]
    assert wide[0] <= TRUTH[2] <= wide[1]
    of_gain = (disagreements_of(equations, _conditions(), large=large) for large in (False, True))
    assert len({len(rivals) for _, rivals in of_gain}) == 1  # of an input, p4


def test_a_slow_error_is_large_beside_white_noise_as_rough_and_noise_is_not():
    time, rng = np.arange(2000.0), np.random.default_rng(1)
    noise, slow = rng.standard_normal(time.size), np.sin(time / 100)
    for is_misfit, errors in (
        (False, (noise, 1e-9 * noise)),
        (False, (noise + slow,)),
        (True, (noise + 4 * slow,)),
        (True, (noise, 4 * slow)),
    ):
        at = cells(("p1",), np.zeros((len(errors), time.size, 1)), np.array(errors))
        assert at.is_misfit is is_misfit


def test_what_differs_from_log_to_log_is_a_contrast_where_no_scatter_says_it():
    by_log = np.random.default_rng(5).standard_normal(LOGS)[LOG]
    _, _, equations = _problem(6, _following(by_log, 0.002))
    fit, basis = _fit(equations, conditions=_conditions())
    scatter = Finding(FindingKind.SCATTER, ("p4",), number=0.1)
    found, weighed = infer(fit, basis), infer(replace(fit, findings=(scatter,)), basis)
    assert (found.agreement[0].parameter, found.agreement[0].condition) == ("p4", Condition.LOG)
    assert Condition.LOG not in {each.condition for each in weighed.agreement}
    differing = differing_values(equations, "p4")
    assert (found.lower <= differing).all()
    assert (differing <= found.upper).all()
    of_chance = (infer(*_fit(_problem(k)[2], conditions=_conditions())) for k in range(40))
    assert not any(c.condition is Condition.LOG for each in of_chance for c in each.agreement)


def test_rivals_of_unweighted_equations_move_with_the_values_of_the_fit():
    _, _, plain = _problem(2, _following(COMMAND, 0.002))
    weighed = replace(plain, values=plain.values + 0.5 * UNITS)
    fit, basis = _fit(weighed, conditions=_conditions())
    fit = replace(fit, unweighed=plain)
    contrasts, (rival, *_) = agreement_of(fit, basis)
    expected, (other, *_) = disagreements_of(plain, _conditions())
    assert contrasts == expected
    np.testing.assert_allclose(rival.values, other.values + 0.5 * UNITS)


def test_values_without_a_mass_are_those_of_a_fit_to_the_other_logs():
    rows, target, equations = _problem(1)
    found, findings = without_each_mass(equations, _fit(equations)[1])
    assert (set(found), findings) == (set(MASSES), [])
    kept = [MASSES[k] != MASSES[1] for k in LOG]
    anew = np.linalg.lstsq(rows[kept].reshape(-1, 3) * UNITS, target[kept].ravel(), rcond=None)[0]
    np.testing.assert_allclose(found[MASSES[1]], anew * UNITS, rtol=1e-6)
    found, (few,) = without_each_mass(equations, _fit(equations, masses=MASSES[:1] * LOGS)[1])
    assert (found, few.kind, few.number) == ({}, FindingKind.FEW_MASSES, 1)


def test_values_beside_one_that_differs_from_log_to_log_are_those_of_a_fit_with_one_in_each():
    by_log = np.random.default_rng(5).standard_normal(LOGS)[LOG]
    rows, target, equations = _problem(6, _following(by_log, 0.002))
    owned = rows[..., [2]] * (LOG[:, None] == np.arange(LOGS))[:, None, :]
    flat = np.concatenate([rows[..., :2], owned], axis=2).reshape(-1, LOGS + 2)
    scale = np.append(UNITS[:2], np.full(LOGS, UNITS[2]))
    anew = np.linalg.lstsq(flat * scale, target.ravel(), rcond=None)[0] * scale
    expected = [*anew[:2], anew[2:].mean()]
    np.testing.assert_allclose(differing_values(equations, "p4"), expected, rtol=1e-6)


def test_a_rival_is_as_uncertain_as_what_it_leaves_of_the_residuals_makes_it():
    """Errors are independent, so that least squares with the slope as a value tells how far."""
    rows, target, equations = _problem(2, _following(COMMAND, 0.002))
    _, (rival, *_) = disagreements_of(equations, _conditions())
    wider = np.concatenate([rows, (rows[..., 2] * COMMAND[:, None])[..., None]], axis=2)
    flat = wider.reshape(-1, 4) * np.append(UNITS, UNITS[2])
    left = target.ravel() - flat @ np.linalg.lstsq(flat, target.ravel(), rcond=None)[0]
    errors = np.sqrt(np.diag(np.linalg.inv(flat.T @ flat)) * np.mean(left**2))[:3] * UNITS
    np.testing.assert_allclose(rival.half_widths / errors, 2.4, rtol=0.5)  # Student's, of 12 logs
    found = infer(*_fit(equations, conditions=_conditions()))
    plain = infer(*_fit(equations))
    place = NAMES.index("p4")
    value, most = plain.values[place], (plain.upper - plain.lower)[place] / 2
    assert rival.half_widths[place] < most / 2
    far = max(most, abs(rival.values[place] - value) + rival.half_widths[place])
    assert far > 1.1 * most
    assert found.lower[place] == pytest.approx(value - far, rel=1e-9)
    assert found.upper[place] == pytest.approx(value + far, rel=1e-9)


def test_conditions_that_agree_are_hardly_ever_accused():
    """The level is 5 %; 80 data sets of 24 contrasts each."""
    accused = sum(bool(disagreements_of(_problem(k)[2], _conditions())[0]) for k in range(80))
    assert accused <= 5


def test_a_mass_that_is_weighed_wrong_is_told_and_within_what_masses_agree():
    wrong = 0.004
    x = np.repeat([float(mass.mass == 0.1) for mass in MASSES], CELLS)
    change = np.zeros((LOGS * CELLS, 3))
    change[:, 0], change[:, 1] = wrong * 0.1**2 * x, wrong * 9.81 * 0.1 * x
    found, rivals = disagreements_of(_problem(3, change)[2], _conditions())
    weighed = [each for each in found if each.condition is Condition.WEIGHED]
    assert weighed[0].first == pytest.approx(0.1)
    assert weighed[0].last == pytest.approx(0.1 + wrong, abs=3e-4)
    assert 0 < weighed_within(weighed) <= abs(weighed[0].last / 0.1 - 1)
    assert len(rivals) == len(found) - len(weighed)


def test_words_name_the_cause_and_which_way_the_parameter_goes():
    equations = _problem(4, _following(COMMAND, -0.002))[2]
    found = infer(*_fit(equations, conditions=_conditions()))
    best = found.agreement[0]
    assert causes(best) == ("a dead zone of the drive",)
    text = contrast_text(best, found)
    assert text.startswith("p4 grows with the command, from 0.01")
    assert "dead zone" in text


FOUR = ("p1", "p2", "p4", "coulomb")
VALUES = np.array([2.0, 0.5, 1.5, 0.8])


def likelihood_of(logs, names=FOUR, values=VALUES, prior=None):
    """The likelihood of logs' (m,) residuals and (m, n) rows about some values."""
    residuals, rows = zip(*logs, strict=True)
    told = {"names": names, "values": values, "lower": np.full(len(names), -np.inf)}
    told |= {"ends": np.cumsum([each.size for each in residuals]), "log": np.arange(len(rows))}
    at = Linearisation(rows=np.concatenate(rows), residuals=np.concatenate(residuals), **told)
    return Likelihood(at, values, prior=prior)


def test_logs_that_no_parameter_moves_scatter_as_usual():
    rng = np.random.default_rng(5)
    logs = [(rng.standard_normal(100), np.zeros((100, 1))) for _ in range(3)]
    found = likelihood_of(logs, ("coulomb",), np.ones(1)).best()
    assert np.all(np.isfinite(found.sizes))
