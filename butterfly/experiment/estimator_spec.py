"""What an experiment file may say of an estimator: the options of its method, and no others."""

from __future__ import annotations

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError

from butterfly.errors import InputError, nearest
from butterfly.experiment.methods import DEFAULT_OF_EXPERIMENTS, ESTIMATORS, kind_of
from butterfly.identification.estimators import Estimator


def _named(estimator: Any) -> Any:  # noqa: ANN401 - whatever stands in the file
    """Complete an estimator that does not say which it is, and refuse options that are not its own.

    Raises
    ------
    InputError
        Naming those that it has.
    """
    if not isinstance(estimator, dict):
        return estimator
    told = {"method": DEFAULT_OF_EXPERIMENTS} | estimator
    kind_of(str(told["method"]), [str(name) for name in told if name != "method"])
    return told


if TYPE_CHECKING:
    from collections.abc import Mapping

    MethodName = str
    AnyEstimator = Estimator
else:
    MethodName = Literal[tuple(ESTIMATORS)]
    AnyEstimator = Annotated[
        Annotated[reduce(or_, ESTIMATORS.values()), Field(discriminator="method")],
        BeforeValidator(_named),
    ]


_ADAPTER: TypeAdapter[Any] = TypeAdapter(AnyEstimator)


def make_estimator(method: str | Estimator, options: Mapping[str, Any]) -> Estimator:
    """Return the estimator of a method with its options; an estimator stays as it is.

    Raises
    ------
    InputError
        If there is no such method, or it has no such option, or a value makes no sense.
    """
    if isinstance(method, Estimator):
        if options:
            expected = "none beside an estimator, whose fields they are"
            raise InputError(method.method, "options", ", ".join(options), expected)
        return method
    if not isinstance(method, str):
        raise InputError("estimator", "method", method, nearest(str(method), ESTIMATORS))
    try:
        made: Estimator = _ADAPTER.validate_python({"method": method, **options})
    except ValidationError as error:
        first = error.errors()[0]
        cause = first.get("ctx", {}).get("error")
        if isinstance(cause, InputError):
            raise cause from None
        field = next((str(part) for part in first["loc"] if part in options), "options")
        raise InputError(method, field, repr(first["input"]), first["msg"]) from None
    return made
