"""The report of a sweep."""

import numpy as np
import pytest

from butterfly.experiment.sweep_tables import Estimates
from butterfly.report.sweep_page import closest


@pytest.mark.parametrize(
    ("shift", "named"), [(0.0, ["a", "b"]), (0.3, ["a", "b"]), (3.0, ["a"]), (-3.0, ["b"])]
)
def test_a_sweep_names_no_winner_within_noise(shift, named):
    runs = 40
    noise = np.random.default_rng(0).uniform(1, 2, (2, runs))
    deviations = np.concatenate([noise[0] + 5, noise[1] + 5 + shift * 0.1])
    table = Estimates(
        {
            "number": np.tile(np.arange(runs, dtype=float), 2),
            "estimator": np.repeat(np.array(["a", "b"], dtype=object), runs),
            "deviation": deviations * np.tile([1.0, -1.0], runs),
        }
    )
    assert sorted(closest(table)) == named
