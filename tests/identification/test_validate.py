from itertools import pairwise

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, OutputError
from butterfly.identification.free_run import FitSummary
from butterfly.identification.splits import Split
from butterfly.identification.validate import cross_validate, select_terms
from tests.identification.simulated import ROBOT, SLOW, steady

BALANCE = HarmonicBalance(check=False)


def test_every_log_is_predicted_once_by_an_estimate_that_has_not_seen_it(real):
    seen = []

    def spy(part):
        seen.append({log.source for log in part.logs})
        return BALANCE(part)

    for split, parts in ((Split.MASS, 3), (Split.FREQUENCY, 5)):
        seen.clear()
        result = cross_validate(real.data, spy, split)
        assert np.isfinite(result.fits).all()
        assert len(result.estimates) == len(seen) == parts
        missing = [source for log in real.data.logs for source in [log.source]]
        assert sum(source not in part for source in missing for part in seen) == 41


def test_harmonic_balance_predicts_a_mass_it_has_not_seen(real):
    for estimator, median, mean, worst in (
        (HarmonicBalance(check=False), 93.0, 91.2, 67),
        (HarmonicBalance(terms=(), check=False), 92.5, 91.4, 68),
    ):
        summary = cross_validate(real.data, estimator, Split.MASS).summary
        assert summary.median >= median
        assert summary.mean >= mean
        assert summary.worst >= worst


@pytest.mark.slow
def test_output_error_predicts_masses_and_frequencies_it_has_not_seen(real):
    """With the terms that `butterfly select` chooses."""
    estimator = OutputError(terms=("p3_offset", "drag", "bias"), check=False)
    masses = cross_validate(real.data, estimator, Split.MASS)
    assert masses.summary.median >= 94
    assert masses.summary.mean >= 92
    assert (masses.fits > 90).sum() >= 34
    half = real.data.take(range(0, 41, 2))
    omegas = cross_validate(half, estimator, Split.FREQUENCY)
    assert omegas.summary.median >= 96.5


def test_a_term_is_chosen_only_if_it_helps_to_predict(real):
    passed = select_terms(real.data, BALANCE, ("drag", "load", "stribeck"))
    means = [structure.held_out[Split.MASS].mean for structure in passed]
    assert means == sorted(means)
    assert passed[0].terms == ()
    whole = BALANCE.with_terms(passed[-1].terms)(real.data)
    full = FitSummary.of(real.data.simulations.fits(whole))
    assert passed[-1].in_sample == full


def test_neighbouring_frequencies_are_left_out_in_different_parts():
    logs = steady(ROBOT, SLOW)
    data = DataSet.of(logs)
    truth = BALANCE(data)
    result = cross_validate(data, lambda _: truth, Split.FREQUENCY)
    assert list(result.estimates) == [f"part {k + 1}" for k in range(5)]
    omegas = sorted(SLOW)
    left_out = []

    def spy(part):
        left_out.append(set(omegas) - {log.excitation.omega for log in part.logs})
        return truth

    cross_validate(data, spy, Split.FREQUENCY)
    for one, other in pairwise(omegas):
        assert not any({one, other} <= part for part in left_out)
    assert set().union(*left_out) == set(omegas)
    np.testing.assert_allclose(result.fits, data.simulations.fits(truth))


def test_one_mass_cannot_be_held_out(real):
    alone = real.data.take(range(14))
    with pytest.raises(IdentifiabilityError, match=r"same added mass .*; split frequency works"):
        cross_validate(alone, BALANCE, Split.MASS)


def test_of_two_masses_it_is_said_which_was_left_out_when_one_is_too_few(real):
    two = real.data.take(range(27))
    with pytest.raises(IdentifiabilityError, match=r"one added mass left of two.*; split freq"):
        cross_validate(two, BALANCE, Split.MASS)
