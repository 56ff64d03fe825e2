"""Re-calibrate the model next to an orbit, from logs of the control loop itself.

The equation of motion (or its product with the velocity, the balance of energy) against test
functions is linear in the parameters, whatever controller made the input; see
`butterfly.identification.weak_signals`. One robot without a known mass gives the ratios p_i/p1
alone, which is all that a controller needs; logs with another known mass set the scale.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.estimate import Estimate
from butterfly.identification.inference.identifiability import SINGULAR_CONDITION, Conditioning
from butterfly.identification.regression import Solution
from butterfly.identification.solved import Solved
from butterfly.logs.log import Log
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.terms import TERMS
from butterfly.orbit.recalibration_options import BASE, RecalibrationOptions
from butterfly.orbit.selection import FOLDS, Equations, Selection

_FEWEST_RUNS = 3  # to leave one out


@dataclass(frozen=True, kw_only=True, eq=False)
class Recalibration:
    """Parameters next to an orbit, and how far to trust them.

    Parameters
    ----------
    estimate
        The parameters; p1 is among them if they are absolute, otherwise all but a compression are
        divided by the p1 of the hand with what it carried. Its intervals are widened to hold the
        estimates that leave one run out.
    rejected
        Candidates that did not help.
    carried
        The added mass, if all logs had the same one.
    cogging_periods
        Of a cogging torque.
    """

    estimate: Estimate
    rejected: tuple[str, ...]
    carried: AddedMass | None
    cogging_periods: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return self.estimate.names

    @property
    def values(self) -> NDArray[np.float64]:
        """(n,) values, in their order."""
        return self.estimate.values

    @property
    def is_absolute(self) -> bool:
        """Whether p1 is known, not ratios to it alone."""
        return "p1" in self.names

    def is_ratio(self, name: str) -> bool:
        """Whether the value of a parameter is one over p1."""
        return not self.is_absolute and not TERMS[name].of_gain

    def loaded(self, added: AddedMass = NO_ADDED_MASS, inertia: float = 1.0) -> LumpedParameters:
        """Return the parameters of the hand carrying a mass.

        Parameters
        ----------
        added
            What it carries.
        inertia
            p1 of the hand so loaded, where the estimate is of ratios.

        Raises
        ------
        IdentifiabilityError
            If the estimate is of ratios, with another added mass.
        """
        values = dict(zip(self.names, self.values.tolist(), strict=True))
        if self.is_absolute:
            bare = LumpedParameters(**values, cogging_periods=self.cogging_periods)
            return bare.with_added_mass(added)
        if added != self.carried:
            raise IdentifiabilityError(
                f"ratios p_i/p1 with {self.carried} say nothing of the hand with {added}: "
                "re-calibrate with both"
            )
        return from_ratios(values, inertia, self.cogging_periods)


def from_ratios(
    ratios: dict[str, float], inertia: float, cogging_periods: float
) -> LumpedParameters:
    """Return parameters from ratios to p1, given p1 = ``inertia`` in kg m^2."""
    scaled = {
        name: value if TERMS[name].of_gain else inertia * value for name, value in ratios.items()
    }
    return LumpedParameters(p1=inertia, **scaled, cogging_periods=cogging_periods)


def recalibrate(
    logs: Sequence[Log], zero: float, options: RecalibrationOptions = RecalibrationOptions()
) -> Recalibration:
    """Estimate p1..p4 and friction terms by constrained linear least squares.

    Parameters
    ----------
    logs
        Of runs next to the orbit, none of them quite on it: there the control only makes up for
        friction, and nothing is told apart.
    zero
        Encoder reading in rad of the hanging hand.
    options
        See `RecalibrationOptions`.

    Raises
    ------
    IdentifiabilityError
        If the logs cannot tell the parameters apart.
    InputError
        If a log is shorter than a test function.
    """
    masses = {log.added_mass for log in logs}
    base = BASE if len(masses) > 1 else BASE[1:]
    selection = Selection(logs, zero, options)
    _, plain = selection.fit(base)
    stretches = np.unique(plain.regression.cluster).size
    if stretches <= 2 * FOLDS:
        moving = plain.run.size * options.half_width / 2
        raise IdentifiabilityError(
            f"{moving:.3g} s of motion are too little to re-calibrate: record longer runs"
        )
    names = (*base, *selection.select(base, options.candidates))
    solution, equations = selection.fit(names)
    _refuse_singular(equations)
    scale = FindingKind.ABSOLUTE if "p1" in names else FindingKind.RATIOS
    estimate = estimate_of(equations, solution, options.balance.value, Finding(kind=scale))
    first = logs[0]
    estimate = replace(estimate, input_kind=first.input_kind, joint=first.added_mass.joint)
    return Recalibration(
        estimate=estimate,
        rejected=tuple(name for name in options.candidates if name not in names),
        carried=masses.pop() if len(masses) == 1 else None,
        cogging_periods=options.cogging_periods,
    )


def estimate_of(
    equations: Equations, solution: Solution, method: str, *findings: Finding
) -> Estimate:
    """Judge what equations say, their errors independent between stretches of runs.

    Parameters
    ----------
    equations, solution
        What was solved, and its values.
    method, findings
        For the estimate.

    Raises
    ------
    IdentifiabilityError
        If the equations are singular for every practical purpose.
    """
    solved = Solved.of(equations.regression, solution)
    left_out = _without_each_run(equations)
    return Estimate.from_rows(
        solved,
        method=method,
        left_out=left_out,
        findings=findings,
        ratios="p1" not in solved.names,
    )


def _refuse_singular(equations: Equations) -> None:
    conditioning = Conditioning.of(equations.regression.rows, equations.regression.names)
    if conditioning.number > SINGULAR_CONDITION:
        raise IdentifiabilityError(
            f"these runs do not tell {' and '.join(conditioning.weakest)} apart (condition number "
            f"{conditioning.number:.1e}): perturb the start, hold several orbits, or add dither"
        )


def _without_each_run(equations: Equations) -> dict[Hashable, NDArray[np.float64]]:
    """Estimate again without each run, where enough are left to tell the parameters apart."""
    runs, regression = np.unique(equations.run), equations.regression
    found: dict[Hashable, NDArray[np.float64]] = {}
    for run in runs.tolist() if runs.size >= _FEWEST_RUNS else []:
        kept = equations.run != run
        if Conditioning.of(regression.rows[kept], regression.names).number < SINGULAR_CONDITION:
            found[f"run {run}"] = regression.solve(kept).values
    return found
