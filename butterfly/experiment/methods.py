"""All estimators by method name, created from the options of a file or user."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError

from butterfly.errors import InputError, nearest
from butterfly.identification.estimators import DEFAULT_ESTIMATOR, DEFAULT_METHOD, Estimator
from butterfly.thesis.method import Thesis  # noqa: F401 - its being read makes it one of them
from butterfly.yaml_files import refusal

ESTIMATORS: dict[str, type[Estimator]] = {kind.method: kind for kind in Estimator.__subclasses__()}
"""All estimators by the name of their method."""

METHODS = (*ESTIMATORS, DEFAULT_METHOD)
"""Names of methods."""


def options_of(kind: type[Estimator]) -> list[str]:
    """Return the names of an estimator's options."""
    return [option.name for option in fields(kind) if option.name != "method"]


def kind_of(
    method: str, options: Iterable[str] = (), *, written: Callable[[str], str] = str
) -> type[Estimator]:
    """Return the class of a method's estimator; InputError for an unknown method or option.

    ``written`` spells a name as the user does.
    """
    if method not in METHODS:
        raise InputError("estimator", written("method"), method, nearest(method, METHODS))
    kind = DEFAULT_ESTIMATOR if method == DEFAULT_METHOD else ESTIMATORS[method]
    names = [written(name) for name in options_of(kind)]
    for name in map(written, options):
        if name not in names:
            expected = nearest(name, [*names, written("method")]) if names else "no option"
            raise InputError(f"{written('method')} {method}", name, "an unknown option", expected)
    return kind


def _named(estimator: Any) -> Any:  # noqa: ANN401 - whatever stands in the file
    """Add the default method to an estimator without one, and refuse options of others."""
    if not isinstance(estimator, dict):
        return estimator
    named = {"method": DEFAULT_METHOD} | estimator
    kind = kind_of(str(named["method"]), [str(name) for name in named if name != "method"])
    return named | {"method": kind.method}


if TYPE_CHECKING:
    MethodName = str
    AnyEstimator = Estimator
else:
    MethodName = Literal[METHODS]
    AnyEstimator = Annotated[
        Annotated[reduce(or_, ESTIMATORS.values()), Field(discriminator="method")],
        BeforeValidator(_named),
    ]


_ADAPTER: TypeAdapter[Any] = TypeAdapter(AnyEstimator)


def make_estimator(method: str | Estimator, options: Mapping[str, Any]) -> Estimator:
    """Return the estimator of a method with its options, or InputError; or a given estimator."""
    if isinstance(method, Estimator):
        if options:
            expected = "no options with an Estimator; set its fields instead"
            raise InputError(method.method, "options", ", ".join(options), expected)
        return method
    if not isinstance(method, str):
        raise InputError("estimator", "method", method, nearest(str(method), METHODS))
    content = {"method": method, **options}
    try:
        made: Estimator = _ADAPTER.validate_python(content)
    except ValidationError as error:
        raise refusal(error, method, content=content) from None
    return made
