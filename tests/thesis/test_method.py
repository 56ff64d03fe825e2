from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.log import Sine
from butterfly.model.parameters import AddedMass
from butterfly.thesis.method import fit_resonances, fit_thesis, scripted_amplitude

STEP_5 = {0.052: 4.1889, 0.1205: 5.7606, 0.154: 6.281}
STEP_5 = {AddedMass(mass=mass, arm=0.104): omega for mass, omega in STEP_5.items()}


def test_the_bounded_minimum_of_102_is_the_global_one_of_the_errata_and_degenerate():
    """With three masses the Jacobian has hardly full rank; table 5 is not that minimum."""
    values, jacobian = fit_resonances(STEP_5)
    np.testing.assert_allclose(values, [0.00288, 0.0200, 0.0652], rtol=5e-3)
    condition = np.linalg.cond(jacobian / np.linalg.norm(jacobian, axis=0))
    assert condition == pytest.approx(1.7e3, rel=0.15)

    def loss(p1, p2, p3):
        total = 0.0
        for mass, omega in STEP_5.items():
            inertia = p1 + mass.inertia
            model = (p3 + mass.gravity_moment) / inertia - 0.5 * (p2 / inertia) ** 2
            total += (omega**2 - model) ** 2
        return total

    assert loss(*values) < loss(0.0028, 0.0188, 0.0583)


def test_the_scripted_gain_is_low_by_the_square_root_of_the_decimation(sine_log):
    for decimation in (5, 25):
        omega, gain = scripted_amplitude(sine_log, decimation)
        assert gain == pytest.approx(20 * np.log10(0.5 / np.sqrt(decimation)), abs=0.1)
        assert omega == pytest.approx(5.0, abs=0.2)


def test_a_mass_with_one_log_only_is_refused(sine_log):
    with pytest.raises(InputError, match="two or more"):
        fit_thesis([sine_log])


def test_a_log_that_is_too_short_is_refused(sine_log):
    short = sine_log.take(sine_log.time < 1.0)
    with pytest.raises(InputError, match="about 30 s"):
        scripted_amplitude(replace(short, excitation=Sine(omega=5.0, amplitude=0.2)))
