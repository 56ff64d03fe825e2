"""Where what a fit leaves outweighs a value.

Standard errors take what a fit leaves for noise. Where that is as large as what a parameter alone
does to the equations, R = |r| / (|p| |s|) with s its column less what the others explain, a misfit
of the model may have made the value: the ripple of a constant velocity is read as inertia.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.equations import CellEquations
from butterfly.identification.estimate import OF_VERDICT
from butterfly.identification.inference.identifiability import precision

_NOTHING = np.finfo(float).tiny ** 0.5
_OUTWEIGHED = 0.5  # R from which on a value is in doubt: it is 0.35 at most on good logs


def misfit_over_value(equations: CellEquations) -> Samples:
    """(n,) R: the size of the residuals over what each parameter alone does to the rows."""
    curvature = equations.curvature.sum(axis=0)
    size = np.sqrt(np.diag(curvature))
    size = np.where(size > 0, size, 1.0)
    alone = size / np.sqrt(np.diag(np.linalg.pinv(curvature / np.outer(size, size))))
    effect, left = np.abs(equations.values) * alone, np.sqrt(equations.cost.sum())
    most = np.full(effect.size, np.finfo(float).max)
    return np.asarray(np.divide(left, effect, out=most, where=effect > left * _NOTHING))


def outweighed(
    misfit: Samples, values: Samples, limits: tuple[Samples, Samples], names: Sequence[str]
) -> tuple[Samples, Samples]:
    """Return (n,) limits that hold what a misfit may have made of the scale, or of precise values.

    The misfit of friction alone often outweighs a small share of it.
    """
    claims = precision(values, *limits)
    doubted = [n in OF_VERDICT or c == "precise" for n, c in zip(names, claims, strict=True)]
    reach = np.where(np.array(doubted) & (misfit > _OUTWEIGHED), misfit * np.abs(values), 0.0)
    return np.minimum(limits[0], values - reach), np.maximum(limits[1], values + reach)
