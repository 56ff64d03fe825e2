"""What an experiment file may say of an estimator: the options of its method, and no others."""

from __future__ import annotations

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from butterfly.experiment.methods import DEFAULT_METHOD, ESTIMATORS, kind_of


def _named(estimator: Any) -> Any:  # noqa: ANN401 - whatever stands in the file
    """Complete an estimator that does not say which it is, and refuse options that are not its own.

    Raises
    ------
    InputError
        Naming those that it has.
    """
    if not isinstance(estimator, dict):
        return estimator
    told = {"method": DEFAULT_METHOD} | estimator
    kind_of(str(told["method"]), [str(name) for name in told if name != "method"])
    return told


if TYPE_CHECKING:
    from butterfly.identify.estimators import Estimator

    MethodName = str
    AnyEstimator = Estimator
else:
    MethodName = Literal[tuple(ESTIMATORS)]
    AnyEstimator = Annotated[
        Annotated[reduce(or_, ESTIMATORS.values()), Field(discriminator="method")],
        BeforeValidator(_named),
    ]
