"""The estimator that suits the logs, where nobody says which."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.base import Estimator
from butterfly.identification.estimators.harmonic_balance import HarmonicBalance
from butterfly.identification.estimators.output_error import OutputError
from butterfly.identification.estimators.steady_response import steady_sines
from butterfly.model.terms import PARAMETERS

_MOST = 0.8  # share of the logs that must have settled


@dataclass(frozen=True, kw_only=True)
class Suitable(Estimator):
    """Harmonic balance if all logs are steady sines, else output error.

    Nearly all sines must be steady, and outnumber the unknown parameters: harmonic balance
    estimates its errors from the differences between logs.

    Parameters
    ----------
    terms
        Terms fitted besides p1..p4, coulomb and delay; if not given, those that improve the
        prediction of held-out logs.
    """

    method: Literal["auto"] = "auto"
    terms: tuple[str, ...] | None = None

    summary: ClassVar[str] = "harmonic-balance if all logs are sines, else output-error"

    def suited(self, data: DataSet) -> Estimator:
        """Return the estimator that suits the logs of a data set."""
        if all(log.excitation for log in data.logs):
            steady, _ = steady_sines(data)
            enough = len(steady) > len(data.known.fitted(PARAMETERS))
            if enough and len(steady) >= _MOST * len(data.logs):
                return HarmonicBalance(terms=self.terms)
        return OutputError(terms=self.terms)

    def __call__(self, data: DataSet) -> Estimate:
        """Estimate as the estimator does that suits the logs (see `Estimator`)."""
        return self.suited(data)(data)
