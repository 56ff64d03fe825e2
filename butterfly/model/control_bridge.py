"""The model as python-control objects, for use in other tools."""

from __future__ import annotations

import math
from typing import Any

import control
import numpy as np
from scipy.linalg import expm

from butterfly.arrays import Samples
from butterfly.errors import require_number
from butterfly.model.linear import DelayStates, LinearJoint
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.terms import CONSERVATIVE, DISSIPATIVE, torque_of

PADE_ORDER = 4
"""Default order of the Padé approximation of a delay."""

_ROUNDING = 1e-9  # of a step


def linearised(
    parameters: LumpedParameters,
    added_mass: AddedMass = NO_ADDED_MASS,
    *,
    angle: float = 0.0,
    pade_order: int = PADE_ORDER,
) -> control.StateSpace:
    """Linearise about rest: from the command to angle and velocity of the loaded joint.

    The outputs are deviations in rad and rad/s from ``angle``, at which a constant input holds the
    joint. The states are the outputs, with an armature's lag the motor's ``torque`` in N m, and
    those of the Padé approximation of the delay (`DelayStates`). Order 4 has an error of 1e-6 up to
    1.4/delay rad/s, and of 1e-3 up to 3/delay.

    Order 0 omits the delay. A negative delay, possible in an estimate but not causal, is omitted
    too. The system is then named ``hand_without_delay``, otherwise ``hand``.
    """
    p = LinearJoint.of(parameters.with_added_mass(added_mass), angle)
    names = ["angle", "velocity", *["torque"] * (p.time_constant > 0)]
    a, b = np.zeros((3, 3)), np.zeros(3)
    a[0, 1] = 1.0
    a[1] = np.array([-p.stiffness, -p.damping, 1.0]) / p.inertia
    b[1] = p.gain / p.inertia
    if p.time_constant > 0:
        a[2, 1:] = np.array([-p.back_emf, -1.0]) / p.time_constant
        b[1:] = 0.0, p.gain / p.time_constant
    count = len(names)
    a, b = a[:count, :count], b[:count]
    is_late = p.delay > 0 and pade_order != 0
    if is_late:
        late = DelayStates.of(p.delay, pade_order)
        a = np.block([[a, np.outer(b, late.c)], [np.zeros((pade_order, count)), late.a]])
        b = np.concatenate([b * late.feedthrough, late.b])
        names += [f"delay[{k}]" for k in range(pade_order)]
    return control.ss(
        a,
        b[:, None],
        np.eye(2, len(names)),
        np.zeros((2, 1)),
        inputs=["command"],
        outputs=["angle", "velocity"],
        states=names,
        name="hand" if is_late or p.delay == 0 else "hand_without_delay",
    )


def discretised(
    parameters: LumpedParameters,
    step: float,
    added_mass: AddedMass = NO_ADDED_MASS,
    *,
    angle: float = 0.0,
) -> control.StateSpace:
    """Linearise like `linearised`, for commands held during steps in s.

    Exact at the ends of the steps, including the delay d = n step + r: with F(t) = exp(A t) and
    G(t) its integral times B, ``x[k+1] = F(step) x[k] + F(step - r) G(r) u[k-n-1] + G(step - r)
    u[k-n]`` (Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed. 1997, section 2.3).
    Earlier commands are states. A negative delay is omitted.
    """
    require_number("discretised", positive=True, unit="s", step=step)
    system = linearised(parameters, added_mass, angle=angle, pade_order=0)
    late = max(float(parameters.delay), 0.0) / step
    whole = math.floor(late + _ROUNDING)
    rest = late - whole if late - whole > _ROUNDING else 0.0
    count, commands = system.nstates, whole + (rest > 0)
    generator = np.zeros((count + 1, count + 1))
    generator[:count] = np.hstack([system.A, system.B])
    newer, older = (expm(generator * step * share) for share in (1 - rest, rest))
    now = newer[:count, count]  # of the command that acts at a step's end,
    before = newer[:count, :count] @ older[:count, count]  # and of the one before it
    a, b = np.zeros((count + commands, count + commands)), np.eye(count + commands, 1, -count)
    a[:count, :count] = newer[:count, :count] @ older[:count, :count]
    a[count + 1 :, count:-1] = np.eye(max(commands - 1, 0))
    for back, effect in enumerate([now, before][: 1 + (rest > 0)], whole):
        if back:
            a[:count, count + back - 1] = effect
        else:
            b[:count, 0] = effect
    return control.ss(
        a,
        b,
        np.eye(2, count + commands),
        np.zeros((2, 1)),
        step,
        inputs=["command"],
        outputs=["angle", "velocity"],
        states=[*system.state_labels, *(f"command[{-k}]" for k in range(1, commands + 1))],
        name="hand",
    )


def transfer_function(parameters: LumpedParameters) -> control.TransferFunction:
    """G(s) from command to angle of the loaded joint about hanging (13), with the armature lag."""
    p = LinearJoint.of(parameters)
    slow = np.polymul([p.time_constant, 1.0], [p.inertia, p.damping, p.stiffness])
    return control.tf([p.gain], np.trim_zeros(np.polyadd(slow, [p.back_emf, 0.0]), "f"))


def nonlinear_system(
    parameters: LumpedParameters, smoothing: float = 1e-3
) -> control.NonlinearIOSystem:
    """Return the full equation as an input/output system, from command to angle and velocity.

    For the loaded joint, without delay; an armature's lag and bristles add states. Friction without
    bristles changes sign over `smoothing` rad/s, as python-control needs a continuous right-hand
    side, so the joint creeps at rest.
    """
    p = parameters
    lagging, bending = p.time_constant > 0, p.bristle_stiffness > 0
    names = ["angle", "velocity", *["torque"] * lagging, *["deflection"] * bending]
    sliding = [row for row in (*CONSERVATIVE, *DISSIPATIVE) if not (bending and row.dry)]

    def update(_: float, state: Samples, command: Any, __: Any) -> list[float]:  # noqa: ANN401
        now = dict(zip(names, map(float, state), strict=True))
        v = now["velocity"]
        drive = p.p4 * p.delivered(float(np.ravel(command)[0])) - p.back_emf * v
        motor = now.get("torque", drive)
        motion = p.motion(now["angle"], v, motor=motor)
        motion = motion._replace(direction=math.tanh(v / smoothing))
        torque = motor + p.back_emf * v - torque_of(p, motion, sliding)
        rates = [v, 0.0]
        if lagging:
            rates.append((drive - motor) / p.time_constant)
        if bending:
            bend = now["deflection"]
            rates.append(v - p.bristle_stiffness * abs(v) * bend / p.level(v))
            torque -= p.bristle_stiffness * bend + p.bristle_damping * rates[-1]
        rates[1] = torque / p.p1
        return rates

    return control.nlsys(
        update,
        lambda _t, state, _command, _parameters: state[:2],
        inputs=["command"],
        outputs=["angle", "velocity"],
        states=names,
        name="hand",
    )
