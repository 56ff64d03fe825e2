"""Resonance estimators on the thesis's setting, against closed forms and the Cramer-Rao bound."""

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.identification.estimators import Linear
from butterfly.model.linear import Linearisation, resonance_frequency
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.thesis.tables import complex_fit
from tests.identification.simulated import response
from tests.thesis.resonance_formulas import (
    of_responses,
    parabola,
    three_point,
    two_largest,
)

THESIS = LumpedParameters(p1=0.00325, p2=0.001, p3=0.04905, p4=10)
MASSES = [AddedMass(mass=0.05 * k, arm=0.005 * k) for k in range(5)]
OMEGAS = np.arange(1, 7.01, 0.5)
AMPLITUDE = 1e-5
NOISE = 2e-5  # of each phasor component: 1 mrad in 45 s of samples every 0.01 s
RUNS = 300


def _points(mass, rng=None, noise=NOISE, omegas=OMEGAS):
    exact = Linearisation.of(THESIS.with_added_mass(mass)).response(omegas) * AMPLITUDE
    error = (
        np.zeros((2, omegas.size)) if rng is None else noise * rng.standard_normal((2, omegas.size))
    )
    return [
        response(mass, float(w), phasor, input_=AMPLITUDE, error=max(noise, 1e-12))
        for w, phasor in zip(omegas, exact + error[0] + 1j * error[1], strict=True)
    ]


def _gains(points):
    gain = np.array([abs(p.gain) for p in points])
    return OMEGAS, gain, np.full(gain.size, NOISE / AMPLITUDE)


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


@pytest.mark.parametrize("mass", MASSES)
def test_exact_gains_give_the_exact_resonance(mass):
    points = _points(mass, noise=0.0)
    true = resonance_frequency(THESIS.with_added_mass(mass))
    for estimate in (three_point(*_gains(points)), parabola(*_gains(points)), of_responses(points)):
        assert estimate.omega == pytest.approx(true, rel=1e-8)
    # Between the right two points, the corrected two-point form with the known peak is exact.
    peak = abs(complex(Linearisation.of(THESIS.with_added_mass(mass)).response(true)))
    near = np.array([true - 0.1, true + 0.07])
    gain = np.abs(Linearisation.of(THESIS.with_added_mass(mass)).response(near))
    assert two_largest(near, gain, peak).omega == pytest.approx(true, rel=1e-9)


@pytest.mark.slow
def test_the_estimators_come_as_near_the_cramer_rao_bound_as_they_claim():
    rng = np.random.default_rng(1)
    squares, bounds, claims, covered = [], [], [], []
    for mass in MASSES:
        true = resonance_frequency(THESIS.with_added_mass(mass))
        rows = []
        for _ in range(RUNS):
            points = _points(mass, rng)
            gains = _gains(points)
            rows.append(
                [
                    three_point(*gains),
                    parabola(*gains),
                    of_responses(points),
                    two_largest(*gains[:2], corrected=False),
                ]
            )
        errors = np.array([[r.omega - true for r in row] for row in rows])
        claimed = np.array([[r.error for r in row] for row in rows])
        squares.append(np.mean(errors**2, axis=0))
        bounds.append(_bound(mass) ** 2)
        claims.append(np.sqrt(np.mean(claimed[:, :3] ** 2, axis=0)) / np.std(errors[:, :3], axis=0))
        covered.append(np.mean(np.abs(errors[:, 2]) < 1.96 * claimed[:, 2]))
    ratios = np.sqrt(np.mean(squares, axis=0) / np.mean(bounds))  # over the five masses
    three, weighted, complex_, printed = ratios
    assert complex_ < 1.3
    assert three < 3.5
    assert weighted < 3.5
    assert printed > 400
    np.testing.assert_allclose(claims, 1, atol=0.15)
    assert 0.92 < np.mean(covered) < 0.98


@pytest.mark.slow
def test_the_joint_linear_fit_reaches_the_bound_and_its_intervals_cover():
    rng = np.random.default_rng(2)
    truth = np.array([THESIS.p1, THESIS.p2, THESIS.p3, THESIS.p4])

    def responses(values):
        p = LumpedParameters(**dict(zip(("p1", "p2", "p3", "p4"), values, strict=True)))
        loaded = [p.with_added_mass(m) for m in MASSES]
        parts = [Linearisation.of(each).response(OMEGAS) * AMPLITUDE for each in loaded]
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


def test_responses_of_several_robots_are_refused():
    with pytest.raises(InputError, match="several"):
        complex_fit([*_points(MASSES[0]), *_points(MASSES[1])])
