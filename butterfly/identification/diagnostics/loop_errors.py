"""Mistakes of servos: set-points that were told as drives, and loops that were told wrongly.

A joint that follows its input by a loop is driven by what is left to go. Averaged over test
functions, in units of the input,

    u = a th + (p1' thdd + p2' thd + p3' sin th + p3_offset' cos th + friction' + bias'),

each log with primed values of its own, for its gain: a is 1 of a set-point, and 0 of a drive.
Gravity alone makes no linear spring, and no spring has the stiffness of the input's own unit.
"""

from __future__ import annotations

import numpy as np
from scipy.special import stdtrit

from butterfly.identification.blocks import CELLS, parts_of
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.diagnostics.unit_errors import UnitError, unit_error
from butterfly.identification.levels import ACCUSED, PRECISE
from butterfly.identification.test_functions import Averaging
from butterfly.identification.windows import windows_of
