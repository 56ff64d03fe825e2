"""The thesis's method as an estimator; the formulas stand in `butterfly.thesis.scripts`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from butterfly.errors import InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.base import Estimator
from butterfly.identification.parameters_by_hand import best_gain
from butterfly.thesis.scripts import DECIMATION, fit_thesis


@dataclass(frozen=True, kw_only=True)
class Thesis(Estimator):
    """p1, p2, p3 from the two largest gains of each added mass, as published, slips included.

    It estimates neither Coulomb torque nor delay; p4 is the one with the highest median FIT.

    Parameters
    ----------
    decimation
        Keep every n-th sample: 25 gives Table 4, 5 what Table 5 was computed from.
    """

    method: Literal["thesis"] = "thesis"
    decimation: int = DECIMATION

    summary: ClassVar[str] = "the thesis's own fit of resonances, its slips included"

    def __post_init__(self) -> None:
        if self.decimation < 1:
            raise InputError(self.method, "decimation", self.decimation, "1 or more")

    def __call__(self, data: DataSet) -> Estimate:
        """Estimate from the sines of a data set (see `Estimator`)."""
        found = fit_thesis(data.recorded, self.decimation)
        return found.with_gain(best_gain(found.parameters, data))
