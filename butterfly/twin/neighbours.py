"""The torque at a joint that the motion of the robot's other joints makes.

It is the inverse dynamics of the whole model with the recorded motion (Luh, Walker and Paul 1980:
the recursive Newton-Euler algorithm, as MuJoCo has it) less that of the joint alone in its pose.
Recorded positions are smoothed by cubic splines, which are then differentiated; how smooth they are
is chosen once for each joint, as that which predicts every other sample best.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.interpolate import make_smoothing_spline
from scipy.optimize import minimize_scalar

from butterfly.arrays import Samples
from butterfly.model.parameters import JointKind
from butterfly.twin.joint_of_model import JointOfModel

_STANDS_OUT = 0.3  # of the noise, rms: a smoothed motion that is less is part of the noise
_STRETCH = 1200  # samples by which the smoothness is chosen
_DECADES = (-9.0, 9.0)  # of the smoothness, over the cube of the sampling interval in s


@dataclass(frozen=True, kw_only=True)
class JointMotion:
    """Positions, velocities and accelerations of a joint, (n,) each."""

    position: Samples
    velocity: Samples
    acceleration: Samples

    @classmethod
    def of(cls, time: Samples, measured: Samples, at: Samples) -> JointMotion:
        """Return the motion ``at`` (n,) times that a smoothing spline finds in measured positions.

        They are (m,) at their own times. What does not stand out of their noise is no motion.
        """
        spline = make_smoothing_spline(time, measured, lam=smoothness(time, measured))
        smooth = spline(time)
        if np.std(smooth) <= _STANDS_OUT * np.std(measured - smooth):
            still = np.zeros(at.size)
            return cls(position=still + np.mean(measured), velocity=still, acceleration=still)
        velocity, acceleration = (spline.derivative(order)(at) for order in (1, 2))
        return cls(position=spline(at), velocity=velocity, acceleration=acceleration)

    @property
    def reach(self) -> float:
        """Half of the way between its ends."""
        return float(np.ptp(self.position)) / 2


def smoothness(time: Samples, measured: Samples) -> float:
    """Return the smoothness with which every other sample predicts those between best.

    It is chosen on the part of a long record that moves most.
    """
    starts = range(0, max(time.size - _STRETCH, 0) + 1, max(_STRETCH // 2, 1))
    first = max(starts, key=lambda start: float(np.std(measured[start : start + _STRETCH])))
    some = slice(first, first + _STRETCH)
    t, y = time[some] - time[first], measured[some]
    step = float(np.mean(np.diff(t)))

    def error(decades: float) -> float:
        spline = make_smoothing_spline(t[::2], y[::2], lam=10.0**decades * step**3)
        return float(np.mean((spline(t[1::2]) - y[1::2]) ** 2))

    best = minimize_scalar(error, bounds=_DECADES, method="bounded", options={"xatol": 0.1})
    return float(10.0**best.x * step**3)


def coupling(
    robot: JointOfModel,
    driven: JointMotion,
    others: Mapping[str, JointMotion],
    pose: Mapping[str, float],
) -> Samples:
    """Return the (n,) torque in N m that the others' motion takes from the joint's drive.

    ``others``: by name; joints that are not among them stand still at their ``pose``. Armature,
    damping and friction of the others act on themselves alone.
    """
    model, data = robot.model, robot.configured(pose)
    alone, numbers = robot.pose_facts(pose), robot.others
    dof = int(model.jnt_dofadr[robot.joint])
    moving = {robot.joint: driven} | {numbers[name]: motion for name, motion in others.items()}
    places = {k: (int(model.jnt_qposadr[k]), int(model.jnt_dofadr[k])) for k in moving}
    torques, result = np.empty(driven.position.size), np.zeros(model.nv)
    for k in range(driven.position.size):
        for number, (place, at) in places.items():
            motion = moving[number]
            data.qpos[place] = motion.position[k]
            data.qvel[at] = motion.velocity[k]
            data.qacc[at] = motion.acceleration[k]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_rne(model, data, 1, result)
        torques[k] = result[dof] - data.qfrc_gravcomp[dof]
    by_itself = alone.inertia * driven.acceleration
    if robot.kind is JointKind.HINGE:
        by_itself = by_itself + alone.moment * np.sin(driven.position - alone.zero)
    return np.asarray(torques - by_itself)
