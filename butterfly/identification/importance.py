"""Draws weighed by how well they follow the logs, where that is worse than linearity promises.

Normal draws are right where free runs are linear in the parameters: the sum of squared errors S is
then the quadratic S_l of the linearised runs. Where it is not, as where a joint sticks or swings to
another side of its resonance, a draw gets the weight exp(-(S - S_l)/(2 s)), but none above 1: a
quadratic that rises too steeply far out would else leave all weight to a few draws (importance
sampling from an approximate posterior, Gelman et al., Bayesian Data Analysis, 3rd ed. 2013, section
10.4, truncated as by Ionides, J. Comput. Graph. Stat. 17, 2008).

S is a sum over logs of mean squared errors relative to the log's motion: errors within a log are
dependent, so that it counts as one. The scale s is that of the draws themselves, for which the
quadratic part of S_l is n s on average over n parameters, as in a normal distribution; and not
below S/N of the estimate, the share of one of N independent logs.
"""

from __future__ import annotations


import numpy as np
from numpy.typing import NDArray

from butterfly.identification.data import DataSet
from butterfly.identification.draws import ParameterDraws
from butterfly.identification.predict import Predictor, Setting
from butterfly.progress import Track, in_threads, untracked

_TINY = float(np.finfo(float).tiny)


def weighed(draws: ParameterDraws, data: DataSet, *, track: Track = untracked) -> ParameterDraws:
    """Return draws with weights by the logs that the estimate was made from.

    Parameters
    ----------
    draws
        Of equal weights.
    data
        The logs.
    track
        Shows progress.
    """
    predictor, logs = Predictor(data), range(len(data.logs))
    found = in_threads(
        lambda number: _of_log(predictor, number, draws), logs, track, "Weighing draws"
    )
    start, slope, curvature, risen = (np.sum(part, axis=0) for part in zip(*found, strict=True))
    moved = draws.values - draws.estimate.values
    quadratic = np.sum(moved @ curvature * moved, axis=1)
    scale = max(float(np.mean(quadratic)) / moved.shape[1], float(start) / len(logs), _TINY)
    worse = risen - (2 * moved @ slope + quadratic)
    return draws.weighted(np.exp(-np.maximum(worse, 0.0) / (2 * scale)))


def _of_log(
    predictor: Predictor, number: int, draws: ParameterDraws
) -> tuple[float, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return how one log's mean squared error, relative to its motion, depends on n parameters.

    Returns
    -------
    It with the estimate, half its (n,) gradient, half its (n, n) second derivative of the
    linearised run, and by what it is larger with each of m draws.
    """
    log, setting = predictor.data.logs[number], predictor.setting(number, draws.estimate)
    trajectory = setting.simulation(log)
    errors, rows, mixture = trajectory.linearised(
        draws.estimate.names, setting.parameters, setting.zero, setting.velocity
    )
    jacobian = rows @ mixture
    count, square = log.time.size, float(np.var(log.angle)) or _TINY

    def error(each: Setting) -> float:
        total = trajectory.squared_error(each.parameters, each.zero, each.velocity)
        return total / count / square

    start = error(setting)
    risen = [error(predictor.setting(number, each)) - start for each in draws.estimates()]
    scale = errors.size * square
    return start, jacobian.T @ errors / scale, jacobian.T @ jacobian / scale, np.array(risen)
