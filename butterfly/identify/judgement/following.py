"""Whether the model follows the logs well enough for its parameters to mean anything."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from butterfly.identify.judgement.findings import Finding, FindingKind, Severity

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

GOOD_FIT = 80.0
"""Median FIT in per cent below which parameters need care."""

LEAST_FIT = 50.0
"""Median FIT in per cent below which parameters say nothing of the robot."""


def judge_fit(fits: NDArray[np.float64], names: Sequence[str]) -> list[Finding]:
    """Judge by how well free runs follow the logs.

    Parameters
    ----------
    fits
        (n,) FIT of each log in per cent.
    names
        Of the n logs.
    """
    median = float(np.median(fits))
    if not median >= GOOD_FIT:
        severity = Severity.CARE if median >= LEAST_FIT else Severity.WARNING
        return [Finding(kind=FindingKind.POOR_FIT, number=median, severity=severity)]
    lost = np.flatnonzero(~(fits >= LEAST_FIT))
    if not lost.size:
        return []
    return [
        Finding(
            kind=FindingKind.UNFOLLOWED,
            number=float(fits[lost].min()),
            severity=Severity.CARE,
            logs=tuple(names[k] for k in lost.tolist()),
        )
    ]
