"""What can be driven: the robot in MuJoCo, its excitations, its clock and its encoder."""

import os
import sys
from ctypes.util import find_library

# MuJoCo chooses how to draw when it is first imported. Without a display only EGL can.
_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
if sys.platform == "linux" and not any(map(os.environ.get, _DISPLAYS)) and find_library("EGL"):
    os.environ.setdefault("MUJOCO_GL", "egl")
