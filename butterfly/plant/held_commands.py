"""The grey box under a whole run of held commands, in one compiled loop."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from butterfly.compiled import compiled
from butterfly.model.kernel import Constants, State, interval
from butterfly.plant.motor import LARGEST_ANGLE

LONGEST_STEP = 1e-3
"""Longest step in s: RK4's error is then 1.5e-11 rad over 70 s of small swings."""


def steps_of(duration: float) -> int:
    """Count the equal steps of at most `LONGEST_STEP` that make up ``duration`` s."""
    if duration <= LONGEST_STEP:  # the usual cycle, in a loop that must be fast
        return 1
    return math.ceil(duration / LONGEST_STEP * (1 - 1e-9))


_steps_of = compiled(steps_of)


def angles_under(
    constants: Constants,
    state: State,
    stamps: NDArray[np.float64],
    torques: NDArray[np.float64],
    delay: float,
) -> NDArray[np.float64]:
    """Return the (n,) angles in rad of a joint at the instants at which its torque is set.

    It is what `butterfly.plant.motor.SimulatedMotor` does with a grey-box joint from cycle to
    cycle, the same arithmetic in the same order.

    Parameters
    ----------
    constants, state
        Of the grey box, at the first instant.
    stamps
        (n,) instants in s, increasing.
    torques
        (n,) p4 times the commands set at them, in N m; each is held from ``delay`` after its
        instant until the next takes effect. Before the first there is none.
    delay
        In s.

    Returns
    -------
    NaN from the instant on at which the joint has turned beyond `LARGEST_ANGLE`.
    """
    return _follow(constants, state, stamps, torques, delay)


@compiled
def _follow(c, state, stamps, torques, delay):
    angles = np.full(stamps.size, np.nan)
    torque = 0.0
    following = 0
    for k in range(stamps.size):
        if not abs(state[0]) < LARGEST_ANGLE:
            break
        angles[k] = state[0]
        if k + 1 == stamps.size:
            break
        now, end = stamps[k], stamps[k + 1]
        while following <= k and stamps[following] + delay < end:
            instant = stamps[following] + delay
            if instant > now:
                state = _hold(c, state, torque, instant - now)
                now = instant
            torque = torques[following]
            following += 1
        state = _hold(c, state, torque, end - now)
    return angles


@compiled
def _hold(c, state, torque, duration):
    count = _steps_of(duration)
    for _ in range(count):
        state = interval(state, (torque, torque, torque), duration / count, c)
    return state
