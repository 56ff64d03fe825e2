"""A data set: what follows of what it is told."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Prior


def test_a_data_set_knows_what_follows_however_often_it_is_told_more(sine_log):
    data = DataSet.of([sine_log], known=Prior.of({"torque_constant": (0.05, 0.001)}))
    assert "p4" not in data.known.parameters
    data = data.knowing(Prior.of({"resistance": 2.0, "p4": (0.025, 0.0005)}))
    for more in ({}, {"hand_mass": 0.1}, {"p2": 0.01}):
        data = data.knowing(Prior.of(more)).take([0])
        assert data.known.parameters["p4"].uncertainty == pytest.approx(0.0005 / np.sqrt(2))
        assert data.given.parameters["p4"].uncertainty == 0.0005


def test_logs_near_the_upright_are_left_out_where_enough_others_stand_for_all(sine_log):
    heavier = AddedMass(mass=0.05, arm=0.1)
    turned = replace(
        sine_log, name="turned", angle=sine_log.angle + np.linspace(0, 7, sine_log.time.size)
    )
    calm = [replace(sine_log, name=f"{k}", added_mass=heavier) for k in range(2)]
    calm += [replace(sine_log, name=f"bare {k}") for k in range(2)]
    data = DataSet.of([*calm, turned])
    assert [log.name for log in data.calm.logs] == [log.name for log in calm]
    few = DataSet.of([*calm[1:3], turned])
    assert few.calm is few
