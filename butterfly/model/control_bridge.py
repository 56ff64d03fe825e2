"""The model as python-control's objects, for those who go on in their own tools."""

from __future__ import annotations

import math
from typing import Any

import control
import numpy as np

from butterfly.arrays import Samples
from butterfly.model.linear import DelayStates, Linearisation
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.terms import CONSERVATIVE, DISSIPATIVE, torque_of

PADE_ORDER = 4
"""Of the approximation of a delay, if none is wished for."""


def linearised(
    parameters: LumpedParameters,
    added_mass: AddedMass = NO_ADDED_MASS,
    *,
    angle: float = 0.0,
    pade_order: int = PADE_ORDER,
) -> control.StateSpace:
    """Linearise about rest: from the command to the angle and the velocity of the loaded hand.

    The outputs are deviations in rad and rad/s from ``angle``, at which some constant input holds
    the hand. States are these, with an armature's lag the motor's ``torque`` in N m, and those of
    Padé's approximation of the delay (`DelayStates`): of order 4 right to 1e-6 up to 1.4/delay
    rad/s, and to 1e-3 up to 3/delay.

    An order of 0 leaves the delay out, and so is a negative one, which an estimate may come to and
    no causal system has: the system is then named ``hand_without_delay``, others ``hand``.
    """
    loaded = parameters.with_added_mass(added_mass)
    p = Linearisation.of(loaded, angle)
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


def transfer_function(parameters: LumpedParameters) -> control.TransferFunction:
    """G(s) from command to angle of the loaded hand about hanging (13), with the armature's lag."""
    p = Linearisation.of(parameters)
    slow = np.polymul([p.time_constant, 1.0], [p.inertia, p.damping, p.stiffness])
    return control.tf([p.gain], np.trim_zeros(np.polyadd(slow, [p.back_emf, 0.0]), "f"))


def nonlinear_system(
    parameters: LumpedParameters, smoothing: float = 1e-3
) -> control.NonlinearIOSystem:
    """Return the whole equation as an input/output system, from command to angle and velocity.

    Of the loaded hand, without delay; an armature's lag and bristles add their states. Friction
    without bristles changes its sign over `smoothing` rad/s, since python-control's solvers need a
    continuous right-hand side: it creeps at rest.
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
