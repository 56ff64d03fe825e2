"""On-line estimation against re-calibration, and against the same rows solved by hand."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError
from butterfly.identification.test_functions import HALF_WIDTH, SPACING
from butterfly.identification.trust import FindingKind
from butterfly.logs.log import Intersample
from butterfly.orbit.online import OnlineRecalibration
from butterfly.orbit.recalibration import RecalibrationOptions, recalibrate
from butterfly.plant.motor import Reading
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, STEP, wild

TERMS = ("coulomb",)


@pytest.fixture(scope="module")
def log():
    (found,) = wild(ROBOT, MASSES[1:2], 40.0)
    return replace(found, intersample=Intersample.ZERO_ORDER_HOLD)  # as a loop's commands are


@pytest.fixture(scope="module")
def short(log):
    return log.take(log.time < 15.0)


def _fed(log, memory, until=np.inf, zero=0.0):
    online = OnlineRecalibration(zero, terms=TERMS, memory=memory)
    ready = []
    for time, angle, command in zip(log.time, log.angle, log.input, strict=True):
        if time < until and online.observe(Reading(time, angle, np.nan), command):
            ready.append(online.is_ready)
    return online, ready


def test_when_nothing_is_forgotten_it_is_recalibration_s_estimate(log):
    online, _ = _fed(log, 1e9)
    found = online.estimate()
    held = recalibrate([log], 0.0, RecalibrationOptions(candidates=TERMS)).estimate
    assert found.names == held.names == ("p2", "p3", "p4", "coulomb")
    np.testing.assert_allclose(found.values, held.values, rtol=0.02)
    np.testing.assert_allclose(found.standard_errors, held.standard_errors, rtol=0.5)
    np.testing.assert_array_equal(found.values, online.ratios())
    assert np.all((found.lower <= found.values) & (found.values <= found.upper))
    kinds = {each.kind for each in found.findings}
    assert FindingKind.RATIOS in kinds
    assert FindingKind.COMBINATION not in kinds
    loaded = ROBOT.with_added_mass(MASSES[1])
    truth = np.array([loaded.p3, loaded.p4]) / loaded.p1
    np.testing.assert_allclose(found.values[1:3], truth, rtol=0.01)


def test_rows_fade_with_their_age(short):
    """The fading least squares of the same stretches, put together here."""
    log, memory = short, 6.0
    online, _ = _fed(log, memory)
    span = round(2 * HALF_WIDTH / STEP) + 4
    advance = round(SPACING * HALF_WIDTH / STEP)
    rows, start = [], 0
    options = RecalibrationOptions()
    names = ("p1", "p2", "p3", "p4", *TERMS)
    while start + span <= log.time.size:
        part = log.take(np.arange(start, start + span))
        signals = options.averaging(part, 0.0).signals(names)
        if signals.moving[0]:
            rows.append([signals.mean[name][0] for name in names])
        start += advance
    table = np.array(rows) * np.exp(
        -0.5 * SPACING * HALF_WIDTH / memory * np.arange(len(rows))[::-1, None]
    )
    expected = np.linalg.lstsq(table[:, 1:], -table[:, 0], rcond=None)[0]
    np.testing.assert_allclose(online.ratios(), expected, rtol=5e-3)


def test_it_is_ready_with_twice_as_many_rows_as_unknowns(short):
    _, ready = _fed(short, 20.0, until=5.0)
    assert ready.index(True) == 2 * 4 - 1


def test_the_encoder_s_zero_is_taken_off_and_a_pause_begins_anew(short):
    turned = replace(short, angle=short.angle + 0.7)
    one, other = _fed(short, 20.0)[0], _fed(turned, 20.0, zero=0.7)[0]
    np.testing.assert_allclose(other.ratios(), one.ratios(), rtol=1e-6)
    paused = replace(short, time=short.time + 100.0 * (short.time > 10.0))
    np.testing.assert_allclose(_fed(paused, 20.0)[0].ratios(), one.ratios(), rtol=0.02)


def test_what_the_motion_so_far_cannot_tell_is_refused(short):
    for until in (0.1, 0.9, 2.0):
        online, _ = _fed(short, 20.0, until=until)
        with pytest.raises(IdentifiabilityError, match="too short"):
            online.estimate()
    still = replace(short, angle=0.3 * np.sin(4 * short.time), input=0.0 * short.time)
    online, _ = _fed(still, 20.0)
    with pytest.raises(IdentifiabilityError, match="input is always zero"):
        online.estimate()
