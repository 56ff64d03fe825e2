"""Given parameters, simulated on the logs for comparison with or instead of an identification."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from butterfly.errors import InputError, nearest, require_number
from butterfly.identification.data import DataSet
from butterfly.identification.free_run import FitSummary
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.parameter import lumped_numbers
from butterfly.identification.plausibility import judge_physics
from butterfly.model.linear import quasi_linear_response, resonance_frequency
from butterfly.model.parameters import AddedMass, JointKind, LumpedParameters
from butterfly.model.prior import Known
from butterfly.model.terms import PARAMETERS

_DECADES = 1.0  # the best p4 is sought within a factor 10 of the first guess


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherParameters:
    """How well given parameters move like the robot."""

    name: str  # Where the parameters come from
    parameters: LumpedParameters  # Of the bare hand
    gain_fitted: bool  # Whether p4 was chosen here, for the highest median FIT
    fit: FitSummary  # Over the logs

    def numbers(self, estimate: Estimate) -> dict[str, Any]:
        """Return it for programs, in the units of an estimate."""
        parameters = lumped_numbers(self.parameters, estimate.input_kind, estimate.joint)
        return {
            "name": self.name,
            "parameters": parameters,
            "gain_fitted": self.gain_fitted,
            "fit": self.fit.numbers(),
        }


def try_parameters(
    name: str,
    parameters: LumpedParameters,
    data: DataSet,
    *,
    horizon: float = math.inf,
) -> OtherParameters:
    """Simulate every log, at most ``horizon`` s at a time; the best p4 replaces one that is NaN."""
    gain_fitted = math.isnan(parameters.p4)
    if gain_fitted:
        parameters = replace(parameters, p4=best_gain(parameters, data, source=name))
    fit = FitSummary.of(data.simulations.fits_with(parameters, horizon), horizon)
    return OtherParameters(name=name, parameters=parameters, gain_fitted=gain_fitted, fit=fit)


def read_parameters(given: Mapping[str, object], source: str) -> LumpedParameters:
    """Return parameters by given p1, p3 and others that are not 0; p4 is NaN if not given."""
    known = LumpedParameters.__dataclass_fields__
    values = {"p2": 0.0, "p4": math.nan}
    for name, value in given.items():
        if name not in known:
            raise InputError(source, name, "an unknown parameter", nearest(name, known))
        values[name] = _number(value, source, name)
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
) -> float:
    """Return the p4 with the highest median FIT; InputError without sines or of too large p3."""
    if not data.sines:
        expected = "a value, as there is no sine log to estimate it from"
        raise InputError(source, "p4", "nothing", expected)
    fastest, nyquist = resonance_frequency(parameters), math.pi / data.logs[0].mean_step
    if fastest > nyquist:
        expected = f"at most {nyquist:.3g} rad/s, which the sampling rate resolves; or give p4 too"
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

    minimum = minimize_scalar(loss, bounds=(-_DECADES, _DECADES), method="bounded")
    return float(guess * 10**minimum.x)


def given_estimate(
    given: Mapping[str, object],
    source: str,
    *,
    data: DataSet | None = None,
    masses: Sequence[AddedMass] = (),
) -> Estimate:
    """Return given parameters as an estimate without uncertainties.

    ``given``: p1 and p3, and others that are not 0 and not known of the data; ``zero`` is the
    encoder's reading in rad where the model's angle is 0. Without p4 the one with the best FIT is
    taken. ``data``: the logs to be predicted, if there are any. InputError names the parameter that
    is wrong, or p4 where no log determines it.
    """
    values = ({} if data is None else data.known.fixed) | dict(given)
    zero = values.pop("zero", None)
    parameters = read_parameters(values, source)
    local: dict[AddedMass | str | None, dict[str, float]] = {}
    if zero is not None:
        local[None] = {"zero": _number(zero, source, "zero", "an angle in rad")}
        data = data and data.with_zero(Known(value=local[None]["zero"]))
    if math.isnan(parameters.p4):
        if data is None:
            raise InputError(source, "p4", "nothing", "a value")
        parameters = replace(parameters, p4=best_gain(parameters, data, source=source))
    numbers, unknown = asdict(parameters), np.full(len(PARAMETERS), np.nan)
    estimate = Estimate(
        method="given parameters",
        names=PARAMETERS,
        values=np.array([numbers[name] for name in PARAMETERS]),
        covariance=np.full((len(PARAMETERS), len(PARAMETERS)), np.nan),
        lower=unknown,
        upper=unknown,
        fixed={name: value for name, value in numbers.items() if name not in PARAMETERS},
        local=local,
        input_kind=None if data is None else data.input_kind,
        joint=JointKind.HINGE if data is None else data.joint,
    )
    return estimate.with_findings(*judge_physics(estimate, masses))


def _number(value: object, source: str, name: str, expected: str = "a number") -> float:
    try:
        return float(value)  # type: ignore[arg-type]  # others are refused
    except (TypeError, ValueError):
        raise InputError(source, name, value, expected) from None
