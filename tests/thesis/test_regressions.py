"""(82) to (90) against exact data, the parabola they assume, and errors with latent abscissae."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import curve_fit, least_squares

from butterfly.cli.commands import thesis_robot
from butterfly.errors import InputError
from butterfly.model.parameters import AddedMass
from butterfly.thesis.figures import regression_figure, resonance_figure
from butterfly.thesis.method import WEIGHTS, between, by_100, largest, parabola, regression
from butterfly.thesis.tables import TABLE_1_PRINTED, Row

MASSES = [AddedMass(mass=0.05 * k, arm=0.1) for k in range(1, 6)]
Z = np.array([mass.inertia for mass in MASSES])
X = np.array([mass.gravity_moment for mass in MASSES])
peaks = st.floats(2, 9)
shares = st.floats(0.05, 0.95)


@given(peaks, shares, st.floats(0.1, 1), st.floats(0.01, 10))
def test_where_the_square_of_the_gain_is_a_parabola_89_and_the_mended_90_are_exact(w, at, h, top):
    omega = w + h * (np.arange(-2, 3) + at)
    bend = 0.9 * top / np.max(np.abs(omega**2 - w**2)) ** 2
    gain = np.sqrt(top - bend * (omega**2 - w**2) ** 2)
    assert parabola(omega, gain, bend) == pytest.approx(w, rel=1e-9)
    x = np.sort(omega[np.argsort(gain)[-2:]])
    if x[0] < w < x[1]:
        mended = between(omega, gain, lambda g: np.sqrt(np.maximum(top - g**2, 0)))
        assert mended == pytest.approx(w, rel=1e-6)


@given(peaks, shares, st.floats(0.05, 1))
def test_a_pendulum_s_resonance_is_exactly_between_the_gains_beside_it(w, at, damping):
    a0 = w**2 + damping**2 / 2
    x = np.array([(1 - 0.1 * at) * w**2, (1.1 - 0.1 * at) * w**2])
    gain, top = (1 / np.sqrt((a0 - y) ** 2 + damping**2 * y) for y in (x, w**2))
    found = between(np.sqrt(x), gain, lambda g: np.sqrt(np.maximum(g**-2 - top**-2, 0)))
    assert found == pytest.approx(w, rel=1e-6)


def test_100_weighs_each_square_with_the_other_gain_over_the_largest():
    alpha, beta = np.sqrt((33 / 44) ** 2 + 1), np.sqrt(2)
    right = np.sqrt((alpha * 4.0**2 + beta * 3.5**2) / (alpha + beta))
    found = by_100(np.array([3.5, 4.0, 4.5]), np.array([33.0, 44.0, 30.0]))
    assert found == pytest.approx(right, rel=1e-12)


def test_the_largest_gains_come_in_their_order_and_two_are_needed():
    omega, gain = largest(np.array([1.0, 2.0, 3.0]), np.array([5.0, 9.0, 7.0]))
    assert omega.tolist() == [2, 3]
    assert gain.tolist() == [9, 7]
    with pytest.raises(InputError, match="2 or more"):
        largest(np.ones(1), np.ones(1))


@pytest.mark.parametrize("weight", WEIGHTS.values(), ids=WEIGHTS)
@given(p1=st.floats(1e-3, 1e-2), p3=st.floats(1e-3, 0.2))
def test_exact_resonances_give_p1_and_p3_exactly(weight, p1, p3):
    found = regression((p3 + X) / (p1 + Z), MASSES, weight)
    np.testing.assert_allclose(found, [p1, p3], rtol=1e-6)


def _noisy(seed=3, error=0.5):
    return (0.05 + X) / (0.003 + Z) + error * np.random.default_rng(seed).standard_normal(5)


def test_82_is_scipy_s_nonlinear_fit():
    squares = _noisy()
    model = lambda _, p1, p3: (p3 + X) / (p1 + Z)  # noqa: E731
    right, _ = curve_fit(model, Z, squares, [0.003, 0.05], ftol=1e-14)
    found = regression(squares, MASSES, WEIGHTS["(82) nonlinear"])
    np.testing.assert_allclose(found, right, rtol=1e-5)


def test_orthogonal_distances_are_those_with_the_true_abscissae_as_unknowns():
    """As ODRPACK does: y = p3 + p1 x, with x = -Y off by 1 and y = Z Y - X off by Z."""
    squares = _noisy()

    def errors(unknown):
        true = unknown[2:]
        line = unknown[1] * 1e-2 + unknown[0] * 1e-3 * true
        return np.concatenate([-squares - true, (Z * squares - X - line) / Z])

    start = [3, 5, *-squares]
    right = least_squares(errors, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x[:2] * [1e-3, 1e-2]
    found = regression(squares, MASSES, WEIGHTS["(84) orthogonal distance"])
    np.testing.assert_allclose(found, right, rtol=1e-5)


def test_the_figures_say_what_is_biased_and_what_is_not():
    corrected = "3.8783 3.9740 4.2434 4.6491 5.1441"
    row = Row(what="", published=TABLE_1_PRINTED[1], obtained="", corrected=corrected)
    synthetic = thesis_robot()
    resonance, p1 = resonance_figure(synthetic.rig.robot.lumped), regression_figure(synthetic, row)
    assert [claim.holds for claim in resonance.claims] == [True, False]
    assert all(claim.holds for claim in p1.claims)
    assert p1.marks["(100)"] == pytest.approx(0.166, abs=1e-3)
    errors, biases = p1.curves["(84) linear"][1].values()
    rise = np.diff(np.log(biases[:4])) / np.diff(np.log(errors[:4]))
    assert np.mean(rise) == pytest.approx(2, abs=0.3)  # as the square of the errors
