"""Fit of a joint of known gain to segments of closed-loop logs, by SciPy and the integrator beside.

Each segment starts at an angle and a velocity of its own: nothing diverges, and the noise of no
start enters the parameters. Nothing of the program is used.
"""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from tests.independent.integrator import Joint, motion

NAMES = ("inertia", "viscous", "gravity", "coulomb")

_STEP = 4e-3  # s, of the integrator
_NUDGE = 1e-6  # of the scaled unknowns, for slopes
_OWN = 2  # unknowns of a segment: angle and velocity at its start


class Segment(NamedTuple):
    """(n,) stamps in s from 0, torques in N m and angles in rad."""

    time: np.ndarray
    torque: np.ndarray
    angle: np.ndarray


class Fitted(NamedTuple):
    """Values and standard errors by `NAMES`, and (k,) rms misfits of the segments in rad."""

    values: dict[str, float]
    errors: dict[str, float]
    misfits: np.ndarray


def segments(time, torque, angle, length):
    """Cut a log into whole segments of ``length`` s."""
    count = int((time[-1] - time[0]) / length)
    edges = np.searchsorted(time, time[0] + length * np.arange(count + 1))
    cuts = [slice(a, b + 1) for a, b in itertools.pairwise(edges)]
    return [Segment(time[cut] - time[cut][0], torque[cut], angle[cut]) for cut in cuts]


def fit(parts, first):
    """Fit the joint to segments, from first values of `NAMES` on.

    The standard errors count each segment as one observation, so that what the model leaves out
    widens them.
    """
    shared, sizes = len(NAMES), np.array([first[name] for name in NAMES])
    rows = np.concatenate([[0], np.cumsum([part.time.size for part in parts])])

    def misfits(unknowns):
        return np.concatenate(
            [
                _misfit(part, unknowns[:shared] * sizes, unknowns[shared + _OWN * k :][:_OWN])
                for k, part in enumerate(parts)
            ]
        )

    def slopes(unknowns):
        found, here = np.zeros((rows[-1], unknowns.size)), misfits(unknowns)
        for column in range(shared):
            there = unknowns.copy()
            there[column] += _NUDGE
            found[:, column] = (misfits(there) - here) / _NUDGE
        for which in range(_OWN):  # of all segments at once: none feels another's
            there = unknowns.copy()
            there[shared + which :: _OWN] += _NUDGE
            change = (misfits(there) - here) / _NUDGE
            for k in range(len(parts)):
                own = slice(rows[k], rows[k + 1])
                found[own, shared + _OWN * k + which] = change[own]
        return found

    begin = np.concatenate([np.ones(shared), *map(_start, parts)])
    lower = np.where(np.arange(begin.size) < shared, 0.0, -np.inf)
    end = least_squares(misfits, begin, slopes, bounds=(lower, np.inf), x_scale="jac")
    free = end.x > lower + _NUDGE
    whole, left = np.split(end.jac[:, free], rows[1:-1]), np.split(end.fun, rows[1:-1])
    scores = np.array([slope.T @ off for slope, off in zip(whole, left, strict=True)])
    inverse = np.linalg.pinv(end.jac[:, free].T @ end.jac[:, free])
    variances = np.zeros(end.x.size)
    variances[free] = np.sum((scores @ inverse) ** 2, axis=0) * len(parts) / (len(parts) - 1)
    return Fitted(
        values=dict(zip(NAMES, (end.x[:shared] * sizes).tolist(), strict=True)),
        errors=dict(zip(NAMES, (np.sqrt(variances[:shared]) * sizes).tolist(), strict=True)),
        misfits=np.array([np.sqrt(np.mean(off**2)) for off in left]),
    )


def _start(part):
    """Angle and velocity at the beginning, by a parabola through a tenth of the segment."""
    few = slice(0, max(part.time.size // 10, 4))
    _, velocity, angle = np.polyfit(part.time[few], part.angle[few], 2)
    return np.array([angle, velocity])


def _misfit(part, values, start):
    inertia, viscous, gravity, coulomb = values
    joint = Joint(inertia, viscous, gravity, 1.0, coulomb)
    simulated, _ = motion(joint, part.time, part.torque, *start, step=_STEP)
    return simulated - part.angle
