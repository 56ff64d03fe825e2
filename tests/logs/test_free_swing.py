"""A free swing of few samples begins where its sine does."""

import numpy as np
import pytest

from butterfly.logs.log import Log
from tests.independent.integrator import Joint, motion


@pytest.mark.parametrize("phase", [0.0, 0.8, 2.5, 4.0])
def test_a_free_swing_of_ten_samples_a_period_begins_where_its_sine_does(phase):
    """Whether let go or seen from a moment on; by a cubic it is off by several of its swings."""
    time, pace = 0.9 * np.arange(60), 2 * np.pi / 9.0
    swing = Joint(inertia=1.0, viscous=0.04 * pace, gravity=pace**2, gain=1.0)
    start = 0.3 * np.cos(phase), -0.3 * pace * np.sin(phase)
    angle, _ = motion(swing, time, np.zeros_like(time), *start, step=0.02)
    noisy = angle + 0.01 * np.random.default_rng(1).standard_normal(time.size)
    begun = Log(time, np.zeros_like(time), noisy).initial_state
    assert begun.angle == pytest.approx(start[0], abs=0.05)
    assert begun.velocity == pytest.approx(start[1], abs=0.1 * pace)
