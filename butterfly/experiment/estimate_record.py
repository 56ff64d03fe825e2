"""What is kept of an estimate: a record of it, and one of each of its parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pydantic import computed_field

from butterfly.identification.diagnostics.findings import Ending, Finding, grade
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FitSummary
from butterfly.model.parameters import LumpedParameters
from butterfly.verdict import Level


@dataclass(frozen=True, kw_only=True)
class ParameterRecord:
    """One parameter of an estimate; None where there is nothing to say.

    Parameters
    ----------
    parameter
        Its name.
    value, standard_error, lower, upper
        Estimate, and limits of its 95 % interval.
    least_left_out, largest_left_out
        Range of the estimates that leave the logs of one added mass out.
    true
        Where it is known.
    on_bound
        Whether a bound holds it.
    known
        Whether it was known exactly, and is no estimate.
    """

    parameter: str
    value: float
    standard_error: float | None
    lower: float | None
    upper: float | None
    least_left_out: float | None = None
    largest_left_out: float | None = None
    true: float | None = None
    on_bound: bool = False
    known: bool = False

    @classmethod
    def all_of(
        cls, found: Estimate, truth: LumpedParameters | None = None
    ) -> tuple[ParameterRecord, ...]:
        """Return a record for each parameter of an estimate, beside the truth if it is known.

        Those that were known exactly come last; those that the method does not estimate have none.
        """
        columns = (found.values, found.standard_errors, found.lower, found.upper)
        rows = zip(found.names, *(column.tolist() for column in columns), strict=True)
        records = []
        for k, (name, value, error, lower, upper) in enumerate(rows):
            if name in found.unestimated:
                continue
            others = [float(values[k]) for values in found.left_out.values()]
            records.append(
                cls(
                    parameter=name,
                    value=value,
                    standard_error=or_none(error),
                    lower=or_none(lower),
                    upper=or_none(upper),
                    least_left_out=min(others, default=None),
                    largest_left_out=max(others, default=None),
                    true=None if truth is None else float(getattr(truth, name)),
                    on_bound=name in found.on_bound,
                )
            )
        for name, value in found.known.exact.items():
            true = None if truth is None else float(getattr(truth, name))
            records.append(
                cls(
                    parameter=name,
                    value=value,
                    standard_error=0.0,
                    lower=value,
                    upper=value,
                    true=true,
                    known=True,
                )
            )
        return tuple(records)

    @property
    def deviation(self) -> float | None:
        """Relative deviation from the truth, where that is known and not 0."""
        return self.value / self.true - 1 if self.true else None


@dataclass(frozen=True, kw_only=True)
class EstimateRecord:
    """What an estimator gave.

    Parameters
    ----------
    estimator
        Its label.
    ending
        How it came to its values, or that it refused.
    error
        Why there are none, or no held-out FIT.
    parameters
        The estimate; empty if there is none.
    condition
        Condition number of its regression.
    findings
        What to know about it.
    fit, held_out
        FIT in per cent, of the logs it was fitted to and of what was left out in turns.
    holdout
        FIT in per cent of the logs that were named to be held out.
    """

    estimator: str
    ending: Ending
    error: str = ""
    parameters: tuple[ParameterRecord, ...] = ()
    condition: float | None = None
    findings: tuple[Finding, ...] = ()
    fit: FitSummary | None = None
    held_out: FitSummary | None = None
    holdout: FitSummary | None = None

    @classmethod
    def of(
        cls,
        estimator: str,
        found: Estimate,
        fit: FitSummary,
        truth: LumpedParameters,
        holdout: FitSummary | None = None,
    ) -> EstimateRecord:
        """Return the record of an estimate."""
        return cls(
            estimator=estimator,
            ending=found.ending,
            parameters=ParameterRecord.all_of(found, truth),
            condition=or_none(found.condition),
            findings=found.findings,
            fit=fit,
            holdout=holdout,
        )

    @property
    def converged(self) -> bool:
        """Whether the values are where the estimator wanted to be."""
        return self.ending is Ending.CONVERGED

    @property
    def level(self) -> Level:
        """How much speaks against the values."""
        return grade(self.ending, self.findings)[0]

    @computed_field  # type: ignore[prop-decorator]
    @property
    def verdict(self) -> str:
        """What may be done with the values: good, use with care, or do not use."""
        return self.level.verdict


def or_none(value: float) -> float | None:
    """Return a number that is finite; JSON has no others."""
    return value if math.isfinite(value) else None


def or_nan(value: float | None) -> float:
    """Return a number of which JSON may have none (see `or_none`)."""
    return math.nan if value is None else value
