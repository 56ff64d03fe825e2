"""Inputs whose sines are not at their omega: the clock or omega is wrong, and is corrected."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.diagnostics.unit_errors import clock_error
from butterfly.identification.estimators import HarmonicBalance, OutputError
from butterfly.identification.identify import identify
from butterfly.model.prior import Prior
from tests.identification.simulated import ROBOT, SWINGS, steady


@pytest.fixture(scope="module")
def logs():
    return [log.take(np.arange(0, log.time.size, 4)) for log in steady(ROBOT, SWINGS)]


@pytest.mark.parametrize("rate", [0.997, 1.0, 1.002])
def test_the_share_by_which_sines_run_off_is_told(logs, rate):
    data = DataSet.of([replace(log, time=rate * log.time) for log in logs])
    share = clock_error(data.sines)
    assert share == pytest.approx(1 / rate - 1, abs=2e-5)
    assert (share == 0) == (rate == 1)


def test_omegas_that_are_rounded_to_either_side_are_no_clock(logs):
    data = DataSet.of(logs)
    random = np.random.default_rng(0)
    points = [replace(each, detuning=1e-3 * random.standard_normal()) for each in data.sines]
    assert clock_error(points) == 0


@pytest.mark.parametrize(
    ("wrong", "kind", "estimator"),
    [
        ("clock", FindingKind.CLOCK_SET, HarmonicBalance()),
        ("omega", FindingKind.OMEGA_SET, HarmonicBalance()),
        ("clock", FindingKind.CLOCK_SET, OutputError()),
    ],
)
def test_known_masses_tell_which_is_wrong(logs, wrong, kind, estimator):
    found = identify(DataSet.of([_told_wrong(log, wrong) for log in logs]), estimator)
    assert kind in {each.kind for each in found.estimate.findings}
    assert "mass_inertia" not in found.estimate.names
    assert found.data.logs[0].time[-1] == pytest.approx(logs[0].time[-1], rel=1e-4)
    assert found.data.logs[0].excitation.omega == pytest.approx(logs[0].excitation.omega, rel=1e-4)
    assert found.estimate.parameters.p1 == pytest.approx(ROBOT.p1, rel=2e-3)


@pytest.mark.parametrize("wrong", ["clock", "omega"])
def test_logs_that_are_held_out_are_corrected_too(logs, wrong):
    named = [replace(_told_wrong(log, wrong), name=str(k)) for k, log in enumerate(logs)]
    found = identify(DataSet.of(named).holding_out(["1"]))
    (held,) = found.data.test_logs.logs
    assert held.time[-1] == pytest.approx(logs[1].time[-1], rel=1e-4)
    assert held.excitation.omega == pytest.approx(logs[1].excitation.omega, rel=1e-4)
    assert found.held_out["1"] > 99


@pytest.mark.parametrize("wrong", ["clock", "omega"])
def test_where_nothing_tells_the_interval_holds_both(logs, wrong):
    bare = [_told_wrong(log, wrong) for log in logs if not log.added_mass.mass]
    data = DataSet.of(bare, known=Prior.of({"p4": ROBOT.p4}))
    found = identify(data, OutputError()).estimate
    assert FindingKind.CLOCK in {each.kind for each in found.findings}
    (place,) = [k for k, name in enumerate(found.names) if name == "p1"]
    assert found.lower[place] <= ROBOT.p1 <= found.upper[place]
    assert found.upper[place] - found.lower[place] < 0.02 * ROBOT.p1


def _told_wrong(log, what):
    return log.timed(0.996) if what == "clock" else log.tuned(0.996)
