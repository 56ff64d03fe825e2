"""Whether the model follows the logs well enough for its parameters to mean anything."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.verdict import Level

GOOD_FIT = 80.0
"""Median FIT in per cent below which parameters need care."""

LEAST_FIT = 50.0
"""Median FIT in per cent below which parameters say nothing of the robot."""

_FAR_WORSE = 6.0  # times the median misfit, of a log that is not followed as the others are
_NOTABLE = 0.15  # misfit below which a log is followed, however well the others are


def judge_fit(fits: NDArray[np.float64], names: Sequence[str]) -> list[Finding]:
    """Judge by the (n,) FIT in % of the free runs of n logs."""
    median = float(np.median(fits))
    if not median >= GOOD_FIT:
        severity = Level.CARE if median >= LEAST_FIT else Level.WARNING
        return [Finding(kind=FindingKind.POOR_FIT, number=median, severity=severity)]
    return _lost(fits, names, median, FindingKind.UNFOLLOWED)


def judge_held_out(
    fits: NDArray[np.float64], names: Sequence[str], seen: NDArray[np.float64]
) -> list[Finding]:
    """Judge by the (n,) FIT in % of logs that were held out, beside the (m,) of those used."""
    return _lost(fits, names, float(np.median(seen)), FindingKind.UNFORETOLD)


def _lost(
    fits: NDArray[np.float64], names: Sequence[str], median: float, kind: FindingKind
) -> list[Finding]:
    """Name the logs that are followed far worse than a median FIT."""
    misfits = 1 - fits / 100
    lost = np.flatnonzero(~(misfits <= max(_FAR_WORSE * (1 - median / 100), _NOTABLE)))
    if not lost.size:
        return []
    return [
        Finding(
            kind=kind,
            number=float(fits[lost].min()),
            severity=Level.CARE,
            logs=tuple(names[k] for k in lost.tolist()),
        )
    ]
