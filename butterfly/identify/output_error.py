"""Output error: the parameters whose free-run simulation follows all logs best, jointly.

Every log is simulated from its first sample with the recorded input alone; the difference to the
measured angle is averaged over each step of the simulation, divided by the log's own rms motion,
and its sum of squares minimised over the parameters that all logs share, and over those of one
added mass or of one log (Ljung, System Identification, 2nd ed. 1999, section 7.2; Schittkowski,
Numerical Data Fitting in Dynamical Systems, 2002).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from butterfly.identify.covariance import cluster_covariance, compress
from butterfly.identify.estimate import ParameterEstimate
from butterfly.identify.free_run_problem import FreeRunProblem, Loss, OutputErrorOptions
from butterfly.identify.identifiability import Conditioning, refuse_one_mass, sort_by_precision
from butterfly.identify.intervals import honest_limits, without_each_mass

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.model.parameters import AddedMass, LumpedParameters

METHOD = "output error"

_TOLERANCE = 3e-4  # relative change of the cost; an interval's limits are at some 5e-2
_SMALLEST_STEP = 1e-6  # relative, of the parameters
_MAX_EVALUATIONS = 60
_ON_BOUND = 1e-4  # share of a parameter's scale within which it is on its bound
_NORMAL = 1.4826  # standard deviation over median absolute deviation
_OUTLYING = (
    1.5  # robust standard deviations beyond which robust losses take a residual for an outlier
)


@dataclass(frozen=True, eq=False)
class _Solution:
    """Where the optimiser stopped, in scaled parameters, and how it says it ended."""

    scaled: NDArray[np.float64]
    on_bound: NDArray[np.bool_]
    ending: str


def fit_output_error(
    logs: Sequence[Log],
    start: LumpedParameters,
    zeros: Mapping[AddedMass, float],
    options: OutputErrorOptions | None = None,
) -> ParameterEstimate:
    """Fit the free-run simulation of all logs jointly.

    Parameters
    ----------
    logs
        With increasing stamps, of at least two different added masses (none counts as one).
    start
        First guess; a poor one may stall the fit, so take a closed form's.
    zeros
        First guess of the encoder's reading in rad of the hand at rest, per added mass.
    options
        What is fitted, and how.

    Returns
    -------
    ParameterEstimate
        Its covariance is the cluster-robust one over logs; its intervals are widened to hold the
        estimates that leave one added mass out.

    Raises
    ------
    IdentifiabilityError
        If the logs cannot determine the parameters.
    """
    options = options or OutputErrorOptions()
    refuse_one_mass(log.added_mass for log in logs)
    problem = FreeRunProblem(logs, start, zeros, options)
    solution = _solve(problem, problem.initial, options)
    conditioning, covariance, freedom = _judge(problem, solution)
    shared = slice(len(problem.names))
    solved = solution.scaled * problem.scale
    values = solved[shared]
    known = dict(zip(problem.keys, solved.tolist(), strict=True))

    def without(mass: AddedMass) -> NDArray[np.float64]:
        """Fit from where the whole fit ended."""
        kept = [log for log in logs if log.added_mass != mass]
        part = FreeRunProblem(kept, start, zeros, options)
        initial = np.array([known[key] for key in part.keys]) / part.scale
        solved = _solve(part, initial, options).scaled * part.scale
        return np.asarray(solved[: len(part.names)])

    checked = [log.added_mass for log in logs] if options.check else []
    left_out = without_each_mass(checked, without)
    lower, upper = honest_limits(values, covariance, freedom, left_out.values())
    lower = np.maximum(lower, (problem.lower() * problem.scale)[shared])
    on_bound = tuple(np.array(problem.names)[solution.on_bound[shared]].tolist())
    return ParameterEstimate(
        method=METHOD,
        names=problem.names,
        values=values,
        covariance=covariance,
        lower=lower,
        upper=upper,
        left_out=left_out,
        condition=conditioning.number,
        on_bound=on_bound,
        verdict=(
            sort_by_precision(values, lower, upper, problem.names),
            *conditioning.words(),
            *_remarks(solution.ending, on_bound, checked=bool(left_out)),
        ),
        local=_local(problem, solved),
    )


def minimum(
    logs: Sequence[Log],
    start: LumpedParameters,
    zeros: Mapping[AddedMass, float],
    options: OutputErrorOptions,
) -> float:
    """Return the least sum of squares, each log's being its mean square relative error.

    The parameters are those of `fit_output_error`; the options may hold some of them.
    """
    problem = FreeRunProblem(logs, start, zeros, options)
    solution = _solve(problem, problem.initial, options)
    return float(np.sum(problem.residuals(solution.scaled) ** 2))


def _solve(
    problem: FreeRunProblem, initial: NDArray[np.float64], options: OutputErrorOptions
) -> _Solution:
    lower = problem.lower()
    fit = {
        "jac": problem.jacobian,
        "bounds": (lower, np.inf),
        "ftol": _TOLERANCE,
        "xtol": _SMALLEST_STEP,
        "max_nfev": _MAX_EVALUATIONS,
    }
    inside = np.maximum(initial, lower + _ON_BOUND)
    result = least_squares(problem.residuals, inside, **fit)
    if options.loss is not Loss.LINEAR:
        spread = _NORMAL * float(np.median(np.abs(result.fun)))
        robust = {"loss": options.loss.value, "f_scale": _OUTLYING * spread}
        result = least_squares(problem.residuals, result.x, **fit, **robust)
    on_bound = result.x <= lower + _ON_BOUND
    how = "converged" if result.status > 0 else "did not converge: do not trust the values"
    return _Solution(
        scaled=np.where(on_bound, lower, result.x),
        on_bound=on_bound,
        ending=f"The fit {how}, after {result.nfev} simulations of every log.",
    )


def _judge(
    problem: FreeRunProblem, solution: _Solution
) -> tuple[Conditioning, NDArray[np.float64], NDArray[np.float64]]:
    """Return conditioning, and covariance and degrees of freedom of the shared parameters."""
    compressed = [compress(log.jacobian, log.residuals) for log in problem.by_log(solution.scaled)]
    rows, residuals = (np.array(part) for part in zip(*compressed, strict=True))
    flat = rows.reshape(-1, rows.shape[2])
    conditioning = Conditioning.of(flat, tuple(name for name, _ in problem.keys))
    conditioning.refuse_singular()
    covariance, freedom = cluster_covariance(rows, residuals)
    covariance *= np.outer(problem.scale, problem.scale)
    count = len(problem.names)
    return conditioning, covariance[:count, :count], freedom[:count]


def _local(
    problem: FreeRunProblem, solved: NDArray[np.float64]
) -> dict[AddedMass | str | None, dict[str, float]]:
    """Return what is not shared, and the zero, by whose it is."""
    local: dict[AddedMass | str | None, dict[str, float]] = {}
    for (name, whose), value in list(zip(problem.keys, solved, strict=True))[len(problem.names) :]:
        local.setdefault(whose, {})[name] = float(value)
    return local


def _remarks(ending: str, on_bound: Sequence[str], *, checked: bool) -> list[str]:
    remarks = [ending]
    if on_bound:
        remarks.append(
            f"{', '.join(on_bound)} ended on a bound: friction that the data do not show."
        )
    if not checked:
        remarks.append(
            "Fewer than three added masses: the intervals could not be checked by leaving one out."
        )
    return remarks
