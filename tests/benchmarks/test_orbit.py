"""The figures of docs/orbit.md: 24 draws and all effects (run with -s to see them)."""

import math
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from butterfly.identification.test_functions import Balance
from butterfly.orbit.loop import calibrate, study_orbit
from butterfly.orbit.recalibration import RecalibrationOptions, recalibrate
from tests.benchmarks.bars import SHORT, at_least, at_most
from tests.orbit.setting import (
    AGAINST_COULOMB,
    EFFECTS,
    KNOWN,
    generic,
    plant,
    runs,
    sixty_degrees,
    wrong,
)

DRAWS = 4 if SHORT else 24
ROUGH = plant({"coulomb": 4e-4})
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
    logs = runs(ROUGH, rng)
    both = [*logs, *runs(ROUGH, rng, masses=(KNOWN,))]
    found = [recalibrate(logs, 0.0, RecalibrationOptions(balance=each)) for each in Balance]
    cases = [(found[0], TRUE.p1), (found[1], TRUE.p1), (recalibrate(both, 0.0), 1.0)]
    return [
        {
            name: 100 * (value * scale / getattr(TRUE, name) - 1) if name in EXPECTED else None
            for name, value in zip(found.estimate.names, found.estimate.values, strict=True)
        }
        for found, scale in cases
    ]


def test_errors_over_random_draws():
    with ProcessPoolExecutor() as pool:
        draws = list(pool.map(_errors, range(DRAWS)))
    for (title, limits), found in zip(ERRORS.items(), zip(*draws, strict=True), strict=True):
        names = [name for name in EXPECTED if name in found[0]]
        rms = {name: math.sqrt(np.mean([each[name] ** 2 for each in found])) for name in names}
        spurious = sum(None in each.values() for each in found)
        print(f"\n{title}, rms error in %:", {n: round(value, 4) for n, value in rms.items()})
        print(f"a term that is not there accepted in {spurious} of {DRAWS} draws")
        at_most(spurious, DRAWS / 8, f"{title}, draws with a term that is not there")
        for name, limit in limits.items():
            at_most(rms[name], limit, f"{title}, rms error of {name} in %")


def _effect(name):
    spec, amplitudes, told = EFFECTS[name]
    rng = np.random.default_rng(0)
    study = study_orbit(
        partial(spec.rig.run, rng=rng),
        generic(spec, amplitudes),
        0.0,
        sixty_degrees(),
        RecalibrationOptions(**told),
        rng=rng,
    )
    swings = [f"{math.degrees(each.amplitude):.2f}" for each in study.calibration.rounds]
    before, after = (math.degrees(error) for error in study.errors.values())
    terms = study.calibration.rounds[-1].recalibration.estimate.names
    ratio = before / after
    return (
        ratio,
        f"{name:28} {', '.join(swings):28} {before:8.3f} {after:8.4f} {ratio:6.0f} {terms}",
    )


def test_free_run_errors_for_every_effect():
    print(
        "\neffect, swings in degrees, rms free-run error in degrees before and after, ratio, terms"
    )
    with ProcessPoolExecutor() as pool:
        chosen = list(EFFECTS)[1:4] if SHORT else list(EFFECTS)
        for name, (ratio, line) in zip(chosen, pool.map(_effect, chosen), strict=True):
            print(line)
            at_least(ratio, BETTER[name], name)


def _swings(seed):
    """Swings in degrees of the loop in MuJoCo, from a small-swing model and from a wrong one."""
    rng = np.random.default_rng(seed)
    rig = partial(ROUGH.rig.run, rng=rng)
    loops = [
        calibrate(rig, believed, 0.0, sixty_degrees(duration=20.0), rng=rng)
        for believed in (generic(ROUGH, AGAINST_COULOMB), wrong(TRUE, rng))
    ]
    lowest = min(each.recalibration.estimate.values.min() for loop in loops for each in loop.rounds)
    assert lowest >= 0
    return [[round(math.degrees(each.amplitude), 2) for each in loop.rounds] for loop in loops]


def test_the_loop_over_random_draws():
    with ProcessPoolExecutor() as pool:
        swings = list(pool.map(_swings, range(DRAWS)))
    for title, loops in zip(
        ("small swings", "10-30 % wrong"), zip(*swings, strict=True), strict=True
    ):
        last = [each[-1] for each in loops]
        print(
            f"\nfrom {title}: first {min(e[0] for e in loops)}..{max(e[0] for e in loops)}, "
            f"last {min(last)}..{max(last)}, rounds at most {max(map(len, loops))}"
        )
        at_most(max(abs(each - 60) for each in last), 0.2, f"{title}, degrees off 60")
        at_most(max(map(len, loops)), 4, f"{title}, rounds")
