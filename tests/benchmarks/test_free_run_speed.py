"""Free runs of the 41 real logs; a 'simulation' is the bare integration of them all."""

import math
from dataclasses import replace
from itertools import count

from butterfly.identification.estimators import HarmonicBalance
from butterfly.identification.free_run import Simulations
from butterfly.identification.parameters_by_hand import best_gain
from tests.benchmarks.bars import measured
from tests.benchmarks.cpu_time import least_seconds


def _fresh(data):
    """Return what has simulated no log yet."""
    return Simulations(data.logs, data.equilibria, data.counted)


def _all_different(found):
    """Yield estimates whose FIT is not known yet."""
    for k in count(1):
        yield found.with_gain(found.parameters.p4 * (1 + 1e-9 * k))


def test_the_fit_of_all_logs_costs_little_more_than_a_simulation(real, fitted, simulation):
    kept, estimates = _fresh(real.data), _all_different(fitted)
    kept.fits(fitted)
    once, again, first = least_seconds(
        simulation, lambda: kept.fits(next(estimates)), lambda: _fresh(real.data).fits(fitted)
    )
    measured("free run and FIT of 41 logs", again / once)
    measured("the same, inputs delivered anew", first / once)


def test_the_best_gain_costs_at_most_100_simulations(real, fitted, simulation):
    parameters, every = replace(fitted.parameters, p4=math.nan), range(len(real.data.logs))
    once, seeking = least_seconds(
        simulation, lambda: best_gain(parameters, real.data.take(every)), repeats=3
    )
    measured("best p4 for given parameters", seeking / once)


def test_the_harmonic_balance_costs_less_than_simulating_the_logs_once(real):
    fit, runs = least_seconds(
        lambda: HarmonicBalance().of_points(real.data.sines),
        lambda: _fresh(real.data).fits(real.estimate),
    )
    measured("harmonic balance of 41 logs", fit / runs)
