"""Joints that are exported from a brief log, or from none."""

import numpy as np

from butterfly.identification.free_run import Setting
from butterfly.logs.log import Intersample, Log
from butterfly.model.parameters import LumpedParameters
from butterfly.twin.twin import Twin
from tests.plant.setting import ADDED

PLAIN = LumpedParameters(p1=0.003, p2=1e-3, p3=0.05, p4=1)


def log_of(inputs, intersample=Intersample.ZERO_ORDER_HOLD):
    time, how = 1e-3 * np.arange(inputs.size), {"added_mass": ADDED, "intersample": intersample}
    return Log(time, input=inputs, angle=0 * time, input_kind="torque", name="log", **how)


BRIEF = log_of(0.01 * np.sin(4e-3 * np.arange(300)))


def twin_of(parameters, log=None, **more):
    """A twin that is measured on one log from rest, or on the two sines that it makes itself."""
    recorded = [(log, Setting(parameters=parameters, zero=0.0))] if log else []
    return Twin(parameters=parameters, added=ADDED, recorded=lambda: recorded, **more)
