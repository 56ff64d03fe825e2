from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import quad

from butterfly.model.greybox import simulate
from butterfly.model.kinematics import (
    coulomb_describing_function,
    drag_describing_function,
    gravity_describing_function,
    stribeck_describing_function,
)
from butterfly.model.linear import (
    frequency_response,
    predicted_swing,
    quasi_linear_response,
    resonance_frequency,
)
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.signals.sine_fit import fit_sine

THESIS = LumpedParameters(p1=0.00325, p2=0.001, p3=0.04905, p4=10)


def _fundamental(function, amplitude):
    """Sine and cosine part of the first Fourier coefficient of function(a sin t, a cos t)."""

    def part(weight):
        def integrand(t):
            return function(amplitude * np.sin(t), amplitude * np.cos(t)) * weight(t)

        return quad(integrand, -np.pi, np.pi, points=[-np.pi / 2, np.pi / 2])[0] / np.pi

    return part(np.sin), part(np.cos)


@given(st.floats(1e-3, 3.0))
def test_gravity_describing_function_is_the_fourier_integral(amplitude):
    sine, cosine = _fundamental(lambda angle, _: np.sin(angle), amplitude)
    assert gravity_describing_function(amplitude) * amplitude == pytest.approx(sine, rel=1e-9)
    assert cosine == pytest.approx(0, abs=1e-12)


@given(st.floats(1e-3, 3.0))
def test_coulomb_describing_function_is_the_fourier_integral(amplitude):
    sine, cosine = _fundamental(lambda _, velocity: np.sign(velocity), amplitude)
    gain = complex(coulomb_describing_function(amplitude))
    assert sine == pytest.approx(0, abs=1e-9)
    assert gain == pytest.approx(1j * cosine / amplitude, rel=1e-8)


@given(amplitude=st.floats(1e-3, 3.0), omega=st.floats(0.5, 20.0), scale=st.floats(0.05, 5.0))
def test_drag_and_stribeck_describing_functions_are_the_fourier_integrals(amplitude, omega, scale):
    assume(amplitude * omega / scale < 20)  # else the quadrature misses the peak
    sine, cosine = _fundamental(lambda _, v: omega**2 * abs(v) * v, amplitude)
    assert sine == pytest.approx(0, abs=1e-9)
    gain = complex(drag_describing_function(omega, amplitude))
    assert gain == pytest.approx(1j * cosine / amplitude, rel=1e-8)
    _, cosine = _fundamental(
        lambda _, v: np.sign(v) * np.exp(-((omega * v / scale) ** 2)), amplitude
    )
    gain = complex(stribeck_describing_function(omega, amplitude, scale))
    assert gain == pytest.approx(1j * cosine / amplitude, rel=1e-6)


def test_the_linearisation_has_the_published_coefficients_63():
    assert THESIS.p2 / THESIS.p1 == pytest.approx(0.308, abs=5e-4)
    assert THESIS.p3 / THESIS.p1 == pytest.approx(15.09, abs=5e-3)
    assert THESIS.p4 / THESIS.p1 == pytest.approx(3076.9, abs=0.05)


def test_frequency_response_agrees_with_python_control():
    omega = np.geomspace(0.1, 100, 50)
    system = control.tf([THESIS.p4], [THESIS.p1, THESIS.p2, THESIS.p3])
    np.testing.assert_allclose(frequency_response(THESIS, omega), system(1j * omega), rtol=1e-12)


def test_the_quasi_linear_response_tends_to_the_linear_one():
    omega = np.array([1.0, 3.9, 9.0])
    small = quasi_linear_response(THESIS, omega, np.full(3, 1e-5))
    np.testing.assert_allclose(small, frequency_response(THESIS, omega), rtol=1e-8)


def test_resonances_are_those_of_table_1_with_the_added_mass_counted_once():
    masses = [AddedMass(mass=0.05 * k, arm=0.005 * k) for k in range(5)]
    found = [resonance_frequency(THESIS.with_added_mass(mass)) for mass in masses]
    np.testing.assert_allclose(found, [3.8788, 3.9741, 4.2436, 4.6489, 5.1447], atol=5e-5)


@given(p2=st.floats(1e-5, 0.02), p3=st.floats(0.01, 0.1))
def test_the_resonance_is_where_the_gain_peaks(p2, p3):
    parameters = LumpedParameters(p1=0.003, p2=p2, p3=p3, p4=1)
    peak = resonance_frequency(parameters)
    near = np.array([0.99, 1.0, 1.01]) * peak
    gains = np.abs(frequency_response(parameters, near))
    assert peak == 0 or gains[1] >= gains.max() * (1 - 1e-12)


@pytest.mark.parametrize(("omega", "amplitude"), [(2.0, 0.2), (3.5, 0.15), (6.0, 0.3), (9.0, 0.5)])
@pytest.mark.parametrize("coulomb", [0.0, 5e-4])
def test_the_predicted_swing_is_the_simulated_one(omega, amplitude, coulomb):
    joint = LumpedParameters(p1=0.00325, p2=0.0014, p3=0.04905, p4=0.025, coulomb=coulomb)
    time = np.arange(0, 80, 5e-3)
    instants = np.column_stack([time[:-1], time[:-1] + 2.5e-3, time[1:]])
    angle, _ = simulate(joint, time, amplitude * np.sin(omega * instants), 0.0)
    steady = fit_sine(time[time > 60], angle[time > 60], omega)
    assert predicted_swing(joint, omega, amplitude) == pytest.approx(steady.amplitude, rel=0.03)


def test_the_predicted_swing_knows_drag_stribeck_and_cogging():
    parameters = replace(
        THESIS,
        p4=0.025,
        coulomb=3e-4,
        drag=5e-4,
        stribeck=3e-4,
        stribeck_velocity=0.5,
        cogging=2e-3,
        cogging_periods=3,
    )
    time = np.arange(0, 60, 2e-3)
    inputs = 0.3 * np.sin(4 * np.column_stack([time[:-1], time[:-1] + 1e-3, time[1:]]))
    angle, _ = simulate(parameters, time, inputs, 0.0)
    steady = time > 60 - 8 * np.pi
    swing = fit_sine(time[steady], angle[steady], 4.0).amplitude
    assert predicted_swing(parameters, 4.0, 0.3) == pytest.approx(swing, rel=0.02)
    plain = predicted_swing(replace(THESIS, p4=0.025, coulomb=3e-4), 4.0, 0.3)
    assert abs(plain / swing - 1) > 0.1


def test_a_drive_that_friction_holds_is_predicted_not_to_swing():
    joint = LumpedParameters(p1=0.003, p2=0.001, p3=0.05, p4=0.025, coulomb=0.01)
    assert predicted_swing(joint, 3.0, 0.2) == 0.0


def test_a_drive_beyond_all_balance_is_predicted_to_swing_without_bound():
    joint = LumpedParameters(p1=0.003, p2=0.001, p3=0.05, p4=0.025)
    assert predicted_swing(joint, 1.0, 100.0) == np.inf
