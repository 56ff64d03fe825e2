"""Other parameters on the same logs: a data sheet's, a colleague's, a published table's."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from butterfly.errors import InputError, nearest, require_number
from butterfly.identification.data import DataSet
from butterfly.identification.free_run import FitSummary
from butterfly.model.harmonic import quasi_linear_response
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import LumpedParameters
from butterfly.progress import Track, untracked

_DECADES = 1.0  # the best p4 is sought within a factor 10 of the first guess
_TOO_FAST = 3.0  # times the fastest that samples can show
_GRID = 41  # values of p4 tried before the best is sought


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherParameters:
    """How well given parameters move like the robot.

    Parameters
    ----------
    name
        Where the parameters come from.
    parameters
        Of the bare hand.
    gain_fitted
        Whether p4 was chosen here, for the highest median FIT.
    fits
        (n,) FIT of each log in per cent.
    horizon
        Longest stretch in s that was simulated at a time.
    """

    name: str
    parameters: LumpedParameters
    gain_fitted: bool
    fits: NDArray[np.float64]
    horizon: float = math.inf

    @property
    def summary(self) -> FitSummary:
        """Median, mean and worst FIT."""
        return FitSummary.of(self.fits, self.horizon)


def try_parameters(
    name: str,
    parameters: LumpedParameters,
    data: DataSet,
    *,
    horizon: float = math.inf,
    track: Track = untracked,
) -> OtherParameters:
    """Simulate every log with ``parameters``; a p4 that is NaN is replaced by the best one.

    Parameters
    ----------
    name
        Where the parameters come from.
    parameters
        Of the bare hand.
    data
        The logs.
    horizon
        Longest stretch in s that is simulated at a time.
    track
        Shows progress.
    """
    gain_fitted = math.isnan(parameters.p4)
    if gain_fitted:
        gain = best_gain(parameters, data, source=name, track=track)
        parameters = replace(parameters, p4=gain)
    fits = data.simulations.fits_with(parameters, horizon)
    return OtherParameters(
        name=name, parameters=parameters, gain_fitted=gain_fitted, fits=fits, horizon=horizon
    )


def told_parameters(told: Mapping[str, object], source: str) -> LumpedParameters:
    """Read parameters that somebody tells: p1 and p3, and whatever else is not 0.

    p4 is NaN if it is not among them.

    Raises
    ------
    InputError
        Naming ``source`` and the part that is wrong.
    """
    known = LumpedParameters.__dataclass_fields__
    values = {"p2": 0.0, "p4": math.nan}
    for name, value in told.items():
        if name not in known:
            raise InputError(source, name, "an unknown parameter", nearest(name, known))
        try:
            values[name] = float(value)  # type: ignore[arg-type]  # what is none is refused
        except (TypeError, ValueError):
            raise InputError(source, name, value, "a number") from None
    missing = {"p1", "p3"} - values.keys()
    if missing:
        raise InputError(source, min(missing), "nothing", "a value")
    require_number(source, positive=True, unit="kg m²", p1=values["p1"])
    return LumpedParameters(**values)


def best_gain(
    parameters: LumpedParameters,
    data: DataSet,
    *,
    source: str = "parameters",
    track: Track = untracked,
) -> float:
    """Return the p4 with the highest median FIT, the others held (see `try_parameters`).

    Raises
    ------
    InputError
        If no log is a sine, whose gain tells where to look; or if the joint would swing faster than
        any log could show.
    """
    if not data.sines:
        expected = "a value: no log is a sine, which would tell the best one"
        raise InputError(source, "p4", "nothing", expected)
    fastest, seen = resonance_frequency(parameters), math.pi / data.logs[0].mean_step
    if fastest > _TOO_FAST * seen:
        expected = f"at most the {seen:.3g} rad/s that samples show, or p4 too"
        raise InputError(source, "p3", f"a resonance of {fastest:.3g} rad/s", expected)
    unit = replace(parameters, p4=1.0)
    ratios = [
        abs(
            p.gain / quasi_linear_response(unit.with_added_mass(p.added_mass), p.omega, p.amplitude)
        )
        for p in data.sines
    ]
    guess = float(np.median(ratios))

    def loss(decades: float) -> float:
        trial = replace(parameters, p4=guess * 10**decades)
        return -float(np.median(data.simulations.fits_with(trial)))

    coarse = np.linspace(-_DECADES, _DECADES, _GRID)
    start = coarse[np.argmin([loss(x) for x in track(coarse, "Finding the best p4")])]
    width = coarse[1] - coarse[0]
    fine = minimize_scalar(loss, bounds=(start - width, start + width), method="bounded")
    return float(guess * 10**fine.x)
