"""The 41 real logs; a 'simulation' is the bare integration of them all."""

import math
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from scipy.io import loadmat

import butterfly as bf
from butterfly.identification.data import read_data_set
from butterfly.identification.estimators import HarmonicBalance, OutputError
from butterfly.identification.free_run import Simulations
from butterfly.identification.identified import best_gain
from butterfly.identification.identify import identify
from butterfly.identification.problem import Start
from butterfly.identification.validate import select_terms
from butterfly.model.greybox import simulate
from butterfly.signals import hold
from tests.benchmarks.bars import SHORT, measured
from tests.benchmarks.cpu_time import compare
from tests.benchmarks.kept import keep

_STEP = 1e-5
"""Of differences, by what they do to residuals: rounding and curvature then cost about 1e-8."""

_GIVEN = ("drag", "load", "bias", "p3_offset", "stribeck")


@pytest.fixture(scope="module")
def data(real):
    return real.data


@pytest.fixture(scope="module")
def start(real, data):
    """The default estimate of a joint on a fixed base, which is what is timed."""
    return Start(replace(real.estimate.parameters, base_compliance=0.0), data.equilibria)


@pytest.fixture(scope="module")
def fitted(start, data):
    """Output error with the terms that are usually tried."""
    return OutputError(terms=_GIVEN, workers=1).of_logs(data.logs, [start])


@pytest.fixture(scope="module")
def problem(data, fitted):
    """What output error minimises with the terms that are usually tried, begun where it ends."""
    parameters, own = fitted.applied(data.logs[0])
    zeros = dict.fromkeys(data.equilibria, own["zero"])
    return OutputError(terms=_GIVEN, workers=1).problem(data.logs, Start(parameters, zeros))


@pytest.fixture(scope="module")
def simulation(fitted, problem):
    """Simulates all logs with the parameters of `fitted`, each input at hand on its grid."""
    jobs = []
    for trajectory in problem.simulations:
        log, grid = trajectory.log, trajectory.segments.grid
        parameters, own = fitted.applied(log)
        instants = grid - parameters.delay
        inputs = hold.parabolas(log.time, log.input, instants, log.intersample)[0]
        loaded = parameters.with_added_mass(log.added_mass)
        start = float(log.angle[0]) - own["zero"]
        jobs.append((loaded, grid, np.ascontiguousarray(inputs), start))
    return lambda: [simulate(*job) for job in jobs]


def _fresh(data):
    """Return what has simulated no log yet."""
    return Simulations(data.logs, data.equilibria, data.counted)


def test_the_fit_of_all_logs_costs_little_more_than_a_simulation(data, fitted, simulation):
    kept = _fresh(data)
    unknown = (replace(fitted, values=fitted.values * (1 + 1e-9 * k)) for k in count(1))
    kept.fits(fitted)
    wholes = {
        "free run and FIT of 41 logs": lambda: kept.fits(next(unknown)),
        "the same, inputs delivered anew": lambda: _fresh(data).fits(fitted),
    }
    compare(simulation, wholes)


def test_the_best_gain_costs_at_most_100_simulations(data, fitted, simulation):
    parameters, every = replace(fitted.parameters, p4=math.nan), range(len(data.logs))
    seeking = {"best p4 for given parameters": lambda: best_gain(parameters, data.take(every))}
    compare(simulation, seeking, repeats=1 if SHORT else 3)


def test_the_harmonic_balance_costs_less_than_simulating_the_logs_once(real):
    balance = {"harmonic balance of 41 logs": lambda: HarmonicBalance().of_points(real.data.sines)}
    compare(lambda: _fresh(real.data).fits(real.estimate), balance)


@pytest.mark.usefixtures("real")  # compiles the kernels
def test_identifying_the_real_logs_beside_reading_them(real_manifest):
    paths = [f"{real_manifest.root}/{entry.file}" for entry in real_manifest.logs]
    whole = {"identify 41 real logs": lambda: identify(read_data_set(real_manifest))}
    compare(lambda: [loadmat(path) for path in paths], whole, repeats=1 if SHORT else 7)


def test_residuals_and_their_jacobian_cost_at_most_2_5_simulations(problem, simulation):
    point = problem.initial
    problem.equations(point)  # delivers the inputs
    compare(simulation, {"output error: residuals and Jacobian": lambda: problem.equations(point)})


def test_a_fit_of_twelve_parameters_costs_few_simulations(start, data, simulation):
    estimator = OutputError(terms=_GIVEN, fixed=("stribeck_velocity",), workers=1)
    fit = {"output error: fit of 12 parameters": lambda: estimator.of_logs(data.logs, [start])}
    compare(simulation, fit, repeats=2 if SHORT else 5)


@pytest.mark.skipif(SHORT, reason="takes half a minute")
def test_choosing_terms_costs_few_fits(data):
    estimator = OutputError(workers=1)
    choice = {"select by output error, 5 terms": lambda: select_terms(data, estimator, _GIVEN)}
    compare(lambda: estimator(data), choice, repeats=1)


@pytest.mark.skipif(SHORT, reason="takes a minute")
def test_what_the_real_logs_are_predicted_with_is_kept(logs_folder, monkeypatch):
    monkeypatch.setenv("BUTTERFLY_LOGS", str(logs_folder))
    (fits,) = [line for line in bf.validate("real-logs").summary if line.startswith("Held-out ")]
    keep("real-logs", fits, "make bench")


def _events(problem, values):
    """For each log, signs of the velocity on the grid and counts of samples averaged in its steps.

    The signs tell the order of events. A delay moves samples from step to step: then other samples
    are averaged, and errors jump, if by little.
    """
    values = dict(zip(problem.names, values, strict=True))
    zero = values.pop("zero")
    parameters = replace(problem.start, **values)
    signs = [
        np.sign(speed)
        for simulation in problem.simulations
        for *_, speed in simulation.run(parameters, zero).pieces
    ]
    averaged = [each.segments.averages(parameters)[0] for each in problem.simulations]
    return [np.concatenate(both) for both in zip(signs, averaged, strict=True)]


def test_the_jacobian_is_that_of_central_differences(problem):
    def jacobian(point):
        at = problem.equations(point)
        return np.split(at.rows, at.ends[:-1])

    steps = _STEP / np.linalg.norm(np.concatenate(jacobian(problem.initial)), axis=0)
    point = np.maximum(problem.initial, problem.lower + 2 * steps)  # both sides can be simulated
    exact = jacobian(point)
    errors, left_out = {}, 0
    for column, (name, _) in enumerate(problem.keys):
        move = np.zeros_like(point)
        move[column] = steps[column]
        ends = point + move, point - move
        above, below = (problem.equations(end).by_log for end in ends)
        events = zip(*(_events(problem, end) for end in ends), strict=True)
        kept = [k for k, both in enumerate(events) if np.array_equal(*both)]
        columns = [exact[k][:, column] for k in kept]
        slopes = [(above[k] - below[k]) / (2 * steps[column]) for k in kept]
        size = np.linalg.norm(np.concatenate(columns))
        errors[name] = np.linalg.norm(np.concatenate(columns) - np.concatenate(slopes)) / size
        left_out = max(left_out, len(exact) - len(kept))
    delay, what = errors.pop("delay"), "output error: Jacobian less central differences"
    measured({f"{what}, worst column": max(errors.values()), f"{what}, delay": delay})
    assert left_out <= 4, "logs whose events change"
