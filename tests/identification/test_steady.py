"""Logs of sines that say nothing to a sine fit are left out, with a word."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.estimators.steady_response import steady_sines
from butterfly.logs.log import Sine
from butterfly.verdict import Level
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, simulated

DRIVES = (2.0, 3.0, 7.5)


@pytest.fixture(scope="module")
def calm():
    """Six logs of sines that settle."""
    logs = []
    for mass in MASSES[:2]:
        for omega in DRIVES:
            sine = Sine(omega=omega, amplitude=0.005)
            logs.append(simulated(ROBOT, mass, sine.sample, 40.0, sine=sine))
    return logs


def _changed(logs, angle):
    return DataSet.of([replace(logs[0], angle=angle), *logs[1:]])


def _left_out(data):
    steady, said = steady_sines(data)
    assert steady == [1, 2, 3, 4, 5]
    (finding,) = said
    assert finding.kind is FindingKind.LEFT_OUT
    assert finding.logs == (data.logs[0].name,)
    assert finding.number == 6
    assert finding.severity is Level.NOTE


def test_sines_that_settle_are_all_used_and_nothing_is_said(calm):
    assert steady_sines(DataSet.of(calm)) == ([0, 1, 2, 3, 4, 5], [])


def test_other_inputs_are_passed_over_without_a_word(calm):
    mixed = DataSet.of([replace(calm[0], excitation=None), *calm[1:]])
    assert steady_sines(mixed) == ([1, 2, 3, 4, 5], [])


def test_a_hand_that_turns_over_is_left_out(calm):
    turning = np.where(calm[0].time > 25.0, 2 * np.pi * (calm[0].time - 25.0) / 3.0, 0.0)
    _left_out(_changed(calm, calm[0].angle + turning))


def test_a_swing_too_wide_for_a_sine_is_left_out(calm):
    _left_out(_changed(calm, calm[0].angle * (1.7 / np.abs(calm[0].angle[-4000:]).max())))


def test_a_swing_that_never_settles_is_left_out(calm):
    growing = calm[0].angle * np.exp(0.1 * (calm[0].time - 40.0))
    _left_out(_changed(calm, growing))


def test_one_that_rests_elsewhere_is_left_out_but_not_one_that_rests_a_whole_turn_off(calm):
    _left_out(_changed(calm, calm[0].angle + 1.5))
    assert steady_sines(_changed(calm, calm[0].angle + 2 * np.pi)) == ([0, 1, 2, 3, 4, 5], [])


def test_where_a_third_is_left_out_the_rest_needs_care(calm):
    moved = [replace(log, angle=log.angle + 1.5) for log in (calm[0], calm[3])]
    data = DataSet.of([moved[0], *calm[1:3], moved[1], *calm[4:]])
    steady, (said,) = steady_sines(data)
    assert steady == [1, 2, 4, 5]
    assert said.severity is Level.CARE
