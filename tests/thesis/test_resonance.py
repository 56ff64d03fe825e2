"""The resonance of complex responses, against its closed form and the Cramer-Rao bound."""

import numpy as np
import pytest

from butterfly.identification.estimators import Linear
from butterfly.model.linear import LinearJoint, resonance_frequency
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.thesis.tables import complex_resonance
from tests.identification.simulated import response

THESIS = LumpedParameters(p1=0.00325, p2=0.001, p3=0.04905, p4=10)
MASSES = [AddedMass(mass=0.05 * k, arm=0.005 * k) for k in range(5)]
OMEGAS = np.arange(1, 7.01, 0.5)
AMPLITUDE = 1e-5
NOISE = 2e-5  # of each phasor component: 1 mrad in 45 s of samples every 0.01 s
RUNS = 300


def _points(mass, rng=None, noise=NOISE):
    exact = LinearJoint.of(THESIS.with_added_mass(mass)).response(OMEGAS) * AMPLITUDE
    real, imaginary = (0, 0) if rng is None else noise * rng.standard_normal((2, OMEGAS.size))
    return [
        response(mass, float(w), phasor, input_=AMPLITUDE, error=max(noise, 1e-12))
        for w, phasor in zip(OMEGAS, exact + real + 1j * imaginary, strict=True)
    ]


def _bound(mass):
    """Cramer-Rao bound of the resonance frequency, from the exact responses."""
    loaded = THESIS.with_added_mass(mass)
    a1, a0, b0 = loaded.p2 / loaded.p1, loaded.p3 / loaded.p1, loaded.p4 / loaded.p1
    denominator = a0 - OMEGAS**2 + 1j * OMEGAS * a1
    response = b0 / denominator
    columns = [-1j * OMEGAS * response / denominator, -response / denominator, 1 / denominator]
    jacobian = AMPLITUDE * np.column_stack(columns)
    real = np.concatenate([jacobian.real, jacobian.imag])
    covariance = NOISE**2 * np.linalg.inv(real.T @ real)
    peak = np.sqrt(a0 - a1**2 / 2)
    gradient = np.array([-a1 / 2, 0.5, 0.0]) / peak
    return np.sqrt(gradient @ covariance @ gradient)


@pytest.mark.parametrize("mass", MASSES[::2])
def test_exact_responses_give_the_exact_resonance(mass):
    true = resonance_frequency(THESIS.with_added_mass(mass))
    assert complex_resonance(_points(mass, noise=0.0)) == pytest.approx(true, rel=1e-8)


@pytest.mark.slow
def test_the_complex_fit_comes_near_the_cramer_rao_bound():
    rng, squares = np.random.default_rng(1), []
    for mass in MASSES:
        true = resonance_frequency(THESIS.with_added_mass(mass))
        found = [complex_resonance(_points(mass, rng)) for _ in range(RUNS)]
        squares.append(np.mean((np.array(found) - true) ** 2))
    assert np.sqrt(np.mean(squares) / np.mean([_bound(mass) ** 2 for mass in MASSES])) < 1.3


@pytest.mark.slow
def test_the_joint_linear_fit_reaches_the_bound_and_its_intervals_cover():
    rng = np.random.default_rng(2)
    truth = np.array([THESIS.p1, THESIS.p2, THESIS.p3, THESIS.p4])

    def responses(values):
        p = LumpedParameters(**dict(zip(("p1", "p2", "p3", "p4"), values, strict=True)))
        loaded = [p.with_added_mass(m) for m in MASSES]
        parts = [LinearJoint.of(each).response(OMEGAS) * AMPLITUDE for each in loaded]
        flat = np.concatenate(parts)
        return np.concatenate([flat.real, flat.imag])

    steps = np.diag(1e-6 * truth)
    jacobian = np.column_stack(
        [(responses(truth + h) - responses(truth - h)) / (2 * h.sum()) for h in steps]
    )
    bound = NOISE * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    fits = [Linear().of_points([p for m in MASSES for p in _points(m, rng)]) for _ in range(RUNS)]
    errors = np.array([fit.values - truth for fit in fits])
    assert np.all(np.sqrt(np.mean(errors**2, axis=0)) < 1.1 * bound)
    inside = np.mean([(f.lower <= truth) & (truth <= f.upper) for f in fits], axis=0)
    assert np.all((inside > 0.92) & (inside < 0.99))
