"""Which logs, or stretches of them, are left out together."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, WeakForm
from butterfly.identification.splits import Split, divide, excluding_interval, remedy
from butterfly.identification.validate import cross_validate
from butterfly.logs.log import Log, Sine
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Prior
from tests.identification.simulated import ROBOT, SLOW, steady, wild

BALANCE = HarmonicBalance(terms=())
HEAVY = AddedMass(mass=0.1, arm=0.1)


def _other(*masses):
    """Return logs of no sine."""
    time = np.arange(400) * 0.01
    return DataSet.of([Log(time, np.ones(400), np.sin(time), added_mass=mass) for mass in masses])


@pytest.fixture(scope="module")
def sines():
    return DataSet.of(steady(ROBOT, SLOW))


def _of(data, count):
    masses = data.masses[:count]
    return data.take([k for k, log in enumerate(data.logs) if log.added_mass in masses])


def test_the_split_that_suits_the_logs_is_taken_and_said(sines):
    bare = AddedMass()
    for data, split, why in (
        (sines, Split.MASS, "there are 3 added masses"),
        (_of(sines, 2), Split.FREQUENCY, "only 2 added masses, but sines at"),
        (_of(sines, 1), Split.FREQUENCY, "only one added mass, but sines at"),
        (_other(bare, bare, bare), Split.LOG, "only one added mass, but 3 logs"),
        (_other(bare, bare, HEAVY), Split.TIME, "only 2 added masses, and too few logs"),
        (_other(bare), Split.TIME, "only one added mass, and too few logs"),
    ):
        division = divide(data)
        assert division.split is split
        assert why in division.why
    known = _other(bare, bare, HEAVY).knowing(Prior.of({"p4": 1.0}))
    assert divide(known).split is Split.LOG


def test_every_sample_is_left_out_once(sines):
    for split in (Split.MASS, Split.FREQUENCY, Split.LOG, Split.TIME):
        left_out = [np.zeros(log.time.size, dtype=int) for log in sines.logs]
        for samples in divide(sines, split).parts.values():
            for number, stretch in samples.items():
                left_out[number][stretch] += 1
        assert all((count == 1).all() for count in left_out)
    assert len(divide(sines, Split.LOG, 3).parts) == 3
    assert len(divide(sines, folds=4).parts) == 4


def test_logs_of_no_sine_are_kept_where_frequencies_are_left_out(sines):
    whole = replace(sines.logs[0], excitation=None)
    mixed = DataSet.of([*sines.logs, whole])
    held = cross_validate(mixed, lambda _: BALANCE(sines), Split.FREQUENCY)
    assert np.isnan(held.fits[-1])
    assert np.isfinite(held.fits[:-1]).all()
    assert np.isfinite(held.summary.median)


@pytest.mark.parametrize(("kind", "least"), [("sines", 98), ("any motion", 99)])
def test_stretches_of_time_are_predicted_by_an_estimate_from_the_others(sines, kind, least):
    data = _of(sines, 2) if kind == "sines" else DataSet.of(wild(ROBOT))
    estimator, seen = BALANCE if kind == "sines" else WeakForm(terms=()), []

    def spy(part):
        seen.append(sum(float(log.time[-1] - log.time[0]) for log in part.logs))
        return estimator(part)

    held = cross_validate(data, spy, Split.TIME, folds=3)
    assert list(held.estimates) == [f"stretch {k} of 3" for k in (1, 2, 3)]
    assert max(seen) < 0.7 * sum(float(log.time[-1]) for log in data.logs)
    assert held.summary.worst > least


def test_refusals_name_what_works(sines):
    for data, split, said in (
        (_of(sines, 1), Split.MASS, "no log has an added mass: .*; split frequency works"),
        (_other(AddedMass(), HEAVY), Split.FREQUENCY, "no log is a sine.*; split time works"),
        (_other(AddedMass()), Split.LOG, "only one log.*; split time works"),
    ):
        with pytest.raises(IdentifiabilityError, match=said):
            divide(data, split)
    assert "frequency" in remedy(_of(sines, 2))


def test_folds_that_cannot_be_are_refused(sines):
    for split, folds, expected in (
        (Split.MASS, 2, "with split frequency, log or time"),
        (Split.TIME, 1, "at least 2"),
        (Split.LOG, 99, "at most"),
        (Split.LOG, "a", "a whole number"),
        (Split.TIME, 2.5, "a whole number"),
    ):
        with pytest.raises(InputError, match=expected):
            divide(sines, split, folds)


def test_neighbouring_frequencies_are_in_different_folds_whatever_the_order_of_the_logs():
    time = np.arange(4000) * 0.01
    omegas = np.random.default_rng(0).permutation(np.arange(1.0, 11.0))
    sines = [Sine(omega=omega, amplitude=1.0) for omega in omegas.tolist()]
    logs = [Log(time, each.sample(time), each.sample(time), excitation=each) for each in sines]
    for part in divide(DataSet.of(logs), Split.FREQUENCY, folds=4).parts.values():
        assert (np.diff(np.sort(omegas[list(part)])) >= 4).all()


def _swinging(**properties):
    time = np.arange(2000) * 0.01
    return Log(time, np.cos(time), 0.3 * np.sin(2 * time), name="swing", **properties)


def test_the_piece_after_a_stretch_begins_in_motion_with_what_was_commanded():
    before, after = excluding_interval(_swinging(), slice(500, 1000))
    assert (before.time[0], before.time[-1]) == (0.0, 4.99)
    assert after.time[0] == 10.0
    assert after.time.size == 1000
    assert after.initial_state.velocity == pytest.approx(0.6 * np.cos(20), abs=0.01)
    np.testing.assert_allclose(after.lead.input, np.cos(after.lead.time))
    assert (before.name, after.name) == ("swing, before", "swing, after")


def test_a_piece_that_cannot_be_used_is_left_out():
    (after,) = excluding_interval(_swinging(), slice(0, 1000))
    assert after.name == "swing, after"
    (before,) = excluding_interval(_swinging(), slice(1990, 2000))
    assert before.name == "swing, before"
    sine = _swinging(excitation=Sine(omega=2.0, amplitude=1.0))
    assert len(excluding_interval(sine, slice(1400, 1500))) == 1
