"""The armature's current, integrated together with the mechanism that MuJoCo moves."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from butterfly.model.parameters import VoltageDrive

_WHOLE = 0  # mj_forwardSkip: no stage of the dynamics is skipped,
_NO_SENSORS = 1  # but sensors are


class Armature:
    """Steps MuJoCo and the current of its motor by one RK4 (2)-(4).

    MuJoCo's own current is of first order. Its way to a better one is a callback that all threads
    of the process share; here MuJoCo gives accelerations under the current of each stage instead.

    Parameters
    ----------
    model, data
        With the current as its first command, and the joint driven as its first.
    drive
        With an inductance.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, drive: VoltageDrive) -> None:
        self.current = 0.0
        self._model, self._data, self._drive = model, data, drive
        self._position, self._velocity, self._acceleration = map(
            _as_one, (data.qpos, data.qvel, data.qacc)
        )
        self._bends = model.na > 0

    def advance(self, voltage: float, count: int) -> None:
        """Take ``count`` steps of the model's own length under a voltage in V."""
        h = self._model.opt.timestep
        half, sixth = 0.5 * h, h / 6.0
        x, v, i = self._position.item(), self._velocity.item(), self.current
        z = self._data.act.item() if self._bends else 0.0
        for _ in range(count):
            a1, i1, z1 = self._rates(x, v, i, z, voltage)
            v2 = v + half * a1
            a2, i2, z2 = self._rates(x + half * v, v2, i + half * i1, z + half * z1, voltage)
            v3 = v + half * a2
            a3, i3, z3 = self._rates(x + half * v2, v3, i + half * i2, z + half * z2, voltage)
            v4 = v + h * a3
            a4, i4, z4 = self._rates(x + h * v3, v4, i + h * i3, z + h * z3, voltage)
            x += sixth * (v + 2.0 * v2 + 2.0 * v3 + v4)
            v += sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            i += sixth * (i1 + 2.0 * i2 + 2.0 * i3 + i4)
            z += sixth * (z1 + 2.0 * z2 + 2.0 * z3 + z4)
        self._set(x, v, i, z)
        self.current = float(i)
        self._data.time += count * h

    def _set(self, x: complex, v: complex, i: float, z: float) -> None:
        self._position[0], self._velocity[0], self._data.ctrl[0] = x, v, i
        if self._bends:
            self._data.act[0] = z

    def _rates(
        self, x: complex, v: complex, i: float, z: float, voltage: float
    ) -> tuple[complex, float, float]:
        """Return accelerations, di/dt = (v - R i - k_emf thd)/L (4), and the bristles' rate."""
        self._set(x, v, i, z)
        mujoco.mj_forwardSkip(self._model, self._data, _WHOLE, _NO_SENSORS)
        drive = self._drive
        back_emf = drive.back_emf_constant * v.real
        rate = (voltage - drive.resistance * i - back_emf) / drive.inductance
        return self._acceleration.item(), rate, self._data.act_dot.item() if self._bends else 0.0


def _as_one(column: NDArray[np.float64]) -> NDArray[Any]:
    """View shaft, and hand behind a clutch, as one number: the hand is its imaginary part.

    RK4 only adds and scales, and numbers are several times faster than short arrays.
    """
    return column if column.size == 1 else column.view(np.complex128)
