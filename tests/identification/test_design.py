"""What the ranking of next experiments does while it works."""

import threading

import pytest

from butterfly.errors import InputError
from butterfly.identification import design
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, steady


@pytest.fixture(scope="module")
def found():
    return HarmonicBalance(terms=(), check=False)(
        DataSet.of(steady(ROBOT, {2.0: 0.2, 4.4: 0.3, 8.5: 0.5}))
    )


def test_progress_is_shown_while_candidates_are_judged(found, monkeypatch):
    begun, judge = threading.Event(), design.judged_candidate

    def track(items, _):
        begun.set()
        yield from items

    def judged(*job, **options):
        assert begun.wait(5), "the work is over before its progress is shown"
        return judge(*job, **options)

    monkeypatch.setattr(design, "judged_candidate", judged)
    assert design.rank_experiments(found, [MASSES[1]], 0.05, track=track)


def test_a_swing_that_is_none_is_refused(found):
    for swing in (0.0, -1.0, float("nan"), "wide"):
        with pytest.raises(InputError, match="swing"):
            design.rank_experiments(found, [MASSES[1]], 0.05, largest_swing=swing)
