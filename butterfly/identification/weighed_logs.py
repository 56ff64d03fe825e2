"""Logs weighed by how much friction and gain differ among them: from a fit to a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from butterfly.errors import IdentifiabilityError
from butterfly.identification.chosen_terms import conditioning_of
from butterfly.identification.findings import FindingKind
from butterfly.identification.fit import Fit
from butterfly.identification.inference.scatter import Likelihood
from butterfly.identification.levels import FEW, LOST
from butterfly.identification.linearisation import Loss
from butterfly.identification.problem import Problem
from butterfly.progress import out_of_time


def weighed(every: Problem, fit: Fit) -> Fit:
    """Return the fit to logs that are weighed by their likeliest scatter (see `scatter`).

    Two steps, on all rows of each log, compressed to as many as there are values. The first leads
    from the end of the fit to where these logs, weighed, are best. There every log is simulated
    with its likeliest friction and gain besides, which tells the scatter better; the second step is
    to where logs weighed by that are best (Lindstrom & Bates, Biometrics 46, 1990). It is not
    simulated again but to see that plain logs are followed there. Findings say which scatter is
    more than chance. The fit stays as it was if there are too few logs to tell, or no such end.
    """
    plain = _plain(every, fit)
    problem, at = every.of_fit(plain), plain.linearisation
    few = at.ends.size <= FEW or at.loss is not Loss.LINEAR  # a robust loss weighs by itself
    if few or out_of_time("weighting the logs by their scatter"):
        return plain
    try:
        begun, own = at, np.zeros((at.ends.size, at.values.size))
        if fit.scatter:  # of other terms: each log begins with what it had of its own
            own = np.maximum(fit.scatter.own_of(problem.labels), problem.lower - at.values)
            begun = problem.equations(at.values + own, at)
        first = Likelihood(begun, at.values, own, problem.prior(at.values))
        scatter = first.best()
        white = problem.knowing(first.weighed(scatter))
        step = white.step(*problem.box.about(white.values, np.inf))
        values = plain.values + step
        own = np.maximum(scatter.random_effects(white, step), problem.lower - values)
        there = problem.equations(values + own, at)
        if not there.is_finite:
            return plain
        second = Likelihood(there, values, own, problem.prior(values))
        scatter = replace(second.best(), names=problem.labels, own=own, noise=second.noise)
        white = problem.knowing(second.weighed(scatter))
        step = white.step(*problem.box.about(values, np.inf))
    except IdentifiabilityError:
        return plain
    if conditioning_of(white).singular:
        return plain
    ended = np.maximum(values + step, problem.lower)
    promised = replace(at, prior=None).moved(ended - plain.values).cost
    if not LOST * problem.equations(ended, there, slopes=False).cost <= promised:
        return plain
    return replace(
        plain,
        linearisation=replace(white.moved(step), values=ended),
        unweighed=at,
        scatter=scatter,
        findings=(*plain.findings, *second.findings(scatter)),
    )


def _plain(every: Problem, fit: Fit) -> Fit:
    """Return a fit before its logs were weighed; of other terms since, at the values of these."""
    if fit.scatter is None:
        return fit
    problem = replace(every.of_fit(fit), scatter=None)
    at = problem.weighed(problem.equations(fit.values, fit.linearisation))
    findings = tuple(each for each in fit.findings if each.kind is not FindingKind.SCATTER)
    return replace(fit, linearisation=at, unweighed=None, scatter=None, findings=findings)
