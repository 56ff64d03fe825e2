"""(118): exact where its assumptions hold, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.thesis.figures import AMPLITUDE, ClosedLoop, cases_figure, scale_figure
from tests.independent.integrator import Joint, motion
from tests.thesis.test_resonance import THESIS


@pytest.fixture(scope="module")
def exact():
    return ClosedLoop.of(THESIS, THESIS)


def test_the_loop_moves_as_an_independent_integrator_says_from_its_recorded_input(exact):
    log = exact.log.take(exact.log.time < 8)
    joint = Joint(inertia=THESIS.p1, viscous=THESIS.p2, gravity=THESIS.p3, gain=THESIS.p4)
    held = np.append((log.input[:-1] + log.input[1:]) / 2, 0.0)
    angle, _ = motion(joint, log.time, held, float(log.angle[0]))
    np.testing.assert_allclose(log.angle, angle, atol=1e-5)  # the held input


def test_the_loop_settles_on_its_orbit(exact):
    late = exact.log.angle[exact.log.time > exact.log.time[-1] - exact.period]
    assert np.abs(late).max() == pytest.approx(AMPLITUDE, rel=1e-3)


@pytest.mark.parametrize(("p3", "p4"), [(0.8, 0.6), (1.3, 2.0)])
def test_without_noise_p3_and_p4_are_found_under_an_exact_controller(exact, p3, p4):
    found = exact.fitted(replace(THESIS, p3=p3 * THESIS.p3, p4=p4 * THESIS.p4))
    assert found.p3 == pytest.approx(THESIS.p3, rel=1e-3)
    assert found.p4 == pytest.approx(THESIS.p4, rel=1e-3)


def test_p2_is_not_in_it_and_a_factor_on_p1_and_p3_is_a_factor_on_its_residuals():
    loop = ClosedLoop.of(THESIS, THESIS, 1e-3)
    values = replace(THESIS, p3=0.06)
    scaled = replace(values, p1=0.3 * values.p1, p3=0.3 * values.p3, p2=7 * values.p2)
    np.testing.assert_allclose(loop.residuals(scaled), 0.3 * loop.residuals(values), rtol=1e-9)


def test_another_controller_takes_p4_away_but_the_energy_balance_finds_all():
    loop = ClosedLoop.of(THESIS, replace(THESIS, p2=0.0))
    assert loop.fitted(THESIS).p4 < 1e-3 * THESIS.p4
    found = loop.balanced(THESIS.p1)
    for name in ("p2", "p3", "p4"):
        assert getattr(found, name) == pytest.approx(getattr(THESIS, name), rel=1e-3)


def test_the_figures_say_so():
    assert [claim.holds for claim in scale_figure(THESIS).claims] == [True, True, False]
    assert [claim.holds for claim in cases_figure(THESIS).claims] == [True, False, True]
