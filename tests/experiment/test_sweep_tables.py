"""Tables of a sweep."""

import numpy as np

from butterfly.experiment.sweep_tables import Estimates


def test_estimates_without_intervals_have_no_coverage():
    bounds = {"lower": [0.0, 2.0, np.nan], "upper": [2.0, 3.0, np.nan], "true": [1.0, 1.0, 1.0]}
    columns = {name: np.array(values) for name, values in bounds.items()}
    assert Estimates(columns).coverage == 0.5
    assert np.isnan(Estimates({name: values[2:] for name, values in columns.items()}).coverage)
