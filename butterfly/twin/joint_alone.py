"""A robot's model in which one joint moves and the others are held, without a soft constraint.

A held joint gets an armature so large that nothing moves it: the moving joint's acceleration then
errs by its share of that, 1e-12. An equality that holds a joint is soft, and errs until it settles.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from butterfly.arrays import Samples
from butterfly.twin.joint_of_model import JointOfModel

_HELD = 1e12
"""Armature of a held joint in kg m^2, or kg."""

_PRECISE = 1e-20
"""Tolerance of MuJoCo's solver, in which the held joints' armatures weigh: angles err by 1e-9."""

_OFF = (
    mujoco.mjtDisableBit.mjDSBL_CONTACT
    | mujoco.mjtDisableBit.mjDSBL_LIMIT
    | mujoco.mjtDisableBit.mjDSBL_EQUALITY
)


class JointAlone:
    """One joint of a robot's model, which one of its actuators drives, or a torque alone."""

    def __init__(
        self, robot: JointOfModel, pose: Mapping[str, float], actuator: str | None = None
    ) -> None:
        self._model = model = robot.model
        self._data = robot.configured(pose)
        self._dof = int(model.jnt_dofadr[robot.joint])
        self._place = int(model.jnt_qposadr[robot.joint])
        others = np.arange(model.nv) != self._dof
        model.dof_armature[others] = _HELD
        model.dof_frictionloss[others] = 0.0
        model.opt.disableflags |= int(_OFF)
        model.opt.tolerance = _PRECISE
        self._drive = None if actuator is None else int(model.actuator(actuator).id)
        idle = np.arange(model.nu) != self._drive
        model.actuator_gainprm[idle] = 0.0  # a servo of the joint would hold it
        model.actuator_biasprm[idle] = 0.0

    @property
    def step(self) -> float:
        """The model's time step in s."""
        return float(self._model.opt.timestep)

    def moved(self, commands: Samples, angle: float, velocity: float) -> Samples:
        """Return the (n + 1,) angles before and after each step under (n,) commands.

        They are the actuator's ctrl, else torques in N m.
        """
        model, data = self._model, self._data
        data.qpos[self._place], data.qvel[:] = angle, 0.0
        data.qvel[self._dof] = velocity
        angles = np.empty(commands.size + 1)
        angles[0] = angle
        for k, command in enumerate(commands):
            if self._drive is None:
                data.qfrc_applied[self._dof] = command
            else:
                data.ctrl[self._drive] = command
            mujoco.mj_step(model, data)
            angles[k + 1] = data.qpos[self._place]
        return angles
