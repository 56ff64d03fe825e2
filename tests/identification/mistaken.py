"""What is named of logs with mistakes, for the tests of unit errors and of their search."""

from dataclasses import replace

import numpy as np

from butterfly.identification.data import DataSet
from butterfly.identification.estimators.assumptions import as_taken
from butterfly.identification.identify import diagnose, in_true_time, with_other
from butterfly.identification.residuals import LogResiduals, Residuals
from butterfly.report.finding_texts import estimate_sentences
from tests.identification.simulated import noisy
from tests.independent.slips import NAMED

UNSEEN = Residuals(logs=(LogResiduals(name="", label="", motion=1.0),))


def recorded(logs):
    """Return logs with the noise of an encoder, and names of their own."""
    return with_names(noisy(logs, 2e-4, np.random.default_rng(0)))


def with_names(logs):
    """Return logs with names of their own."""
    return [replace(log, name=f"run {k}") for k, log in enumerate(logs)]


def fitted(data, estimator):
    """Return logs in their true time, as an estimate took them, and the estimate."""
    data, other = in_true_time(data, estimator)
    found = replace(estimator(data), input_kind=data.input_kind, joint=data.joint)
    return as_taken(data, with_other(found, other))


def named_of(logs, estimator):
    """Return what is named of logs, the level, and all that is said, whatever their residuals."""
    data, found = fitted(DataSet.of(logs), estimator)
    found = diagnose(data, estimator, data.simulations.with_horizon(found), UNSEEN)
    slips = [each for each in found.findings if each.kind in NAMED]
    return slips, found.level, " ".join(estimate_sentences(found))
