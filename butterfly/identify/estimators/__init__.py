"""From data to parameters: one frozen dataclass for each estimator, its options its fields."""

from __future__ import annotations

from butterfly.identify.estimators.base import Estimator as Estimator
from butterfly.identify.estimators.harmonic_balance import HarmonicBalance as HarmonicBalance
from butterfly.identify.estimators.harmonic_balance import Linear as Linear
from butterfly.identify.estimators.loss import Loss as Loss
from butterfly.identify.estimators.output_error import OutputError as OutputError
from butterfly.identify.estimators.suitable import Suitable as Suitable
from butterfly.identify.estimators.weak_form import WeakForm as WeakForm
