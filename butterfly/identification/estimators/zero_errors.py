"""What errors of the encoder's zero do to a fit that took it as given.

With the residuals' slopes J by the parameters and g by the zero, an error e of the zero moves the
estimate by -(J^T J)^-1 J^T g e; its square is added to the covariance ("consider" parameters;
Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, chapter VIII).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.estimators.instruments import Seen
from butterfly.identification.estimators.weak_fit import WeakFit

Samples = NDArray[np.float64]


def zero_covariance(
    fit: WeakFit, pairs: Sequence[Seen], doubts: Samples, names: Sequence[str]
) -> Samples:
    """(n, n) covariance that uncertain zeros add to n parameters.

    ``fit``: of the logs' windows through their instruments; ``pairs``: the m logs; ``doubts``: (k,
    m) standard uncertainties in rad of k independent errors (see
    `butterfly.identification.zeros.doubts`); ``names``: of the parameters; those that the fit held
    are not moved.
    """
    added = np.zeros((len(names), len(names)))
    if not doubts.size:
        return added
    slopes = [_slopes(fit, each) for each in pairs]
    errors = np.column_stack(
        [
            np.concatenate([size * slope for size, slope in zip(row, slopes, strict=True)])
            for row in doubts
        ]
    )
    free = ~fit.solved.on_bound
    rows, _ = fit.solved.with_prior(fit.solved.jacobian[:, None], fit.solved.residuals)
    rows = rows[:, free]
    errors = np.concatenate([errors, np.zeros((rows.shape[0] - errors.shape[0], len(doubts)))])
    scale = np.linalg.norm(rows, axis=0)
    moved = -np.linalg.lstsq(rows / scale, errors, rcond=None)[0] / scale[:, None]
    found = (name for name, is_free in zip(fit.solved.names, free, strict=True) if is_free)
    places = [list(names).index(name) for name in found]
    added[np.ix_(places, places)] = moved @ moved.T
    return added


def _slopes(fit: WeakFit, each: Seen) -> Samples:
    """(m,) derivatives of a log's residuals by its zero, of the test functions that were used."""
    used = each.windows.moving(fit.about.delay) & each.instruments.moving(fit.about.delay)
    names = ("p1", "p3", "p3_offset")
    signals = each.instruments.averaging.signals(names, delay=fit.about.delay)
    inertia, sine, cosine = (signals.mean[name][used] for name in names)
    moment = fit.values["p3"] + each.instruments.added.gravity_moment
    offset = fit.values.get("p3_offset", 0.0)
    size = float(np.linalg.norm(inertia)) or 1.0
    return np.asarray((offset * sine - moment * cosine) / size)
