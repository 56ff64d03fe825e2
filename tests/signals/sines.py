"""A fit of one sine, as tests want it."""

from butterfly.signals.frequency_response import (
    HARMONICS,
    SineFit,
    fit_basis,
    sine_basis,
    with_transient,
)


def fit_sine(time, values, omega, harmonics=HARMONICS, pole=None) -> SineFit:
    """Fit a sine, its harmonics and the transient of a pole, if one is given."""
    basis = with_transient(sine_basis(time, omega, harmonics), time, pole)
    return fit_basis(basis, values, omega, harmonics)
