import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.model.linear import HeldSystem
from butterfly.model.parameters import LumpedParameters

THESIS = LumpedParameters(p1=0.00325, p2=0.001, p3=0.04905, p4=10)


def test_the_coefficients_are_the_published_ones_66():
    held = HeldSystem.of(THESIS, 0.04)
    found = [round(x, 4) for x in (held.a1, held.a0, held.b1, held.b0)]
    assert found == [-1.9638, 0.9878, 2.4465, 2.4365]


@given(
    p1=st.floats(1e-3, 1e-1),
    ratio=st.floats(0.01, 0.9),
    natural=st.floats(0.5, 20),
    step=st.floats(1e-3, 0.1),
)
def test_they_equal_python_control_s_zero_order_hold(p1, ratio, natural, step):
    p = LumpedParameters(p1=p1, p2=2 * ratio * natural * p1, p3=natural**2 * p1, p4=2.0)
    held = HeldSystem.of(p, step)
    omega = np.array([0.3, 1.0, 2.0]) * natural
    omega = omega[omega < 3 / step]
    other = control.sample_system(control.tf([p.p4], [p.p1, p.p2, p.p3]), step, "zoh")
    expected = np.array([other(np.exp(1j * w * step)) for w in omega])
    np.testing.assert_allclose(held.response(omega), expected, rtol=1e-7)


def test_what_is_not_underdamped_is_refused():
    with pytest.raises(InputError, match="between 0 and 1"):
        HeldSystem.of(LumpedParameters(p1=1, p2=3, p3=1, p4=1), 0.1)
    with pytest.raises(InputError, match="step"):
        HeldSystem.of(THESIS, 0.0)
