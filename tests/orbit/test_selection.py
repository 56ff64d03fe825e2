"""Which terms a re-calibration keeps, and the stretches by which it judges."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.orbit.recalibration import (
    BASE,
    SEGMENT,
    LoopEquations,
    RecalibrationOptions,
    chosen_terms,
)
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, noisy, wild

CANDIDATES = ("drag", "p3_offset", "coulomb", "bias", "stribeck")


def _loop(robot, seed, noise=1e-3, duration=24.0):
    logs = noisy(wild(robot, MASSES, duration), noise, np.random.default_rng(seed))
    return LoopEquations(logs, 0.0, RecalibrationOptions(candidates=CANDIDATES))


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
        solution, regression, _ = _loop(replace(ROBOT, **present), seed).fit((*BASE, *CANDIDATES))
        chosen = chosen_terms(regression.linearised(solution), BASE)
        assert {*BASE, *expected} <= {*chosen}
        spurious += len({*chosen} - {*BASE, *expected})
    assert spurious <= 3


def test_stretches_are_ten_test_functions_of_one_run():
    _, regression, run = _loop(ROBOT, 0, duration=12.0).fit(BASE)
    cluster = regression.cluster
    counts = np.bincount(cluster)
    assert counts.max() == SEGMENT == 10
    for number in range(len(MASSES)):
        own = np.unique(cluster[run == number])
        assert counts[own][:-1].tolist() == [SEGMENT] * (own.size - 1)
    assert all(np.unique(run[cluster == k]).size == 1 for k in np.unique(cluster))
