"""The result of an identification says of each log what its free run says."""

import pickle

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.identification.identify import identify
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SWINGS, noisy, steady

ESTIMATOR = OutputError(terms=(), workers=1)


@pytest.fixture(scope="module")
def found():
    logs = noisy(steady(ROBOT, SWINGS, MASSES[:2]), 1e-3, np.random.default_rng(0))
    return identify(DataSet.of(logs, name="robot"), ESTIMATOR)


def test_its_fits_are_those_of_its_free_runs_by_the_names_of_their_logs(found):
    assert [*found.fits] == [run.log.name for run in found.runs]
    np.testing.assert_array_equal([*found.fits.values()], [run.fit for run in found.runs])
    assert min(found.fits.values()) > 98


def test_it_says_what_it_was_made_of_and_is_whole_after_a_worker_sent_it(found):
    assert found.origin["name"] == "robot"
    assert found.origin["logs"] == len(found.runs)
    again = pickle.loads(pickle.dumps(found))  # noqa: S301 - our own
    assert again.fits == found.fits
    np.testing.assert_array_equal(again.estimate.covariance, found.estimate.covariance)
