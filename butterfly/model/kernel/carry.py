"""Carry derivatives over one Runge-Kutta step.

The end of a step is linear in the derivatives S at its start and in those of the rates at its four
stages, K_i = A_i (S + c_i h K_(i-1)) + B_i: it is P S + sum_i W_i B_i, where P and W_i, found from
the last stage backwards, are the same for all columns.
"""

from __future__ import annotations

import numpy as np

from butterfly.compiled import compiled, inlined
from butterfly.model.kernel.constants import V, X
from butterfly.model.kernel.layout import BASIS, WEIGHT


@inlined
def carry_two(dt, stages, tangents, column):
    """Do so where angle and velocity are all: their 2 x 2 matrices written out."""
    sixth, half = dt / 6.0, 0.5 * dt
    a1, a2, a3, a4 = stages[0, V, X], stages[1, V, X], stages[2, V, X], stages[3, V, X]
    b1, b2, b3, b4 = stages[0, V, V], stages[1, V, V], stages[2, V, V], stages[3, V, V]
    vx4, vv4 = sixth * a4, sixth * b4  # W_4 A_4, whose first row is (0, dt/6)
    xx3, xv3 = 2.0 * sixth, dt * sixth
    vx3, vv3 = dt * vx4, 2.0 * sixth + dt * vv4
    xx2, xv2 = 2.0 * sixth + half * xv3 * a3, half * (xx3 + xv3 * b3)
    vx2, vv2 = half * vv3 * a3, 2.0 * sixth + half * (vx3 + vv3 * b3)
    xx1, xv1 = sixth + half * xv2 * a2, half * (xx2 + xv2 * b2)
    vx1, vv1 = half * vv2 * a2, sixth + half * (vx2 + vv2 * b2)
    _weigh(xx1, xv1, vx1, vv1, stages, 0)
    _weigh(xx2, xv2, vx2, vv2, stages, 1)
    _weigh(xx3, xv3, vx3, vv3, stages, 2)
    _weigh(sixth, 0.0, 0.0, sixth, stages, 3)
    pxx = 1.0 + xv1 * a1 + xv2 * a2 + xv3 * a3
    pxv = xx1 + xv1 * b1 + xx2 + xv2 * b2 + xx3 + xv3 * b3 + sixth
    pvx = vv1 * a1 + vv2 * a2 + vv3 * a3 + vx4
    pvv = 1.0 + vx1 + vv1 * b1 + vx2 + vv2 * b2 + vx3 + vv3 * b3 + vv4
    for j in range(column.size):
        x, v, k = tangents[X, j], tangents[V, j], column[j]
        x, v = pxx * x + pxv * v, pvx * x + pvv * v
        if k >= 0:
            n = BASIS + k
            k1, k2, k3 = stages[0, V, n], stages[1, V, n], stages[2, V, n]
            x += xv1 * k1 + xv2 * k2 + xv3 * k3
            v += vv1 * k1 + vv2 * k2 + vv3 * k3 + sixth * stages[3, V, n]
        tangents[X, j], tangents[V, j] = x, v


@inlined
def _weigh(xx, xv, vx, vv, stages, i):
    """Write the weights W of stage ``i``."""
    stages[i, X, WEIGHT + X], stages[i, X, WEIGHT + V] = xx, xv
    stages[i, V, WEIGHT + X], stages[i, V, WEIGHT + V] = vx, vv


@compiled
def carry_all(dt, n, stages, tangents, column):
    """Do so for any number n of states."""
    product, move, start = np.zeros((n, n)), np.eye(n), np.empty(n)
    for i in range(3, -1, -1):
        reach = 0.0 if i == 3 else (dt if i == 2 else 0.5 * dt)
        for r in range(n):
            for m in range(n):
                stages[i, r, WEIGHT + m] = reach * product[r, m]
            stages[i, r, WEIGHT + r] += dt / 3.0 if 0 < i < 3 else dt / 6.0
        for r in range(n):
            for m in range(n):
                product[r, m] = 0.0
                for q in range(n):
                    product[r, m] += stages[i, r, WEIGHT + q] * stages[i, q, m]
                move[r, m] += product[r, m]
    for j in range(column.size):
        k = column[j]
        for r in range(n):
            start[r] = tangents[r, j]
        for r in range(n):
            total = 0.0
            for m in range(n):
                total += move[r, m] * start[m]
                if k >= 0:
                    for i in range(4):
                        total += stages[i, r, WEIGHT + m] * stages[i, m, BASIS + k]
            tangents[r, j] = total
