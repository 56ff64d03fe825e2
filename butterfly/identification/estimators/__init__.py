"""From data to parameters: one frozen dataclass for each estimator, its options its fields."""

from __future__ import annotations

from butterfly.identification.estimators.base import Estimator as Estimator
from butterfly.identification.estimators.fast_look import HarmonicBalance as HarmonicBalance
from butterfly.identification.estimators.fast_look import Linear as Linear
from butterfly.identification.estimators.output_error import OutputError as OutputError
from butterfly.identification.estimators.weak_form import WeakForm as WeakForm
from butterfly.identification.loss import Loss as Loss

DEFAULT_ESTIMATOR: type[Estimator] = OutputError
"""What answers where no method is named."""

DEFAULT_METHOD = "auto"
"""Another name of its method."""
