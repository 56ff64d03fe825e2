"""Whether the model follows the logs well enough for its parameters to mean anything."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from butterfly.identify.judgement.findings import Finding, FindingKind, Severity

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.identify.data import DataSet

GOOD_FIT = 80.0
"""Median FIT in per cent below which parameters need care."""

LEAST_FIT = 50.0
"""Median FIT in per cent below which parameters say nothing of the robot."""

_FAR_WORSE = 6.0  # times the median misfit, of a log that is not followed as the others are
_NOTABLE = 0.15  # misfit below which a log is followed, however well the others are


def judge_fit(fits: NDArray[np.float64], data: DataSet) -> list[Finding]:
    """Judge by how well free runs follow the logs.

    Where the hand passes the upright no free run stays near: such logs do not count, unless there
    are no others.

    Parameters
    ----------
    fits
        (n,) FIT of each log in per cent.
    data
        The n logs.
    """
    counted = data.calm or list(range(fits.size))
    names = [data.logs[k].name for k in counted]
    fits = fits[counted]
    median = float(np.median(fits))
    if not median >= GOOD_FIT:
        severity = Severity.CARE if median >= LEAST_FIT else Severity.WARNING
        return [Finding(kind=FindingKind.POOR_FIT, number=median, severity=severity)]
    misfits = 1 - fits / 100
    lost = np.flatnonzero(~(misfits <= max(_FAR_WORSE * (1 - median / 100), _NOTABLE)))
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
