"""Estimators ranked on two data sets, one of which has too few masses."""

from dataclasses import replace
from functools import cache

import numpy as np

from butterfly.comparison.answers import leaderboard
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, Linear, WeakForm
from tests.identification.simulated import ROBOT, SWINGS, steady


@cache
def bench():
    logs = steady(replace(ROBOT, drag=8e-4), dict(list(SWINGS.items())[::2]), duration=12.0)
    return DataSet.of([log.take(np.arange(0, log.time.size, 2)) for log in logs], name="bench")


@cache
def ranked():
    alone = replace(bench().take(range(3)), name="alone")
    estimators = (Linear(), HarmonicBalance(terms=("drag",)), WeakForm(terms=("drag",)))
    return leaderboard([bench(), alone], estimators)
