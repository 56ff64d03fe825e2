"""How to re-calibrate: the options that re-calibration and on-line estimation share."""

from __future__ import annotations

from dataclasses import dataclass

from butterfly.errors import InputError, nearest, require_number
from butterfly.identification.test_functions import HALF_WIDTH, AveragingSettings, Balance
from butterfly.model.terms import FrictionTerms, offered

METHOD = "re-calibration"

CANDIDATES = offered(METHOD)
"""Terms that can be estimated besides p1..p4."""

BASE = ("p1", "p2", "p3", "p4")
"""Always estimated."""

LEAST = {"p4": 0.0}
"""Bounds besides those of the table of terms: the input drives forwards."""


@dataclass(frozen=True, kw_only=True)
class RecalibrationOptions:
    """How to re-calibrate.

    Parameters
    ----------
    balance
        Of momentum (the weak form) or of energy.
    candidates
        Of `CANDIDATES`; each is kept only if it predicts held-out parts of the logs better.
    half_width
        Of the test functions in s.
    delay
        From input to torque in s, as known.
    cogging_periods
        Of the cogging torque in a turn, as known; the sine of one period a turn is what p3 is.
    """

    balance: Balance = Balance.MOMENTUM
    candidates: tuple[str, ...] = ("coulomb", "drag", "p3_offset", "bias", "compression")
    half_width: float = HALF_WIDTH
    delay: float = 0.0
    cogging_periods: float = 1.0

    def __post_init__(self) -> None:
        for name in self.candidates:
            if name not in CANDIDATES:
                raise InputError("recalibration", "candidates", name, nearest(name, CANDIDATES))
        if "cogging" in self.candidates and self.cogging_periods == 1:
            expected = "2 or more: one period a turn cannot be told from p3"
            raise InputError("recalibration", "cogging_periods", 1, expected)
        require_number("recalibration", positive=True, half_width=self.half_width)
        require_number("recalibration", delay=self.delay)

    def known(self, zero: float) -> AveragingSettings:
        """Return what is known of the joint, its encoder reading ``zero`` rad at angle 0."""
        settings = FrictionTerms(cogging_periods=self.cogging_periods)
        return AveragingSettings(zero=zero, delay=self.delay, settings=settings)
