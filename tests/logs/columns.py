"""Time, input and angle of a short log, as columns and rows, and whether a file gives them."""

import numpy as np

from butterfly.logs.formats import read_log

TIME = 0.02 * np.arange(60)
MATRIX = np.column_stack([TIME, np.sin(TIME), np.cos(TIME)])
NAMES = ("time", "input", "angle")
COLUMNS = dict(zip(NAMES, MATRIX.T, strict=True))
TABLE = [["time", "input", "angle"], *MATRIX.tolist()]
UNITS = [TABLE[0], ["ms", "mV", "deg"], *TABLE[1:]]
FACTORS = (1e-3, 1e-3, np.pi / 180)
GOAL = {"time": "timestamp", "input": "goal_position", "angle": "position"}
"""Columns of a servo, by field."""


def assert_read(path, columns=None, *, factors=(1, 1, 1)):
    """Read a log, assert that it holds these columns, each times its factor, and return it."""
    log = read_log(path, columns and dict(zip(NAMES, columns, strict=True)))
    for name, factor in zip(NAMES, factors, strict=True):
        np.testing.assert_allclose(getattr(log, name), factor * COLUMNS[name], rtol=1e-12)
    return log
