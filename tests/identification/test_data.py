"""A data set: what follows of what it is told."""

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.model.prior import Prior


def test_a_data_set_knows_what_follows_however_often_it_is_told_more(sine_log):
    data = DataSet.of([sine_log], known=Prior.of({"torque_constant": (0.05, 0.001)}))
    assert "p4" not in data.known.parameters
    data = data.knowing(Prior.of({"resistance": 2.0, "p4": (0.025, 0.0005)}))
    for more in ({}, {"hand_mass": 0.1}, {"p2": 0.01}):
        data = data.knowing(Prior.of(more)).take([0])
        assert data.known.parameters["p4"].uncertainty == pytest.approx(0.0005 / np.sqrt(2))
        assert data.given.parameters["p4"].uncertainty == 0.0005
