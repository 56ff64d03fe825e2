"""Say in words what the data can and cannot tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from butterfly.identify.estimate import PARAMETERS

if TYPE_CHECKING:
    from numpy.typing import NDArray

WEAK_CONDITION = 1e3
"""Above this condition number of the scaled regression one combination is poorly known."""

SINGULAR_CONDITION = 1e7
"""Above this one, the regression is singular for every practical purpose."""

_PRECISE = 0.10  # half-width over value below which a parameter counts as known


def describe(
    values: NDArray[np.float64],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    condition: float,
    null: NDArray[np.float64],
    on_bound: tuple[str, ...],
    checked_across_masses: bool,
) -> tuple[str, ...]:
    """Judge an estimate.

    Parameters
    ----------
    values, lower, upper
        (6,) estimates and intervals in the order of `PARAMETERS`.
    condition, null
        Condition number of the column-scaled regression, and its (6,) weakest direction.
    on_bound
        Parameters held by a bound.
    checked_across_masses
        Whether the intervals hold estimates with one added mass left out.

    Returns
    -------
    Sentences, the most important first.
    """
    sentences = [_sort_by_precision(values, lower, upper)]
    if condition > WEAK_CONDITION:
        involved = [PARAMETERS[k] for k in np.flatnonzero(np.abs(null) > 0.3 * np.abs(null).max())]
        sentences.append(
            f"{' and '.join(involved)} are known mainly in one combination (condition number "
            f"{condition:.0f}): add a run that tells them apart."
        )
    else:
        sentences.append(f"The regression is well conditioned (condition number {condition:.0f}).")
    if on_bound:
        sentences.append(
            f"{', '.join(on_bound)} ended on the bound 0: friction that the data do not show, or a "
            "model that misses something."
        )
    if not checked_across_masses:
        sentences.append(
            "Fewer than three added masses: the intervals could not be checked by leaving one out."
        )
    return tuple(sentences)


def _sort_by_precision(
    values: NDArray[np.float64], lower: NDArray[np.float64], upper: NDArray[np.float64]
) -> str:
    zero = (lower <= 0) & (upper >= 0)
    precise = ~zero & ((upper - lower) / 2 <= _PRECISE * np.abs(values))
    groups = {
        f"known within {_PRECISE:.0%}": precise,
        "known roughly": ~zero & ~precise,
        "not distinguishable from zero": zero,
    }
    named = np.array(PARAMETERS)
    parts = [f"{', '.join(named[mask])} {how}" for how, mask in groups.items() if mask.any()]
    return "; ".join(parts) + "."
