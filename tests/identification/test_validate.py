"""What was not seen is predicted, and estimates from drawn logs scatter as their errors say."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification import validate
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import (
    Estimator,
    HarmonicBalance,
    Linear,
    OutputError,
    WeakForm,
    output_error,
)
from butterfly.identification.estimators.multistart import starts
from butterfly.identification.free_run import FitSummary
from butterfly.identification.splits import Split
from butterfly.identification.validate import (
    CrossValidation,
    bootstrap,
    cross_validate,
    cross_validate_choice,
    select_terms,
)
from butterfly.model.terms import PARAMETERS
from tests.identification.simulated import RICH, ROBOT, SWINGS, steady

BALANCE = HarmonicBalance()


@pytest.mark.parametrize(("split", "parts"), [(Split.MASS, 3), (Split.FREQUENCY, 5)])
def test_every_log_is_predicted_once_by_an_estimate_that_has_not_seen_it(real, split, parts):
    """One estimate for all parts follows what is left out as it does what is not."""
    seen = []

    def spy(part):
        seen.append({log.source for log in part.logs})
        return real.estimate

    result = cross_validate(real.data, spy, split)
    assert len(result.estimates) == len(seen) == parts
    assert all(sum(log.source not in part for part in seen) == 1 for log in real.data.logs)
    np.testing.assert_allclose(result.fits, real.data.simulations.fits(real.estimate))


def test_harmonic_balance_predicts_a_mass_it_has_not_seen(real):
    for estimator, median, mean, worst in (
        (HarmonicBalance(), 93.0, 91.2, 67),
        (HarmonicBalance(terms=()), 92.3, 91.2, 66),
    ):
        summary = cross_validate(real.data, estimator, Split.MASS).summary
        assert summary.median >= median
        assert summary.mean >= mean
        assert summary.worst >= worst


@pytest.mark.slow
def test_output_error_predicts_masses_and_frequencies_it_has_not_seen(real):
    """With the terms that `butterfly select` chooses."""
    estimator = OutputError(terms=("p3_offset", "drag", "bias"))
    masses = cross_validate(real.data, estimator, Split.MASS)
    assert masses.summary.median >= 94
    assert masses.summary.mean >= 92
    assert (masses.fits > 90).sum() >= 34
    default = cross_validate(real.data, OutputError(), Split.MASS).summary
    assert default.median >= 94.7
    assert default.mean >= 93.2
    half = real.data.take(range(0, 41, 2))
    omegas = cross_validate(half, estimator, Split.FREQUENCY)
    assert omegas.summary.median >= 96


@pytest.mark.slow
def test_a_term_is_chosen_only_if_it_helps_to_predict(real):
    passed = select_terms(real.data, BALANCE, ("drag", "load", "stribeck"))
    means = [structure.held_out[Split.MASS].mean for structure in passed]
    assert means == sorted(means)
    assert passed[0].terms == ()
    whole = BALANCE.with_terms(passed[-1].terms)(real.data)
    full = FitSummary.of(real.data.simulations.fits(whole))
    assert passed[-1].in_sample == full


def test_a_gain_counts_where_it_is_more_than_its_own_standard_error():
    fits = np.array([90.0, 92.0, np.nan, 94.0])
    gain = _validated(fits + 0.3).gain_over(_validated(fits))
    assert gain == pytest.approx((0.3, 0.0), abs=1e-12)
    gain = _validated(fits + np.array([6.0, -3.0, 0.0, -2.4])).gain_over(_validated(fits))
    assert gain == pytest.approx((0.2, np.std([6.0, -3.0, -2.4], ddof=1) / 3**0.5))
    assert _validated(fits[:1]).mean.error == np.inf


def _validated(fits):
    return CrossValidation(division=None, fits=fits, estimates={})


@pytest.mark.slow
def test_a_choice_is_judged_by_what_it_has_not_seen(real):
    terms = ("drag", "bias")
    nested = cross_validate_choice(real.data, BALANCE, terms)
    assert len(nested.estimates) == 3
    chosen = select_terms(real.data, BALANCE, terms)[-1].held_out[Split.MASS]
    assert nested.mean.mean == pytest.approx(chosen.mean, abs=2 * nested.mean.error)
    assert 0 < nested.mean.error < 3


@pytest.mark.parametrize(
    ("logs", "refusal"),
    [
        (14, r"same added mass .*; split frequency works"),  # one mass
        (27, r"only one added mass remains.*; split freq"),
    ],
)
def test_too_few_masses_are_refused_with_the_split_that_works(real, logs, refusal):
    with pytest.raises(IdentifiabilityError, match=refusal):
        cross_validate(real.data.take(range(logs)), BALANCE, Split.MASS)


class DescribingFunctions(HarmonicBalance):
    """Without the remainder."""

    def __call__(self, data):
        return self.of_points(data.sines)


def test_the_bootstrap_agrees_with_the_sandwich(real):
    estimator = DescribingFunctions(terms=())
    whole = estimator(real.data)
    drawn = bootstrap(real.data, estimator, whole, repetitions=100, seed=1)
    spread = np.std(drawn.values, axis=0)
    np.testing.assert_allclose(spread / whole.standard_errors, 1.0, atol=0.35)
    assert np.all(drawn.lower < whole.values)
    assert np.all(whole.values < drawn.upper)
    again = bootstrap(real.data, estimator, whole, repetitions=20, seed=1)
    np.testing.assert_array_equal(again.values, drawn.values[:20])
    with pytest.raises(InputError, match="at least 20"):
        bootstrap(real.data, estimator, whole, repetitions=3)


@pytest.mark.slow
def test_the_bootstrap_keeps_the_terms_that_were_chosen_from_all_logs(real):
    drawn = bootstrap(real.data, HarmonicBalance(), real.estimate, repetitions=20)
    assert len(real.estimate.names) > len(PARAMETERS)
    assert drawn.values.shape == (20, len(real.estimate.names))


class Forgetful(Estimator):
    """Drops its term where a draw is one log only."""

    def __call__(self, data):
        names = ("p1", "drag") if len({log.name for log in data.logs}) > 1 else ("p1",)
        return SimpleNamespace(names=names, values=np.array([1.0, 2.0])[: len(names)])


def test_draws_that_cannot_tell_a_term_are_drawn_again_or_refused():
    logs = steady(ROBOT, {2.5: 0.2, 4.5: 0.2, 7.0: 0.2})[:3]  # of one mass
    data = DataSet.of([replace(log, name=f"{k}") for k, log in enumerate(logs)])
    whole = SimpleNamespace(names=("p1", "drag"))
    drawn = bootstrap(data, Forgetful(), whole, repetitions=20, seed=3)
    assert drawn.values.shape == (20, 2)
    with pytest.raises(IdentifiabilityError, match="load cannot be identified"):
        bootstrap(data, Forgetful(), SimpleNamespace(names=("p1", "load")), repetitions=20)


@pytest.mark.parametrize(
    ("estimator", "terms"),
    [
        (HarmonicBalance(), ("stribeck", "bias")),
        (WeakForm(terms=("drag", "load"), half_width=0.2), ("drag",)),
        (OutputError(window=20.0), ("drag", "stribeck", "stribeck_velocity")),
        (OutputError(terms=("drag",)), ()),
    ],
)
def test_an_estimator_holds_the_terms_of_an_estimate_and_all_else_as_it_was(estimator, terms):
    estimate = SimpleNamespace(names=(*PARAMETERS, *terms))
    assert estimator.holding_terms_of(estimate) == estimator.with_terms(terms)
    assert Linear().holding_terms_of(estimate) == Linear()  # which offers none


def test_an_estimate_with_the_terms_held_is_the_one_that_chose_them(real):
    chosen = HarmonicBalance()(real.data)
    held = HarmonicBalance().holding_terms_of(chosen)(real.data)
    assert held.names == chosen.names
    np.testing.assert_allclose(
        (held.values - chosen.values) / chosen.standard_errors, 0.0, atol=0.3
    )


@pytest.mark.slow
def test_terms_are_chosen_by_output_error_from_one_search_for_starts(monkeypatch):
    """The fits with some terms begin where that with all ends, and end where their own would."""
    data = DataSet.of([replace(log, name=f"{k}") for k, log in enumerate(steady(RICH, SWINGS))])
    searches = []

    def counted(*arguments):
        searches.append(arguments)
        return starts(*arguments)

    monkeypatch.setattr(validate, "starts", counted)
    monkeypatch.setattr(output_error, "starts", counted)
    (plain, better, *_) = select_terms(data, OutputError(), ("drag", "bias"))
    assert len(searches) == 1
    for found in (plain, better):
        own = cross_validate(data, OutputError(terms=found.terms), Split.MASS)
        assert found.held_out[Split.MASS].mean == pytest.approx(own.summary.mean, abs=0.02)
        fits = data.simulations.fits(OutputError(terms=found.terms)(data))
        assert found.in_sample.mean == pytest.approx(fits.mean(), abs=0.02)
