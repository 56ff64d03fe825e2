"""Re-calibration next to the 60 degree orbit, against the true parameters."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.test_functions import Balance
from butterfly.model.energy import Orbit
from butterfly.orbit.controller import Dithered, EnergyShaping, gain_for
from butterfly.orbit.loop import calibrate, study_orbit, swing
from butterfly.orbit.online import OnlineRecalibration, SelfTuning
from butterfly.orbit.recalibration import RecalibrationOptions, recalibrate
from butterfly.plant.motor import CommandPath, Reading
from butterfly.plant.rig import Simulator
from butterfly.report.finding_texts import estimate_sentences
from tests.orbit import setting

pytestmark = pytest.mark.slow

ROUGH = setting.plant({"coulomb": 4e-4})
TRUE = ROUGH.robot.lumped
NAMES = ("p2", "p3", "p4", "coulomb")


def _rms(found, scale):
    """Rms errors of the named parameters over several estimates, in per cent."""
    found = [each.estimate for each in found]
    errors = [
        [100 * (v * scale / getattr(TRUE, n) - 1) for n, v in zip(e.names, e.values, strict=True)]
        for e in found
    ]
    return dict(zip(found[0].names, np.sqrt(np.mean(np.square(errors), axis=0)), strict=True))


@pytest.fixture(scope="module")
def draws():
    return [setting.runs(ROUGH, np.random.default_rng(seed)) for seed in range(6)]


@pytest.mark.parametrize(
    ("balance", "limits"),
    [
        (Balance.MOMENTUM, {"p2": 0.05, "p3": 0.01, "p4": 0.06, "coulomb": 0.5}),
        (Balance.ENERGY, {"p2": 0.1, "p3": 0.01, "p4": 0.06, "coulomb": 1.0}),
    ],
)
def test_either_balance_finds_the_ratios_whatever_the_controller_believed(draws, balance, limits):
    options = RecalibrationOptions(balance=balance)
    rms = _rms([recalibrate(logs, 0.0, options) for logs in draws], TRUE.p1)
    assert all(rms[name] < limit for name, limit in limits.items()), rms


def test_terms_that_are_not_there_are_rejected_and_intervals_hold_the_truth(draws):
    held = []
    for logs in draws:
        found = recalibrate(logs, 0.0)
        assert found.estimate.names == NAMES
        assert set(found.rejected) == {"drag", "p3_offset", "bias", "compression"}
        true = np.array([getattr(TRUE, n) / TRUE.p1 for n in NAMES])
        held.append((found.estimate.lower <= true) & (true <= found.estimate.upper))
    assert np.mean(held) > 0.85
    assert found.estimate.ratios
    assert any("ratios to p1" in sentence for sentence in estimate_sentences(found.estimate))


def test_with_a_known_mass_all_of_p1_to_p4_are_absolute():
    draws = map(np.random.default_rng, range(2))
    masses = setting.NO_ADDED_MASS, setting.KNOWN
    rms = _rms([recalibrate(setting.runs(ROUGH, rng, masses=masses), 0.0) for rng in draws], 1.0)
    assert all(rms[name] < 0.05 for name in ("p1", "p2", "p3", "p4")), rms


def test_ratios_say_nothing_of_another_load(draws):
    found = recalibrate(draws[0], 0.0)
    assert found.loaded(inertia=TRUE.p1).p3 == pytest.approx(TRUE.p3, rel=1e-4)
    with pytest.raises(IdentifiabilityError, match="50 g"):
        found.loaded(setting.KNOWN)


def test_constraints_hold_where_the_data_would_have_it_otherwise():
    smooth = setting.plant({"viscous": 0.0})
    found = recalibrate(setting.runs(smooth, np.random.default_rng(5), duration=8.0), 0.0)
    assert dict(zip(found.estimate.names, found.estimate.values, strict=True))["p2"] >= 0
    assert (found.estimate.lower[0], found.estimate.names[0]) >= (0.0, "p2")


def test_too_little_motion_is_refused():
    logs = setting.runs(ROUGH, np.random.default_rng(0), starts=(0.9,), duration=3.0)
    with pytest.raises(IdentifiabilityError, match="record longer runs"):
        recalibrate(logs, 0.0)
    with pytest.raises(InputError, match="expected at least"):
        recalibrate([logs[0].take(logs[0].time < 0.2)], 0.0)


@pytest.mark.parametrize(
    ("build", "named"),
    [
        (lambda: RecalibrationOptions(candidates=("coulom",)), "'coulomb'"),
        (lambda: RecalibrationOptions(candidates=("cogging",)), "distinguishable from p3"),
        (lambda: OnlineRecalibration(memory=0.0), "memory"),
        (lambda: OnlineRecalibration(terms=("compression",)), "linear in u"),
        (
            lambda: calibrate(None, replace(TRUE, p4=-1.0), 0.0, setting.sixty_degrees(), rng=None),
            "p4",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(build, named):
    with pytest.raises(InputError, match=named):
        build()


def test_the_recalibrated_model_predicts_a_hundred_times_better():
    """With a compressed drive, by the grey box; the benchmarks do all effects, in MuJoCo."""
    spec, amplitudes, told = setting.EFFECTS["gain compression"]
    rng = np.random.default_rng(1)
    small = setting.generic(spec, amplitudes, simulator=Simulator.GREY_BOX)
    plan = setting.sixty_degrees(recalibration=RecalibrationOptions(**told))
    study = study_orbit(setting.grey_rig(spec, rng), small, 0.0, plan, rng=rng)
    assert study.errors["generic"] > 100 * study.errors["re-calibrated"]
    assert study.cross.shape == (0, 0)


def test_in_mujoco_the_loop_brings_97_degrees_to_60():
    rng = np.random.default_rng(3)
    small = setting.generic(ROUGH, setting.AGAINST_COULOMB, duration=40.0)
    found = calibrate(partial(ROUGH.rig.run, rng=rng), small, 0.0, setting.sixty_degrees(), rng=rng)
    reached = [math.degrees(each.reached) for each in found.rounds]
    assert reached[0] == pytest.approx(97.0, abs=1.0)
    assert reached[-1] == pytest.approx(60.0, abs=0.2)
    assert len(reached) <= 4
    assert found.parameters.p2 / found.parameters.p1 == pytest.approx(TRUE.p2 / TRUE.p1, rel=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_the_loop_converges_from_wrong_parameters(seed):
    rng = np.random.default_rng(seed)
    rig = setting.grey_rig(ROUGH, rng)
    plan = setting.sixty_degrees(duration=20.0)
    found = calibrate(rig, setting.wrong(TRUE, rng), 0.0, plan, rng=rng)
    assert math.degrees(found.rounds[-1].reached) == pytest.approx(60.0, abs=0.2)
    assert len(found.rounds) <= 4
    for each in found.rounds:
        assert (each.recalibration.estimate.values >= 0).all()


@pytest.mark.parametrize(("dither", "limit"), [(0.0, math.inf), (0.2, math.inf), (0.0, 4.5e-4)])
def test_on_line_the_ratios_are_known_and_the_orbit_held_after_ten_periods(dither, limit):
    rng = np.random.default_rng(0)
    believed = setting.wrong(TRUE, rng)
    orbit = Orbit.of_amplitude(believed, setting.SIXTY)
    online = OnlineRecalibration(memory=30.0)
    shaping = EnergyShaping(orbit, gain_for(orbit, 0.5))
    how = {"commands": Dithered(shaping, dither, 3.6, rng), "path": CommandPath(limit=limit)}
    how |= {"multiplier": 0.5, "inertia": TRUE.p1, "every": 1.0}
    law = SelfTuning(shaping, online, lambda p: Orbit.of_amplitude(p, setting.SIXTY), **how)
    period = Orbit.of_amplitude(TRUE, setting.SIXTY).period
    spec = ROUGH.model_copy(update={"path": CommandPath(limit=limit)})
    log = setting.grey_rig(spec, rng)(law, 1.4, 10 * period, setting.NO_ADDED_MASS)
    assert math.degrees(swing(log, 0.0, 7 * period)) == pytest.approx(60.0, abs=0.2 + 5 * dither)
    found = online.parameters(TRUE.p1)
    bounds = {"p2": 2e-3, "p3": 1e-4, "p4": 2e-3, "coulomb": 0.02}
    for name, bound in bounds.items():
        assert getattr(found, name) == pytest.approx(getattr(TRUE, name), rel=bound)


def test_on_line_what_changed_is_forgotten():
    rng = np.random.default_rng(0)
    orbit = Orbit.of_amplitude(TRUE, setting.SIXTY)
    online = OnlineRecalibration(terms=(), memory=4.0)
    for spec, offset in ((setting.plant(), 0.0), (setting.plant({"viscous": 2e-3}), 21.0)):
        rig = setting.grey_rig(spec, rng)
        log = rig(
            Dithered(EnergyShaping(orbit, 0.005), 0.5, 3.6, rng), 1.4, 20.0, setting.NO_ADDED_MASS
        )
        for time, command, angle in zip(log.time, log.input, log.angle, strict=True):
            online.observe(Reading(time + offset, angle, math.nan), command)
        found = online.parameters(TRUE.p1)
        assert found.p2 == pytest.approx(spec.robot.lumped.p2, rel=0.05)
