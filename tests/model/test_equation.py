"""The torques and the steps of the compiled equation."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.model.greybox import constants_of, simulate
from butterfly.model.kernel.equation import least_steps, rates
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import DRIVE, GEAR, TERMS
from tests.model.joints import instants
from tests.model.rows import ADDED, COMMAND, LOAD, PLAIN, STATES, STATIC, VALUE, YIELDED, motion_at


def test_what_settles_far_faster_than_the_clock_has_no_motion_and_takes_no_steps_without_number():
    """A trial of a fit: at its speed the drag would stop it in 2 ns."""
    joint = LumpedParameters(p1=1.8e-7, p2=0.0, p3=0.075, p4=-0.074, bias=0.072, drag=0.0124)
    assert least_steps(constants_of(joint), 4000.0, 0.01) == 0
    assert least_steps(constants_of(joint), 0.0, 0.01) == 1
    time = np.arange(0, 20, 0.01)
    angle, _ = simulate(joint, time, 0.1 * np.sin(4 * instants(time)), -0.79)
    assert np.isnan(angle[-1])


@pytest.mark.parametrize("name", STATIC)
@pytest.mark.parametrize(("angle", "velocity"), STATES)
def test_the_kernel_has_the_torque_of_every_row(name, angle, velocity):
    row = TERMS[name]
    moving = {name: VALUE} if name not in DRIVE else {name: VALUE, "p4": 0.5}
    more = 3 * VALUE if name == "coulomb_slope" else 0.0  # friction that stays above 0
    moving = {"coulomb": more} | moving
    if name in GEAR:
        moving |= {"p4": 0.5, "bias": LOAD}
    bare = replace(PLAIN, **moving)
    loaded = bare.with_added_mass(ADDED)
    gain = loaded.p4 * float(loaded.delivered(np.array([COMMAND]))[0])
    state = (angle, velocity, 0.0, 0.0)
    acceleration, *_ = rates(state, gain, float(np.sign(velocity)), constants_of(loaded))
    motion = motion_at(angle, velocity, weight=ADDED.weight, mass=ADDED.mass, input=COMMAND)
    if name in GEAR:  # the table takes the load from the parameters
        motion = loaded.motion(angle, velocity, motor=gain)
        assert motion.load == pytest.approx(LOAD)
    expected = gain + LOAD if name in GEAR else 0.0
    expected -= VALUE * float(row.basis(motion)) + more * float(motion.direction)
    if name in DRIVE:
        expected = 0.5 * YIELDED[name](VALUE)  # of which the basis is the derivative
        step = 1e-6
        slope = 0.5 * (YIELDED[name](VALUE + step) - YIELDED[name](VALUE))
        delivered = motion._replace(input=YIELDED[name](VALUE))
        assert -0.5 * float(row.basis(delivered)) == pytest.approx(slope / step, rel=1e-5)
    assert acceleration * loaded.p1 == pytest.approx(expected, abs=1e-12)
