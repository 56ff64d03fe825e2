"""Base of all estimators: terms, label, and usable known values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self

from butterfly.errors import InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.infer import infer
from butterfly.model.terms import PARAMETERS


@dataclass(frozen=True, kw_only=True)
class Estimator:
    """Base class of the estimators: frozen, with its options as fields; call it with a data set.

    Parameters
    ----------
    method
        Name of the estimator.
    """

    method: str = ""

    summary: ClassVar[str]
    """What it does, in a few words."""

    def __call__(self, data: DataSet) -> Estimate:
        """Estimate the parameters of the robot from its logs.

        Raises
        ------
        InputError
            If the logs cannot be used.
        IdentifiabilityError
            If they cannot determine the parameters.
        """
        problem, fit = self.fit(data)
        return self.infer(problem, fit)

    def fit(self, data: DataSet) -> tuple[Any, Any]:
        """Return what inference needs beside a fit of logs, and the end of the fit."""
        raise NotImplementedError

    def choose(self, problem: Any, fit: Any) -> tuple[Any, Any]:  # noqa: ANN401 - of `fit`
        """Choose the terms of a fit; most fit those that they are given."""
        return problem, fit

    def weigh(self, problem: Any, fit: Any) -> Any:  # noqa: ANN401, ARG002 - of `fit`
        """Weigh the logs of a fit; most give each the same weight."""
        return fit

    def infer(self, problem: Any, fit: Any) -> Estimate:  # noqa: ANN401 - of `fit`
        """Return the estimate of a fit: values, covariance, limits and findings."""
        return infer(fit, problem)

    @property
    def label(self) -> str:
        """Short name for tables: the method and its options other than the defaults."""
        parts: list[str] = []
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in {"method", "workers"} or value == field.default:
                continue
            if field.name == "terms":
                parts += value or ["no terms"]
            elif isinstance(value, str):
                parts.append(str(value))
            else:
                listed = " ".join(value) if isinstance(value, tuple) else value
                parts.append(f"{field.name} {listed}")
        return f"{self.method}({', '.join(parts)})" if parts else self.method

    def with_terms(self, terms: tuple[str, ...]) -> Self:
        """Return the estimator with other terms."""
        if not hasattr(self, "terms"):
            raise InputError(
                self.method,
                "terms",
                ", ".join(terms) or "none",
                "no terms: this method has no such option",
            )
        options: dict[str, Any] = {"terms": terms}
        return replace(self, **options)

    def path(self, data: DataSet, offers: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:  # noqa: ARG002
        """Return the terms after each round of a choice; only output error chooses terms."""
        self.with_terms(offers)
        expected = "the method output-error: this one fits the terms that it is given"
        raise InputError(self.method, "terms", "a choice of terms", expected)

    def near(self, estimate: Estimate) -> Callable[[DataSet], Estimate]:  # noqa: ARG002
        """Return the estimator with its search, if any, started at an estimate."""
        return self

    def holding_terms_of(self, estimate: Estimate) -> Self:
        """Return the estimator with the terms of one of its estimates, without a choice."""
        if not hasattr(self, "terms"):
            return self
        return self.with_terms(tuple(name for name in estimate.names if name not in PARAMETERS))
