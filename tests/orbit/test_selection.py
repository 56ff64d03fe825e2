"""Which terms a re-calibration keeps, and the stretches by which it judges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.normal_equations import Regression
from butterfly.orbit.recalibration import BASE, FOLDS, SEGMENT, LoopSelection, RecalibrationOptions
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, wild

CANDIDATES = ("drag", "p3_offset", "coulomb", "bias", "stribeck")


def _selection(robot, seed, noise=1e-3, duration=24.0):
    rng = np.random.default_rng(seed)
    logs = [
        replace(log, angle=log.angle + noise * rng.standard_normal(log.time.size))
        for log in wild(robot, MASSES, duration)
    ]
    return LoopSelection(logs, 0.0, RecalibrationOptions(candidates=CANDIDATES))


@pytest.mark.parametrize(
    ("present", "expected"),
    [
        ({"coulomb": 0.0}, set()),
        ({"coulomb": 1.5e-3}, {"coulomb"}),
        ({"coulomb": 1.5e-3, "p3_offset": 4e-3}, {"coulomb", "p3_offset"}),
    ],
)
def test_terms_that_are_there_are_chosen_and_hardly_any_other(present, expected):
    spurious = 0
    for seed in range(8):
        chosen = _selection(replace(ROBOT, **present), seed).select(BASE, CANDIDATES)
        assert expected <= set(chosen)
        assert len(set(chosen)) == len(chosen)
        spurious += len(set(chosen) - expected)
    assert spurious <= 3


def test_the_most_helpful_term_comes_first():
    robot = replace(ROBOT, coulomb=3e-3, p3_offset=6e-4)
    assert _selection(robot, 0).select(BASE, CANDIDATES)[0] == "coulomb"


def test_stretches_are_ten_test_functions_of_one_run():
    _, regression, run = _selection(ROBOT, 0, duration=12.0).fit(BASE)
    cluster = regression.cluster
    counts = np.bincount(cluster)
    assert counts.max() == SEGMENT == 10
    for number in range(len(MASSES)):
        own = np.unique(cluster[run == number])
        assert counts[own][:-1].tolist() == [SEGMENT] * (own.size - 1)
    assert all(np.unique(run[cluster == k]).size == 1 for k in np.unique(cluster))


def test_every_stretch_is_judged_by_a_fit_that_has_not_seen_it(monkeypatch):
    solve, seen = Regression.solve, []

    def spy(self, use=slice(None)):
        if isinstance(use, np.ndarray):
            seen.append((self.cluster, use))
        return solve(self, use)

    monkeypatch.setattr(Regression, "solve", spy)
    _selection(ROBOT, 0, duration=12.0).select(BASE, ("drag",))
    assert len(seen) >= 2 * FOLDS
    for cluster, use in seen:
        assert not set(cluster[use]) & set(cluster[~use])
    left_out = np.sum([~use for _, use in seen[:FOLDS]], axis=0)
    assert (left_out == 1).all()
