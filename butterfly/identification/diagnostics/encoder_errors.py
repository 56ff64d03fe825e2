"""Whether an encoder is off its centre: errors of free runs that repeat with the angle.

A disc beside its axis reads a sine of the angle too much, once a turn: e = a sin th + b cos th. Of
small swings a is a scale of the angle, which moves p4 and friction and which no log bounds; what it
does at larger ones, and b, do not look like any term. Both are fitted to the errors together with
all values, which are then those of a centred disc.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from butterfly.arrays import Samples, standard_error
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.inference.limits import (
    Rival,
    cluster_covariance,
    half_widths,
    independent_cells_of,
)
from butterfly.identification.inference.submodels import submodels_of
from butterfly.identification.linearisation import Linearisation
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import lower_bounds

_CHANCE = 0.01  # below which waves of the angle are none

_WAVES = ("encoder sine", "encoder cosine")


@dataclass(frozen=True, kw_only=True, eq=False)
class OffCentre:
    """An encoder that reads a sine of the angle too much."""

    amplitude: float  # of the error, in rad
    rival: Rival  # (n,) values that a centred one gives, with half-widths

    @property
    def finding(self) -> Finding:
        """Its amplitude."""
        return Finding(FindingKind.OFF_CENTRE, ("p4",), number=self.amplitude)


def off_centre(
    at: Linearisation, names: Sequence[str], waves: Iterable[Samples], masses: Sequence[AddedMass]
) -> OffCentre | None:
    """Return the eccentricity that errors of free runs show, by the first n unknowns; or none.

    ``waves``: (m, 2) effects of both waves on the m equations of each log. Like a term that many
    joints have, it must have a chance below 1 %, and predict the logs of other masses better.
    """
    count, every = len(names), (*names, *_WAVES)
    cells = replace(
        at,
        names=every,
        values=np.append(at.values[:count], np.zeros(len(_WAVES))),
        lower=lower_bounds(every),
        rows=np.column_stack([at.rows[:, :count], np.concatenate([*waves])]),
    ).cells(independent_cells_of(at.ends.size, len(every)))
    nested = submodels_of(cells, masses, 0.0)
    without, whole = np.arange(len(every)) < count, np.ones(len(every), dtype=bool)
    masks = np.array([without, whole])
    before, after = np.sqrt(nested.held_out(masks))
    gain, values = before - after, nested.fitted(masks)[1]
    if not (np.isfinite(values).all() and gain.mean() > standard_error(gain)):
        return None
    about = nested.about(values).equations
    covariance, freedom = cluster_covariance(*about.stack)
    waved, degrees = covariance[count:, count:], max(float(freedom[count:].min()), 2.0)
    # Hotelling's square of two values, as an F
    square = float(values[count:] @ np.linalg.solve(waved, values[count:])) / len(_WAVES)
    if not fdtrc(len(_WAVES), degrees - 1, square * (degrees - 1) / degrees) < _CHANCE:
        return None
    half = half_widths(covariance, freedom)[:count]
    rival = Rival(values[:count], half, predicts=False)
    return OffCentre(amplitude=float(np.hypot(*values[count:])), rival=rival)
