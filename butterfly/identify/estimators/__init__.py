"""From data to parameters: one frozen dataclass for each estimator, its options its fields."""

from __future__ import annotations

from butterfly.identify.estimators.base import Estimator
from butterfly.identify.estimators.harmonic_balance import HarmonicBalance, Linear
from butterfly.identify.estimators.output_error import Loss, OutputError
from butterfly.identify.estimators.thesis import Thesis
from butterfly.identify.estimators.weak_form import WeakForm

ESTIMATORS: dict[str, type[Estimator]] = {
    each.method: each for each in (HarmonicBalance, OutputError, WeakForm, Linear, Thesis)
}
"""All estimators by the name of their method; a further one is its file and a place here."""

__all__ = [
    "ESTIMATORS",
    "Estimator",
    "HarmonicBalance",
    "Linear",
    "Loss",
    "OutputError",
    "Thesis",
    "WeakForm",
]
