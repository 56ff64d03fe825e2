"""Benches with a defect: the answer holds what is true, and what itself says besides."""

from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import pytest

import butterfly as bf
from butterfly.identification.agreement import (
    Condition,
    differing_values,
    from_log_to_log,
)
from butterfly.identification.estimators import OutputError
from butterfly.identification.trust import FindingKind
from butterfly.model.terms import RARE
from tests.identification.simulated import cells
from tests.independent.defects import draw

AGAIN = partial(pytest.param, marks=pytest.mark.slow)
"""The same claim of another robot."""


FEW = {"clock", "control", "falling friction", "level", "own inertia"}
"""Defects that two logs with each mass show."""


@lru_cache
def _found(row, number, seed=941):
    robot = draw(row, number, seed)
    logs = robot.few_logs if row in FEW else robot.logs
    found = bf.identify(logs, OutputError(workers=1)).estimate
    limits = zip(found.names, found.lower, found.upper, strict=True)
    return robot.truth, found, {name: pair for name, *pair in limits}


def test_friction_that_falls_in_each_log_is_known_as_far_as_it_is_said_to_fall():
    truth, found, limits = _found("falling friction", 7)
    (contrast,) = [c for c in found.agreement if c.condition is Condition.TIME and c.share > 0.5]
    lower, upper = limits[contrast.parameter]
    assert lower < truth[contrast.parameter] < upper
    assert contrast.last < truth[contrast.parameter] < contrast.first
    assert upper - lower > contrast.first - contrast.last


def _rival_scales(found):
    alike = [each for each in found.findings if each.kind is FindingKind.LIKE_SCALE]
    return {name for each in alike for name in each.parameters[1:]}


@pytest.mark.parametrize("number", [2, AGAIN(5)])  # chirps, on stamps that are short, and long
def test_stamps_that_are_off_by_a_share_are_a_rival_of_what_masses_show(number):
    truth, found, limits = _found("clock", number)
    assert "time_scale" in _rival_scales(found)
    for name in ("p1", "p2", "p3", "p4", "coulomb"):
        lower, upper = limits[name]
        assert lower <= truth[name] <= upper, name


@pytest.mark.parametrize(("row", "scale"), [("level", "gravity_scale"), ("arm", "arm")])
def test_a_bench_out_of_level_and_arms_told_wrong_are_rivals_of_what_masses_show(row, scale):
    truth, found, limits = _found(row, 1, 643)
    assert scale in _rival_scales(found)
    assert "time_scale" not in _rival_scales(found)  # sines of known frequency show the clock
    for name in ("p1", "p2", "p3", "p4", "coulomb"):
        lower, upper = limits[name]
        assert lower <= truth[name] <= upper, name
        assert upper - lower < 0.03 * truth[name]


def test_arms_that_are_measured_are_no_rival_and_what_no_bench_is_off_by_neither():
    logs = draw("arm", 1, 643).logs
    masses = [replace(log.added_mass, arm_uncertainty=1e-5) for log in logs]
    measured = [replace(log, added_mass=mass) for log, mass in zip(logs, masses, strict=True)]
    found = bf.identify(measured, OutputError(workers=1)).estimate
    assert "mass_inertia" in found.names
    assert not _rival_scales(found)
    _, own, _ = _found("own inertia", 1, 643)
    assert own.named["mass_inertia"] == pytest.approx(0.05, rel=0.01)
    assert not _rival_scales(own)


def test_a_cable_that_pulls_like_a_spring_is_no_bias():
    truth, found, limits = _found("spring", 1)
    assert "spring" in found.names
    lower, upper = limits["p3"]
    assert lower <= truth["p3"] <= upper < lower + 0.05 * truth["p3"]


@pytest.mark.parametrize("number", [5, AGAIN(18)])
def test_a_cable_of_which_a_bias_alone_is_fitted_is_a_rival_of_the_gravity_moment(number):
    truth, found, limits = _found("spring", number, 1)
    assert "bias" in found.names
    assert "spring" not in found.names
    (like,) = [each for each in found.findings if each.kind is FindingKind.LIKE_TERM]
    assert like.parameters[:2] == ("spring", "p3")
    for name in ("p1", "p3", "p4"):
        lower, upper = limits[name]
        assert lower <= truth[name] <= upper, name


