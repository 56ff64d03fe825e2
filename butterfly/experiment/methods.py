"""All estimators by the names of their methods."""

from __future__ import annotations

from butterfly.identify.estimators import Estimator, HarmonicBalance
from butterfly.thesis.method import Thesis  # noqa: F401 - its being read makes it one of them

ESTIMATORS: dict[str, type[Estimator]] = {each.method: each for each in Estimator.__subclasses__()}
"""All estimators by the name of their method."""

DEFAULT_METHOD = HarmonicBalance.method
"""The estimator where none is named."""
