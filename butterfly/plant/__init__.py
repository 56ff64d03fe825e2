"""What can be driven: the robot in MuJoCo, its excitations, its clock and its encoder."""

import os
import sys
from ctypes.util import find_library


def has_display() -> bool:
    """Tell whether there is a display to open a window on; systems other than Linux have one."""
    return sys.platform != "linux" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


# MuJoCo chooses how to draw when it is first imported. Without a display only EGL can.
if not has_display() and find_library("EGL"):
    os.environ.setdefault("MUJOCO_GL", "egl")
