"""What counts as sure, as known, as little, as few and as rounding: one number each."""

import numpy as np
from scipy.special import ndtri

CONFIDENCE = 0.95
"""Level of all intervals; of what is tested, 1 less it is the chance of a false alarm."""

SPREADS = float(ndtri(0.5 + CONFIDENCE / 2))
"""Half width of an interval, in standard deviations of a normal distribution."""

ACCUSED = 1e-3
"""Chance of a false accusation: that what was told, or the sameness of logs, is contradicted."""

CLEARLY = float(-ndtri(ACCUSED / 2))
"""Standard errors from which on two values contradict each other."""

PRECISE = 0.1
"""Share of a value, within which it counts as known."""

MATTERS = 0.01
"""Share of a value, below which a change is not worth a word."""

SHOWS = 1e-3
"""The same where errors are known, as those of steady responses are."""

LOST = 0.5
"""Share of a motion, or of an effect, that a model leaves at most if it follows."""

FEW = 3
"""Logs, masses or parts of data: of so many one can be left out, but their scatter says nothing."""

DRAWS = round(1 / (1 - CONFIDENCE))
"""Random draws, of which one is outside an interval."""

MOST = 60
"""Rounds of an iteration, after which it counts as one that did not settle."""

PASSES = 12
"""The same of what begins near its end."""

WEIGHED = 0.2
"""Share of a variance, and of what it weighs, that scatter hardly tells better."""

ROUNDING: float = float(np.finfo(float).eps) ** 0.5
"""Share below which a difference is none: half the digits are left to conditioning."""
