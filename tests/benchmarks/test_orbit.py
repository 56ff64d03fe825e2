"""The figures of docs/orbit.md: 24 draws and all effects (run with -s to see them)."""

import math
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from butterfly.identification.test_functions import Balance
from butterfly.orbit.loop import calibrate, study_orbit
from butterfly.orbit.recalibration import RecalibrationOptions, recalibrate
from tests.benchmarks.bars import SHORT
from tests.orbit import setting

DRAWS = 4 if SHORT else 24
ROUGH = setting.plant({"coulomb": 4e-4})
TRUE = ROUGH.robot.lumped
EXPECTED = ("p1", "p2", "p3", "p4", "coulomb")

ERRORS = {
    "weak form, ratios": {"p2": 0.05, "p3": 0.01, "p4": 0.06, "coulomb": 0.5},
    "energy balance, ratios": {"p2": 0.06, "p3": 0.01, "p4": 0.06, "coulomb": 0.6},
    "weak form, known mass": {"p1": 0.05, "p2": 0.05, "p3": 0.05, "p4": 0.05, "coulomb": 0.5},
}
"""Largest rms errors in %."""

BETTER = {
    "none": 4,
    "Coulomb": 500,
    "quadratic drag": 600,
    "gain compression": 130,
    "Stribeck": 350,
    "bias": 50,
    "offset of the centre of mass": 100,
    "cogging, 7 periods a turn": 15,
    "the same, told of cogging": 800,
}
"""Least ratios of free-run errors, small-swing model over re-calibrated one."""


def _errors(seed):
    """Relative errors in per cent of one draw: ratios by both balances, and absolute values."""
    rng = np.random.default_rng(seed)
    logs = setting.runs(ROUGH, rng)
    both = [*logs, *setting.runs(ROUGH, rng, masses=(setting.KNOWN,))]
    found = [recalibrate(logs, 0.0, RecalibrationOptions(balance=each)) for each in Balance]
    cases = [(found[0], TRUE.p1), (found[1], TRUE.p1), (recalibrate(both, 0.0), 1.0)]
    return [
        {
            name: 100 * (value * scale / getattr(TRUE, name) - 1) if name in EXPECTED else None
            for name, value in zip(found.estimate.names, found.estimate.values, strict=True)
        }
        for found, scale in cases
    ]


def _held(seed):
    """Whether the intervals from MuJoCo's logs hold each ratio."""
    rng, plan = np.random.default_rng(seed), setting.sixty_degrees(rounds=2)
    rig, believed = partial(ROUGH.rig.run, rng=rng), setting.wrong(TRUE, rng)
    plants = ROUGH.rig.rough_and_fine(seed)
    found = calibrate(rig, believed, 0.0, plan, plants=plants, rng=rng)
    ratios = {name: getattr(TRUE, name) / TRUE.p1 for name in EXPECTED}
    rows = found.rounds[-1].recalibration.estimate.table(ratios)
    return {row.name: row.lower <= row.true <= row.upper for row in rows}


def test_in_mujoco_the_intervals_hold_each_ratio_as_often_as_they_should():
    with ProcessPoolExecutor() as pool:
        held = list(pool.map(_held, range(DRAWS)))
    shares = {name: np.mean([each[name] for each in held]) for name in EXPECTED[1:]}
    print("\nshare of draws in MuJoCo whose interval holds the ratio:", shares)
    assert min(shares.values()) >= 0.85


def test_errors_over_random_draws():
    with ProcessPoolExecutor() as pool:
        draws = list(pool.map(_errors, range(DRAWS)))
    for (title, limits), found in zip(ERRORS.items(), zip(*draws, strict=True), strict=True):
        rms = {name: math.sqrt(np.mean([each[name] ** 2 for each in found])) for name in limits}
        spurious = sum(None in each.values() for each in found)
        print(f"\n{title}, rms error in %:", {n: round(value, 4) for n, value in rms.items()})
        print(f"a term that is not there accepted in {spurious} of {DRAWS} draws")
        assert spurious <= DRAWS / 8, title
        assert [name for name in limits if not rms[name] <= limits[name]] == [], (title, rms)


def _effect(name):
    """Free-run errors in degrees before and after, swings, and terms of the last round."""
    spec, amplitudes, told = setting.EFFECTS[name]
    rng = np.random.default_rng(0)
    rig, small = partial(spec.rig.run, rng=rng), setting.generic(spec, amplitudes)
    plan = setting.sixty_degrees(recalibration=RecalibrationOptions(**told))
    study = study_orbit(rig, small, 0.0, plan, rng=rng)
    rounds = study.calibration.rounds
    swings = [round(math.degrees(each.reached), 2) for each in rounds]
    errors = map(math.degrees, study.errors.values())
    return (*errors, swings, rounds[-1].recalibration.estimate.names)


def test_free_run_errors_for_every_effect():
    chosen = list(setting.EFFECTS)[1:3] if SHORT else list(setting.EFFECTS)
    with ProcessPoolExecutor() as pool:
        found = dict(zip(chosen, pool.map(_effect, chosen), strict=True))
    for name, (before, after, swings, terms) in found.items():
        print(f"\n{name}: free-run error {before:.3f}, {after:.4f} degrees; {swings}; {terms}")
    ratios = {name: before / after for name, (before, after, *_) in found.items()}
    assert {name: each for name, each in ratios.items() if not each >= BETTER[name]} == {}


def _swings(seed):
    """Swings in degrees of the loop in MuJoCo, from a small-swing model and from a wrong one."""
    rng = np.random.default_rng(seed)
    rig = partial(ROUGH.rig.run, rng=rng)
    loops = [
        calibrate(rig, believed, 0.0, setting.sixty_degrees(duration=20.0), rng=rng)
        for believed in (setting.generic(ROUGH, setting.AGAINST_COULOMB), setting.wrong(TRUE, rng))
    ]
    lowest = min(each.recalibration.estimate.values.min() for loop in loops for each in loop.rounds)
    assert lowest >= 0
    return [[round(math.degrees(each.reached), 2) for each in loop.rounds] for loop in loops]


def test_the_loop_over_random_draws():
    with ProcessPoolExecutor() as pool:
        small, wrongly = zip(*pool.map(_swings, range(2 if SHORT else DRAWS)), strict=True)
    for title, loops in (("small swings", small), ("10-30 % wrong", wrongly)):
        print(f"\nfrom {title}, swings in degrees of each loop's rounds:", *loops)
        assert max(abs(each[-1] - 60) for each in loops) <= 0.2, (title, loops)
        assert max(map(len, loops)) <= 4, (title, loops)
