"""The model's own steady response to the recorded inputs, and what it corrects in a balance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from butterfly.identify.estimators.describing_fit import DescribingFit
from butterfly.identify.simulated_response import simulated_response

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.identify.phasors import Phasors
    from butterfly.identify.rest_angles import RestAngles
    from butterfly.logs.log import Log

_ROUNDS = 3
_SETTLED = 0.05  # of the errors, by which a last correction may move the fit
_LIKE = 2.0  # largest ratio of measured and simulated swing of a log whose remainder is trusted


@dataclass(frozen=True, kw_only=True, eq=False)
class SteadyModel:
    """What is simulated besides the parameters of a balance.

    Parameters
    ----------
    logs
        Of sines.
    rest
        About which angles they swing.
    """

    logs: Sequence[Log]
    rest: RestAngles

    def corrected(self, fit: DescribingFit) -> tuple[DescribingFit, SteadyModel]:
        """Return the fit with what the model's own motion leaves over in its balance.

        That is nothing where the model, or its motion in a log, is too far from the robot's.
        """
        parameters = self.rest.applied(fit.parameters)
        if not parameters.p1 + min(log.added_mass.inertia for log in self.logs) > 0:
            return fit, self
        zeros = self.rest.zeros.tolist()
        moved, middles = zip(
            *(
                simulated_response(log, parameters, zero)
                for log, zero in zip(self.logs, zeros, strict=True)
            ),
            strict=True,
        )
        phasors = _with_remainder(fit, np.array(moved))
        rest = self.rest.moved(np.array(middles)) if np.isfinite(middles).all() else self.rest
        return DescribingFit.of(phasors), replace(self, rest=rest)

    def settled(self, fit: DescribingFit) -> tuple[DescribingFit, SteadyModel]:
        """Correct a fit until that moves it no more."""
        robot = self
        for _ in range(_ROUNDS):
            before = fit
            fit, robot = robot.corrected(fit)
            if fit.moved_to(before) < _SETTLED:
                break
        return fit, robot


def _with_remainder(fit: DescribingFit, moved: np.ndarray) -> Phasors:
    size = np.abs(moved) / np.abs(fit.phasors.angle)
    told = np.isfinite(size) & (size > 1 / _LIKE) & (size < _LIKE)
    return fit.phasors.corrected(fit.parameters, np.where(told, moved, fit.phasors.angle), told)