def test_a_spring_is_no_rival_where_no_bias_is_fitted():
    _, found, _ = _found("own inertia", 1, 643)
    assert FindingKind.LIKE_TERM not in {each.kind for each in found.findings}


@pytest.mark.parametrize("number", [0, AGAIN(3), AGAIN(4)])
def test_an_encoder_off_its_centre_is_seen_and_its_scale_is_in_the_gain(number):
    truth, found, limits = _found("eccentric", number, 643)
    (off,) = [each for each in found.findings if each.kind is FindingKind.OFF_CENTRE]
    assert np.degrees(off.number) == pytest.approx(0.5, rel=0.25)
    for name in ("p1", "p2", "p3", "p4", "coulomb"):
        lower, upper = limits[name]
        assert lower <= truth[name] <= upper, name
    lower, upper = limits["p4"]
    assert upper - lower < 0.02 * truth["p4"]


@pytest.mark.parametrize(
    ("row", "number"), [("control", 0), AGAIN("backlash", 2), AGAIN("spring", 1)]
)
def test_no_other_defect_is_an_encoder_off_its_centre(row, number):
    found = _found(row, number, 643)[1]
    assert FindingKind.OFF_CENTRE not in {each.kind for each in found.findings}


def test_a_misfit_that_a_saturation_leaves_widens_friction_and_not_the_inertia():
    truth, found, limits = _found("saturation", 54, 1)
    widths = found.relative_half_widths
    assert widths["p1"] < 0.002
    assert widths["p2"] > 0.01  # 0.2 % by the equations alone
    assert widths["coulomb"] > 0.03  # 2.6 %
    for name in ("p1", "p2", "p3", "coulomb"):
        assert limits[name][0] <= truth[name] <= limits[name][1], name


GIVING = "base, friction by log, regimes", 35, 9101


def test_a_base_and_regimes_are_found_beside_friction_that_differs_by_a_fifth():
    truth, found, limits = _found(*GIVING)
    assert {"base_compliance", "slow_delay"} <= limits.keys()
    for name in ("p1", "p3", "coulomb", "delay"):
        lower, upper = limits[name]
        assert lower <= truth[name] <= upper, name
    value, (lower, upper) = found.parameters.p1, limits["p1"]
    assert value == pytest.approx(truth["p1"], rel=1e-4)  # 1.1 % where the base is not found
    assert upper - lower < 1e-3 * value


def test_the_gain_found_beside_a_base_regimes_and_scatter_is_in_its_interval():
    truth, found, limits = _found(*GIVING)
    assert found.parameters.p4 == pytest.approx(truth["p4"], rel=1e-4)
    lower, upper = limits["p4"]
    assert lower <= truth["p4"] <= upper


@pytest.mark.slow
def test_friction_that_differs_alone_is_no_rarer_term():
    truth, _, limits = _found("friction by log", 5, 9101)
    assert limits.keys().isdisjoint(RARE)
    lower, upper = limits["p1"]
    assert lower <= truth["p1"] <= upper


def test_what_the_logs_cannot_tell_of_each_is_said_to_differ_from_none():
    """Two of three unknowns do the same in all logs but for a share of a millionth."""
    random, logs = np.random.default_rng(3), np.arange(8)
    rows = random.standard_normal((8, 30, 3))
    rows[:, :, 1] = rows[:, :, 2] * logs[:, None] + 1e-6 * rows[:, :, 1]
    residuals = 1e-3 * random.standard_normal((8, 30)) + rows[:, :, 2] * logs[:, None] ** 2
    equations = cells(("p1", "p3", "p2"), rows, residuals, values=np.ones(3))
    assert not list(from_log_to_log(equations))
    assert differing_values(equations, "p2") is None


@pytest.mark.parametrize("number", [0, AGAIN(11)])
def test_a_base_is_told_from_an_inertia_of_the_masses_by_fits_of_both(number):
    """One step favours the inertia; fitted, it leaves two to three times the noise."""
    robot = draw("base", number, 1017)
    found = bf.identify(robot.few_logs)
    assert "base_compliance" in found.estimate.names
    for name in ("p1", "p3", "p4"):
        assert found.estimate.named[name] == pytest.approx(robot.truth[name], rel=2e-3), name
