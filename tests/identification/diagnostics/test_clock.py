"""Inputs whose sines are not at their omega: the clock or omega is wrong, and both are named."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.diagnostics.unit_errors import judge_clock
from butterfly.identification.estimators import HarmonicBalance
from tests.identification.simulated import ROBOT, SWINGS, steady


@pytest.fixture(scope="module")
def logs():
    return steady(ROBOT, SWINGS)


@pytest.mark.parametrize("rate", [0.997, 1.0, 1.002])
def test_a_clock_that_runs_wrong_is_named_with_its_share(logs, rate):
    data = DataSet.of([replace(log, time=rate * log.time) for log in logs])
    found = judge_clock(data.sines)
    assert len(found) == (rate != 1)
    for each in found:
        assert each.kind is FindingKind.CLOCK
        assert each.number == pytest.approx(1 / rate - 1, abs=2e-5)


def test_omegas_that_are_rounded_to_either_side_name_no_clock(logs):
    data = DataSet.of(logs)
    random = np.random.default_rng(0)
    points = [replace(each, detuning=1e-3 * random.standard_normal()) for each in data.sines]
    assert judge_clock(points) == []


def test_where_the_clock_is_wrong_no_inertia_of_the_masses_own_is_found_in_its_place(logs):
    data = DataSet.of([replace(log, time=0.996 * log.time) for log in logs])
    assert "mass_inertia" not in HarmonicBalance()(data).names
