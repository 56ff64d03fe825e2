"""The result of an identification: the estimate, and how it follows the logs.

Given parameters, simulated on the logs for comparison with or instead of an identification.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import minimize_scalar

from butterfly.arrays import Samples
from butterfly.errors import InputError, listed, nearest, require_number
from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary, FreeRun, WholeRuns
from butterfly.identification.physical import PhysicalParameters, judge_physics, physical_parameters
from butterfly.identification.residuals import Residuals, residuals_of
from butterfly.identification.trust import lumped_numbers
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import Manifest
from butterfly.model.linear import quasi_linear_response, resonance_frequency
from butterfly.model.parameters import (
    GRAVITY,
    NO_ADDED_MASS,
    AddedMass,
    JointKind,
    LumpedParameters,
)
from butterfly.model.prior import PHYSICAL, Known, Prior
from butterfly.model.terms import PARAMETERS
from butterfly.signals.frequency_response import measured_response

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


if TYPE_CHECKING:
    import control


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Identified:
    """The result of an identification."""

    estimate: Estimate
    """Parameters with covariance and findings."""

    estimator: str
    """Method and options, in a line."""

    origin: dict[str, Any]
    """The data: name, description, input, number of logs, what was known of the robot, its joint
    and gravity, and the manifest that the logs were read by."""

    fits: dict[str, float]
    """FIT in per cent of the free run of each log, by its name."""

    velocity_fits: dict[str, float] = field(default_factory=dict)
    """The same of its velocity."""

    held_out: dict[str, float] = field(default_factory=dict)
    """FIT in per cent of each that was held out."""

    mean_errors: dict[str, float] = field(default_factory=dict)
    """Mean absolute error in rad of each servo's log, held out or not, in its loop."""

    open_loop_fits: dict[str, float] = field(default_factory=dict)
    """FIT in per cent of each of these by its recorded or rebuilt drive alone."""

    zeros: dict[str, float] = field(default_factory=dict)
    """The encoder's reading in rad at angle 0 of each log; none where no gravity acts."""

    logs: DataSet | None = None
    """The data set; None for a result that was loaded, whose logs are read again by `data`."""

    runs: tuple[FreeRun, ...] = ()
    """Free run of each log; those of a result that was loaded are simulated by `free_runs`."""

    judged_residuals: Residuals | None = None
    """Residuals of the free runs; those of a result that was loaded are found by `residuals`."""

    comparisons: tuple[OtherParameters, ...] = ()
    """Other parameters on the same logs."""

    made_by: Estimator | None = None
    """The estimator; None for a result that was loaded."""

    whole: WholeRuns | None = None
    """Runs of whole logs from their start alone, where the free runs are over segments."""

    truth: LumpedParameters | None = None
    """The true parameters of the bare hand, where the logs were simulated."""

    saved: dict[str, Any] = field(default_factory=dict)
    """What a file said that needs the logs: summary, options, other parameters, residuals."""

    @property
    def parameters(self) -> LumpedParameters:
        """The parameters of the bare hand."""
        return self.estimate.parameters

    @property
    def covariance(self) -> Samples:
        """(n, n), in the order of `rows`."""
        return self.estimate.covariance

    def separated(self, known: Mapping[str, Any] = MappingProxyType({})) -> PhysicalParameters:
        """Return the physical parameters, with further known values by names of `PHYSICAL`."""
        before, new = Prior.of(self.origin.get("known", {})), Prior.of(known)
        for name in known:
            if name not in new.physical:
                raise InputError("physical", name, "no part of motor or hand", listed([*PHYSICAL]))
            if name in before.physical:
                expected = "what was not known before; else identify again with it"
                raise InputError("physical", name, known[name], expected)
        gravity = float(self.origin.get("gravity", GRAVITY))
        carrier = AddedMass(gravity=gravity, joint=self.estimate.joint)
        kind = InputKind(self.origin["input"])
        return physical_parameters(self.estimate, before | new, kind, carrier)

    @property
    def fit(self) -> FitSummary:
        """Median, mean and worst FIT in per cent."""
        return FitSummary.of(self.fit_of_logs, self.estimate.horizon, self.whole)

    @property
    def velocity_fit(self) -> FitSummary:
        """The same of the velocity."""
        return FitSummary.of(np.array([*self.velocity_fits.values()] or [np.nan]))

    @property
    def fit_of_logs(self) -> Samples:
        """(n,) FIT of each log in per cent."""
        return np.array([run.fit for run in self.runs] or list(self.fits.values()))

    @cached_property
    def data(self) -> DataSet:
        """The logs; of a loaded result read again, InputError if they cannot be."""
        if self.logs is not None:
            return self.logs
        manifest = self.origin["manifest"]
        if manifest is None or manifest["root"] is None:
            expected = "one whose logs came from one source of files, to be read again"
            raise InputError("a result that was loaded", "logs", "none", expected)
        return read_data_set(Manifest.model_validate(manifest))

    @cached_property
    def free_runs(self) -> tuple[FreeRun, ...]:
        """Simulation of each log with the estimate; raises as `data` does."""
        data = self.data
        return self.runs or tuple(
            data.simulations.run(number, self.estimate) for number in range(len(data.logs))
        )

    @cached_property
    def residuals(self) -> Residuals:
        """Residuals of the free runs, and whether the sensors explain them."""
        return self.judged_residuals or residuals_of(self.data, self.estimate, self.free_runs)

    def measured(self, added_mass: AddedMass = NO_ADDED_MASS) -> control.FrequencyResponseData:
        """Return the responses measured with an added mass, to compare with `model.linearised`.

        The mass is one of ``data.masses``; none if not given.
        """
        return measured_response(self.data.sines, added_mass)
