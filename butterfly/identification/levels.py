"""Levels of significance, precision, relevance and rounding: one number each."""

import sys
from statistics import NormalDist

CONFIDENCE = 0.95
"""Level of all intervals; tests have a false-alarm rate of 1 less it."""

SPREADS = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2)
"""Half width of an interval, in standard deviations of a normal distribution."""

ACCUSED = 1e-3
"""False-alarm rate of tests of given values, and of the homogeneity of logs."""

CLEARLY = -NormalDist().inv_cdf(ACCUSED / 2)
"""Standard errors above which two values contradict each other."""

MATTERS = 0.01
"""Share of a value below which a change is negligible."""

MATERIAL = 0.05
"""Share of the squared errors that a missing term or a contrast explains if it is one."""

SHOWS = 1e-3
"""The same where errors are known, as those of steady responses are."""

LOST = 0.5
"""Largest unexplained share of a motion, or of an effect, of a model that follows."""

FEW = 3
"""Logs, masses or parts of data: so many allow to leave one out, but no estimate of scatter."""

DRAWS = round(1 / (1 - CONFIDENCE))
"""Random draws of which one is expected outside an interval."""

BAND_DRAWS = 10 * DRAWS
"""Default number of draws of a band: five are expected beyond either edge."""

MOST = 60
"""Largest number of iterations; one that goes on has not converged."""

PASSES = 12
"""The same of an iteration that begins near its solution."""

WEIGHED = 0.2
"""Relative tolerance of a variance, and of weights by it: scatter estimates none better."""

ROUNDING: float = sys.float_info.epsilon**0.5
"""Share below which a difference is none: half the digits are left to conditioning."""
