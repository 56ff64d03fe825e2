"""What all estimators share: terms that are given, held, or not offered."""

from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.identification.estimators import (
    HarmonicBalance,
    Linear,
    OutputError,
    WeakForm,
)
from butterfly.model.terms import PARAMETERS
from tests.identification.simulated import robot_with_drag

BALANCE = HarmonicBalance(terms=("drag",))


@pytest.fixture(scope="module")
def data():
    """Logs of a robot with drag."""
    return robot_with_drag()


@pytest.fixture(scope="module")
def chosen(data):
    return BALANCE(data)


@pytest.mark.parametrize(
    ("estimator", "terms"),
    [
        (HarmonicBalance(), ("stribeck", "drag")),
        (WeakForm(terms=("drag", "load"), half_width=0.2), ("drag",)),
        (OutputError(window=20.0), ("drag", "stribeck", "stribeck_velocity")),
        (OutputError(terms=("drag",)), ()),
    ],
)
def test_an_estimator_holds_the_terms_of_an_estimate_and_all_else_as_it_was(estimator, terms):
    estimate = SimpleNamespace(names=(*PARAMETERS, *terms))
    assert estimator.holding_terms_of(estimate) == estimator.with_terms(terms)
    assert Linear().holding_terms_of(estimate) == Linear()  # which offers none


def test_an_estimate_with_the_terms_held_is_the_one_that_chose_them(data, chosen):
    held = BALANCE.holding_terms_of(chosen)(data)
    assert "drag" in held.names
    assert held.names == chosen.names
    np.testing.assert_allclose(
        (held.values - chosen.values) / chosen.standard_errors, 0.0, atol=0.3
    )
