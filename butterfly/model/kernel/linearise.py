"""The derivatives of the rates of `equation` by the states and by every constant."""

from __future__ import annotations

import math

import numpy as np

from butterfly.compiled import compiled, inlined
from butterfly.model.kernel.constants import (
    BACK_EMF,
    BASIS,
    BIAS,
    COGGING,
    COGGING_COSINE,
    COULOMB,
    DAMPING,
    DRAG,
    LAG,
    P1,
    P3,
    P3_OFFSET,
    PERIODS,
    STIFFNESS,
    STRIBECK,
    STRIBECK_VELOCITY,
    VISCOUS,
    M,
    V,
    X,
    Z,
)
from butterfly.model.kernel.equation import friction_level


@inlined
def linearise(state, rate, shape, sign, c, ripples, stages, i):
    """Write the derivatives of the rates at stage ``i``, given (sin x, cos x, Stribeck's excess).

    Those by the cogging are left out without ``ripples``.
    """
    x, v, _, z = state
    sine, cosine, excess = shape
    push, speed, width = 1.0 / c.p1, abs(v), 1.0 / c.stribeck_velocity
    share = v * width
    narrowing = 2.0 * c.stribeck * excess * share * width  # -dg/dv
    rub = -sign * push
    stages[i, V, X] = push * (c.p3_offset * sine - c.p3 * cosine)
    stages[i, V, V] = -push * (c.viscous + c.back_emf + 2.0 * c.drag * speed) - rub * narrowing
    stages[i, V, BASIS + P1] = -push * rate[0]
    stages[i, V, BASIS + VISCOUS] = stages[i, V, BASIS + BACK_EMF] = -push * v
    stages[i, V, BASIS + P3] = -push * sine
    stages[i, V, BASIS + P3_OFFSET] = -push * cosine
    stages[i, V, BASIS + COULOMB] = rub
    stages[i, V, BASIS + STRIBECK] = rub * excess
    stages[i, V, BASIS + STRIBECK_VELOCITY] = rub * narrowing * share
    stages[i, V, BASIS + DRAG] = -push * speed * v
    stages[i, V, BASIS + BIAS] = push
    if ripples:
        wave, other = math.sin(c.cogging_periods * x), math.cos(c.cogging_periods * x)
        ripple = push * (c.cogging * other - c.cogging_cosine * wave)
        stages[i, V, X] += c.cogging_periods * ripple
        stages[i, V, BASIS + COGGING] = push * wave
        stages[i, V, BASIS + COGGING_COSINE] = push * other
        stages[i, V, BASIS + PERIODS] = x * ripple
    if c.lag > 0.0:
        _linearise_lag(v, rate[1], push, c, stages, i)
    if c.bristle_stiffness > 0.0:
        _linearise_bristles(v, z, rate[2], excess, push, c, stages, i)


@compiled
def _linearise_lag(v, motor_rate, push, c, stages, i):
    """Let the motor's torque, a state, drive the joint in the place of its input."""
    stages[i, V, V] += push * c.back_emf
    stages[i, V, M] = push
    stages[i, V, BASIS + BACK_EMF] = 0.0
    stages[i, M, V], stages[i, M, M] = -c.back_emf / c.lag, -1.0 / c.lag
    stages[i, M, BASIS + BACK_EMF] = -v / c.lag
    stages[i, M, BASIS + LAG] = -motor_rate / c.lag


@compiled
def _linearise_bristles(v, z, bend_rate, excess, push, c, stages, i):
    """Let the bristles brake in the place of rigid friction, whose sign here is 0."""
    level = friction_level(v, c)
    share = v / c.stribeck_velocity
    narrowing = 2.0 * c.stribeck * excess * share / c.stribeck_velocity
    slip = c.bristle_stiffness * abs(v) / level
    weaker = slip * z / level
    bend_by_v = 1.0 - np.sign(v) * c.bristle_stiffness * z / level - weaker * narrowing
    stages[i, Z, V], stages[i, Z, Z] = bend_by_v, -slip
    stages[i, Z, BASIS + COULOMB] = weaker
    stages[i, Z, BASIS + STRIBECK] = weaker * excess
    stages[i, Z, BASIS + STRIBECK_VELOCITY] = weaker * narrowing * share
    stages[i, Z, BASIS + STIFFNESS] = -abs(v) * z / level
    stages[i, V, V] -= push * c.bristle_damping * bend_by_v
    stages[i, V, Z] = push * (c.bristle_damping * slip - c.bristle_stiffness)
    for k in (COULOMB, STRIBECK, STRIBECK_VELOCITY, STIFFNESS):
        stages[i, V, BASIS + k] = -push * c.bristle_damping * stages[i, Z, BASIS + k]
    stages[i, V, BASIS + STIFFNESS] -= push * z
    stages[i, V, BASIS + DAMPING] = -push * bend_rate
