"""Integrate the grey-box equation with set-valued Coulomb friction by compiled RK4."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from butterfly.model.kernel import Constants, State, integrate, interval
from butterfly.model.parameters import LumpedParameters


def simulate(
    parameters: LumpedParameters,
    time: NDArray[np.float64],
    inputs: NDArray[np.float64],
    angle: float,
    velocity: float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Integrate the equation of `LumpedParameters` over ``time``, one RK4 step per interval.

    A step in which the velocity changes sign is split where it vanishes; the joint then sticks
    while the other torques stay within what friction holds, and slips on from the instant at which
    they do not, so no regularisation parameter enters. Fourth-order accurate between reversals.
    Each interval is divided into steps short enough for the armature's lag and for the bristles;
    current and bristles start at 0.

    `time` has (n,) increasing instants in s, `inputs` (n - 1, 3) values at the start, middle and
    end of each interval, already delayed. Returns (n,) angles in rad and (n,) velocities in rad/s.
    """
    start = (angle, velocity, 0.0, 0.0)
    return integrate(time, parameters.p4 * inputs, start, Constants.of(parameters))


def step(constants: Constants, state: State, torque: float, duration: float) -> State:
    """Return the state after ``duration`` s as `simulate` finds it, p4 times the input held."""
    return interval(state, (torque, torque, torque), duration, constants)
