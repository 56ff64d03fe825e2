"""The simulated plant: the robot in MuJoCo, its excitations, clock and encoder."""

import os
import sys
from ctypes.util import find_library


def has_display() -> bool:
    """Whether there is a display for a window; always assumed except on Linux."""
    return sys.platform != "linux" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


# MuJoCo chooses how to draw when it is first imported. Without a display only EGL can.
if not has_display() and find_library("EGL"):
    os.environ.setdefault("MUJOCO_GL", "egl")
