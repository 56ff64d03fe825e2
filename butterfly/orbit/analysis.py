"""How an orbit is approached: comparison system, lifted matrix, multipliers, invariant."""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.integrate import simpson, solve_ivp

from butterfly.logs.log import Log
from butterfly.model.energy import Orbit, energy, pull, stiffness
from butterfly.model.parameters import LumpedParameters

_TOP = 0.25  # share of a half swing, either side of its middle, to which a turning point is fitted
_FEWEST = 10  # samples of a half swing
_FINE = 64  # points of the nominal motion in one interval of the comparison system


def invariant(
    parameters: LumpedParameters,
    orbit: Orbit,
    angle: NDArray[np.float64],
    velocity: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return (n,) values of I = E - E* (107) in J along a motion."""
    return np.asarray(energy(parameters, angle, velocity) - orbit.energy)


def comparison_factors(orbit: Orbit, gamma: float, count: int) -> NDArray[np.float64]:
    """Return (count,) factors a-bar of (115), by which I shrinks over each part of the period.

    Parameters
    ----------
    orbit, gamma
        The loop.
    count
        Number of equal parts of the period, from the upper turning point on.
    """
    times = np.linspace(0, orbit.period, count * _FINE + 1)
    _, velocity = orbit.solution(times)
    squared = velocity**2
    parts = [slice(k * _FINE, (k + 1) * _FINE + 1) for k in range(count)]
    areas = np.array([simpson(squared[part], x=times[part]) for part in parts])
    return np.exp(-abs(orbit.parameters.p4) * gamma * areas)


def lifted_matrix(factors: NDArray[np.float64], step: int) -> NDArray[np.float64]:
    """Return A_k of X_(k+1) = A_k X_k (116), X_k the last n values of I, newest first (117).

    As printed the matrix is constant; it is P^k A_0 P^-k with P the cyclic shift, since each entry
    of X moves on by one part of the period with each step.

    Parameters
    ----------
    factors
        (n,) from `comparison_factors`.
    step
        k.
    """
    newest_first = np.roll(factors, -step)[::-1]
    return np.diag(newest_first)


def monodromy(orbit: Orbit, gamma: float) -> NDArray[np.float64]:
    """Return the (2, 2) monodromy matrix of the exact loop (104), (109) on its orbit.

    Integrated numerically with the variational equation; one of its eigenvalues is 1, along the
    orbit, the other `butterfly.orbit.controller.multiplier_of`.
    """
    p = orbit.parameters
    strength = abs(p.p4) * gamma

    def rhs(_: float, y: NDArray[np.float64]) -> NDArray[np.float64]:
        x, v = float(y[0]), float(y[1])
        torque, excess = pull(p, x), energy(p, x, v) - orbit.energy
        acceleration = (torque - strength * v * excess) / p.p1
        jacobian = np.array(
            [
                [0.0, 1.0],
                [
                    (strength * v * torque - stiffness(p, x)) / p.p1,
                    -strength * (excess + p.p1 * v**2) / p.p1,
                ],
            ]
        )
        return np.concatenate([[v, acceleration], (jacobian @ y[2:].reshape(2, 2)).ravel()])

    start = np.concatenate([[orbit.upper, 0.0], np.eye(2).ravel()])
    solved = solve_ivp(rhs, (0, orbit.period), start, "DOP853", rtol=1e-10, atol=1e-12)
    return np.asarray(solved.y[2:, -1].reshape(2, 2))


def swing(log: Log, zero: float, since: float) -> float:
    """Measure the amplitude in rad that a log has come to, half the mean peak-to-peak swing.

    Parameters
    ----------
    log
        Of any clock.
    zero
        Encoder reading in rad of the hanging hand.
    since
        Stamp in s from which on turning points count.

    Returns
    -------
    NaN if the hand turned over, 0 if it stopped turning back and forth.
    """
    rows = log.time >= since
    time, angle = log.time[rows], log.angle[rows] - zero
    if np.abs(angle).max() > math.pi:
        return math.nan
    upper, lower = (_turning_points(time, sign * angle) for sign in (1, -1))
    if not (upper and lower):
        return 0.0
    return float(np.mean(upper) + np.mean(lower)) / 2


def _turning_points(time: NDArray[np.float64], angle: NDArray[np.float64]) -> list[float]:
    """Heights of the maxima above 0, each the top of a quartic through the samples about it."""
    above = np.concatenate([[False], angle > 0, [False]])
    edges = np.flatnonzero(np.diff(above.astype(int)))
    heights = []
    for start, end in edges.reshape(-1, 2).tolist():
        if start == 0 or end == angle.size or end - start < _FEWEST:
            continue  # cut off by the ends of the log, or noise about 0
        length = time[end - 1] - time[start]
        top = np.abs(time - 0.5 * (time[start] + time[end - 1])) < _TOP * length
        middle = 0.5 * (time[start] + time[end - 1])
        fit = Polynomial.fit(time[top] - middle, angle[top], 4)
        fine = np.linspace(float(fit.domain[0]), float(fit.domain[1]), 201)
        heights.append(float(fit(fine).max()))
    return heights
