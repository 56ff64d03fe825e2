"""The model's own steady response to the recorded inputs, and what it corrects in a balance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.estimators.describing_fit import DescribingFit
from butterfly.identification.phasors import Phasors
from butterfly.identification.rest_angles import RestAngles
from butterfly.identification.simulation import Simulation

SETTLED = 0.1
"""Of the errors, by which one more correction would move a fit that has settled."""

ROUGHLY = 2.0
"""The same, of a fit that tells which terms help."""

_ROUNDS, _ROUNDS_OF_BIAS = 3, 8  # of correcting phasors by what simulations leave over
_ODD, _ODD_AT_LEAST = 5.0, 0.1  # of the median log, and of a swing: a motion that is not foretold
_FEW = 0.5  # share of a mass's logs
_LIKE = 2.0  # largest ratio of measured and simulated swing of a log whose remainder is trusted


@dataclass(frozen=True, kw_only=True, eq=False)
class SteadyModel:
    """What is simulated besides the parameters of a balance: sines, and the angles they go about.

    The poles are those of the transients that were fitted to them.
    """

    simulations: Sequence[Simulation]
    rest: RestAngles
    poles: Sequence[complex | None]

    def corrected(self, fit: DescribingFit) -> tuple[DescribingFit, SteadyModel]:
        """Return the fit with what the model's own motion leaves over in its balance.

        That is nothing where the model, or its motion in a log, is too far from the robot's.
        """
        parameters = self.rest.applied(fit.parameters)
        masses = (each.log.added_mass for each in self.simulations)
        if not parameters.p1 + min(mass.inertia for mass in masses) > 0:
            return fit, self
        logs = zip(self.simulations, self.rest.zeros.tolist(), self.poles, strict=True)
        responses = (each.steady_response(parameters, *own) for each, *own in logs)
        moved, middles = zip(*responses, strict=True)
        phasors = _with_remainder(fit, np.array(moved))
        rest = self.rest.moved(np.array(middles)) if np.isfinite(middles).all() else self.rest
        return DescribingFit.of(phasors), replace(self, rest=rest)

    def settled(
        self, fit: DescribingFit, tolerance: float = SETTLED
    ) -> tuple[DescribingFit, SteadyModel]:
        """Correct a fit until one more correction would move it by little of its errors."""
        robot, last = self, 1.0
        for _ in range(_ROUNDS if self.rest.bias is None else _ROUNDS_OF_BIAS):
            before, rest = fit, robot.rest
            fit, robot = robot.corrected(fit)
            moved = fit.moved_to(before)
            still = robot.rest.near(rest)
            if (
                still and moved * min(moved / last, 1.0) < tolerance
            ):  # about what the next one moves
                break
            last = moved
        return fit, robot


def _with_remainder(fit: DescribingFit, moved: NDArray[np.complex128]) -> Phasors:
    measured = fit.phasors.angle
    size = np.abs(moved) / np.abs(measured)
    told = np.isfinite(size) & (size > 1 / _LIKE) & (size < _LIKE)
    moved = np.where(told, moved, measured)
    apart = np.where(told, np.abs(moved / measured - 1), 1.0)
    odd = apart > max(_ODD * float(np.median(apart)), _ODD_AT_LEAST)
    for mass in set(fit.phasors.masses):  # where most are odd, it is not the logs
        own = np.array([each == mass for each in fit.phasors.masses])
        odd[own] &= np.mean(odd[own]) < _FEW
    doubt = np.where(odd, apart * np.abs(measured), 0.0) ** 2
    return fit.phasors.corrected(fit.parameters, moved, told, doubt)
