"""A joint in the loops of servos, and the log of each."""

import numpy as np

from butterfly.identification.segments import driven
from butterfly.logs.log import Log
from butterfly.model.parameters import LumpedParameters
from butterfly.model.servo import ServoLoop

TIME = np.arange(0.0, 1.2, 0.004) + np.random.default_rng(0).uniform(0, 5e-4, 300)
GOAL = 0.8 * np.sin(2 * TIME + TIME**2) + np.where(TIME > 0.5, 0.4, 0.0)
ENABLED = np.where((TIME > 0.8) & (TIME < 0.95), 0.0, 1.0)
JOINT = LumpedParameters(
    p1=0.0066, p2=0.031, p3=0.3, p4=0.09, coulomb=0.02, stribeck=0.01, motor_friction=0.15,
    load_friction=0.1, delay=0.0045, dead_zone=0.02, compression=0.02, back_emf=0.01, latency=0.003,
)  # fmt: skip
LOOPS = {
    "dynamixel-xl330": {"kp": 400, "ki": 2000, "kd": 40},
    "dynamixel-x": {"kp": 300, "dead_band": 0.01},
    "dynamixel-x-velocity": {"kp": 800, "ki": 600},
    "feetech-sts": {"kp": 16, "speed_limit": 1.5},
    "odrive": {"kp": 20, "kd": 0.5, "ki": 2.0, "speed_limit": 6.0, "limit": 0.4},
    "odrive-velocity": {"kp": 0.5, "ki": 2, "limit": 0.4},
    "moteus": {"kp": 8, "kd": 0.3, "ki": 10, "limit": 0.5},
    "pid-current": {"kp": 4, "kd": 0.1, "limit": 2, "slew": 19, "resistance": 3}
    | {"back_emf_constant": 0.3},
    "pid-voltage": {"kp": 20, "current_limit": 1, "resistance": 3, "back_emf_constant": 0.3}
    | {"clock": 0.012},
}


def log_of(law, **more):
    """Return the log of a law, with more of it as told."""
    servo = ServoLoop.of({"law": law, "supply": 7.0, **LOOPS[law]})
    told = {"input_kind": "setpoint", "servo": servo, "enabled": ENABLED} | more
    return driven(Log(TIME, input=GOAL, angle=0.3 * np.sin(2 * TIME), **told))
