"""Whether the clock of the logs agrees with the manifest's omega: the input's own sine tells.

The phase of a sine's input runs ahead of omega t by the share by which one of the two is wrong, and
by the same share in all logs. Which of them it is, no log can say.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.signals.frequency_response import ResponsePoint

_LEVEL = 0.05  # of a false alarm
_LEAST = (
    5e-4  # of the frequency, by which p1 is a thousandth off: what moves it is named from there
)


def judge_clock(points: Sequence[ResponsePoint]) -> list[Finding]:
    """Tell by which share sines run faster than their omega, if it is more than its error."""
    apart = np.array([point.detuning for point in points])
    if apart.size < 2:  # noqa: PLR2004 - which have a scatter
        return []
    share = float(apart.mean())
    error = float(apart.std(ddof=1)) / math.sqrt(apart.size)
    if not abs(share) > max(stdtrit(apart.size - 1, 1 - _LEVEL / 2) * error, _LEAST):
        return []
    return [Finding(FindingKind.CLOCK, ("p1",), number=share)]


def like_a_clock(points: Sequence[ResponsePoint]) -> tuple[str, ...]:
    """Return the terms that are not to be tried, where a clock is wrong that looks like them."""
    return ("mass_inertia",) if judge_clock(points) else ()
