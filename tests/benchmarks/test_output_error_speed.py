"""Output error on the 41 real logs; a 'simulation' is the bare integration of them all."""

from dataclasses import replace

import numpy as np

from butterfly.identification.estimators import OutputError
from butterfly.identification.estimators.multistart import Start
from butterfly.identification.validate import select_terms
from tests.benchmarks.bars import SHORT, at_most, measured
from tests.benchmarks.cpu_time import least_seconds

_STEP = 1e-5
"""Of differences, in scaled parameters: rounding and curvature then cost about 1e-8 of a column."""

_GIVEN = ("drag", "load", "bias", "p3_offset", "stribeck")


def test_residuals_and_their_jacobian_cost_at_most_2_5_simulations(fitted_problem, simulation):
    point = fitted_problem.initial
    fitted_problem.equations(point)  # delivers the inputs
    once, both = least_seconds(simulation, lambda: fitted_problem.equations(point))
    measured("output error: residuals and Jacobian", both / once)


def test_a_fit_of_twelve_parameters_costs_few_simulations(real, simulation):
    data = real.data
    start = Start(real.estimate.parameters, data.equilibria)
    estimator = OutputError(terms=_GIVEN, fixed=("stribeck_velocity",), workers=1)
    once, fit = least_seconds(
        simulation, lambda: estimator.of_logs(data.logs, [start]), repeats=2 if SHORT else 5
    )
    measured("output error: fit of 12 parameters", fit / once)


def test_choosing_terms_costs_few_fits(real):
    data = real.data.take(range(0, 41, 2)) if SHORT else real.data
    estimator = OutputError(workers=1)
    fit, choice = least_seconds(
        lambda: estimator(data), lambda: select_terms(data, estimator, _GIVEN), repeats=1
    )
    measured("select by output error, 5 terms", choice / fit)


def _turns(problem, scaled):
    """For each log, the signs of the velocity on the grid: they tell the order of events."""
    values = dict(zip([name for name, _ in problem.keys], scaled * problem.scale, strict=True))
    zero = values.pop("zero")
    parameters = replace(problem.start, **values)
    motions = [each.run(parameters, zero) for each in problem.simulations]
    return [np.sign(speed) for motion in motions for *_, speed in motion.pieces]


def test_the_jacobian_is_that_of_central_differences(fitted_problem):
    problem = fitted_problem
    point = np.maximum(problem.initial, problem.lower + 2 * _STEP)  # both sides can be simulated
    exact = problem.equations(point).logs
    errors, left_out = {}, 0
    for column, (name, _) in enumerate(problem.keys):
        move = np.zeros_like(point)
        move[column] = _STEP
        ends = point + move, point - move
        above, below = (problem.equations(end).logs for end in ends)
        turns = zip(*(_turns(problem, end) for end in ends), strict=True)
        kept = [k for k, both in enumerate(turns) if np.array_equal(*both)]
        columns = [exact[k].jacobian[:, column] for k in kept]
        slopes = [(above[k].residuals - below[k].residuals) / (2 * _STEP) for k in kept]
        size = np.linalg.norm(np.concatenate(columns))
        errors[name] = np.linalg.norm(np.concatenate(columns) - np.concatenate(slopes)) / size
        left_out = max(left_out, len(exact) - len(kept))
    delay = errors.pop("delay")
    worst = max(errors, key=errors.get)
    what = "output error: Jacobian less central differences"
    measured(f"{what}, worst column", errors[worst])
    measured(f"{what}, delay", delay)
    at_most(left_out, 4, "logs whose events change order")
