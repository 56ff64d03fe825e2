"""What an estimator returns: values with covariance, intervals and findings."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache, cached_property
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainSerializer,
    PlainValidator,
    TypeAdapter,
)

from butterfly.arrays import Samples, SavedSamples
from butterfly.files import finite
from butterfly.identification.agreement import Contrast
from butterfly.identification.fit import MissingTerms
from butterfly.identification.limits import Evidence, Rival, half_widths
from butterfly.identification.trust import (
    KINDS,
    Ending,
    Finding,
    FindingKind,
    Parameter,
    Trust,
    meaning_of,
    or_nan,
    or_none,
    trust_of,
    unit_of,
)
from butterfly.logs.log import InputKind, Log
from butterfly.logs.units import taken_text
from butterfly.model.parameters import AddedMass, JointKind, LumpedParameters
from butterfly.model.prior import NO_PRIOR, Prior
from butterfly.model.terms import OF_INPUT, OF_SCALE, PARAMETERS, TERMS, lower_bounds
from butterfly.verdict import SPREADS, Level

_OF_UNIT = {FindingKind.UNIT_ASSUMED, FindingKind.UNIT_UNREAD}
_LARGEST = float(np.finfo(float).max) ** 0.25  # of any number: squares of such are numbers too
_MASS = TypeAdapter(AddedMass)


def _reading(read: Callable[[Any], Any]) -> BeforeValidator:
    """Return what reads a field before its type is checked; ValueError if it cannot."""

    def checked(content: Any) -> Any:  # noqa: ANN401 - whatever is in a file
        try:
            return read(content)
        except (LookupError, TypeError, AttributeError) as error:
            raise ValueError(f"{type(error).__name__}: {error}") from None

    return BeforeValidator(checked)


def _pairs(mapping: Mapping[Any, Any]) -> list[list[Any]]:
    """Return what JSON holds of a mapping whose keys are masses, or names."""
    return [[asdict(k) if isinstance(k, AddedMass) else k, v] for k, v in mapping.items()]


_AsPairs = (
    _reading(
        lambda pairs: {_MASS.validate_python(k) if isinstance(k, dict) else k: v for k, v in pairs}
    ),
    PlainSerializer(_pairs),
)
_Number = Annotated[float, _reading(or_nan)]
_Known = Annotated[Prior, PlainValidator(Prior.of), PlainSerializer(Prior.to_dict)]
# of older programs: findings of kinds that no longer exist, rivals that are lists of values
_Findings = Annotated[
    tuple[Finding, ...], _reading(lambda all_: [f for f in all_ if f["kind"] in KINDS])
]
_Rival = Annotated[Rival, _reading(lambda r: {"values": r} if isinstance(r, list) else r)]
_Missing = Annotated[MissingTerms, _reading(lambda missing: missing or {})]
_Least = Annotated[
    SavedSamples | None,
    AfterValidator(lambda x: x if x is None else np.where(np.isnan(x), -np.inf, x)),
]
_Horizon = Annotated[
    float | None,
    _reading(lambda horizon: math.inf if horizon == "whole" else horizon),
    PlainSerializer(lambda horizon: "whole" if horizon == math.inf else horizon),
]

Truth: TypeAlias = LumpedParameters | Mapping[str, float]
"""True values, where they are known."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """Parameters of the bare hand, with covariance, intervals and findings."""

    method: str  # how they were obtained
    names: tuple[str, ...]  # the n that were estimated: PARAMETERS of model.terms, then terms
    values: SavedSamples  # (n,) in their order
    covariance: SavedSamples  # (n, n); NaN where the method gives none
    lower: SavedSamples  # (n,) limits of the 95 % intervals
    upper: SavedSamples
    # (n,) estimates without the logs of one added mass, or one run; none if there are too few
    left_out: Mapping[Hashable, SavedSamples] = field(default_factory=dict)
    # number of the column-scaled regression, or Jacobian
    condition: _Number = math.nan
    on_bound: tuple[str, ...] = ()  # parameters on an active bound
    ending: Ending = Ending.CONVERGED
    findings: _Findings = ()  # on identifiability, fit and known values
    # not estimated, and not the defaults
    fixed: Annotated[dict[str, float], Field(alias="held")] = field(default_factory=dict)
    # in rad/s by added mass, where the method uses them
    resonances: Annotated[dict[AddedMass, _Number], *_AsPairs] = field(default_factory=dict)
    # of one log (by its name), one added mass or all (None), where the method estimates them:
    # ``zero`` (the encoder's reading in rad at the model's angle 0), ``velocity`` (at the first
    # sample, in rad/s) and ``bias``
    local: Annotated[dict[AddedMass | str | None, dict[str, _Number]], *_AsPairs] = field(
        default_factory=dict
    )
    # parameters that follow a condition though they should be constant, the largest share first
    agreement: tuple[Contrast, ...] = ()
    rivals: tuple[_Rival, ...] = ()  # other values that may be right, which the intervals include
    bias: SavedSamples | None = None  # (n,) errors that a misfit of torques may have caused
    simulator: SavedSamples | None = None  # (n,) standard errors by the simulator of the logs
    least: _Least = None  # (n,) lower bounds of the values; None: those of every joint
    # terms that the choice left out though they help
    missing: _Missing = field(default_factory=MissingTerms)
    # longest stretch in s over which logs are simulated with it; infinite where whole logs were
    # asked for, None where it is left to the logs (see `identification.segments`)
    horizon: _Horizon = None
    known: _Known = NO_PRIOR  # exactly known values are among ``fixed`` too
    freedom: SavedSamples | None = None  # (n,) degrees, of the standard errors
    # gives units, with the joint; None if unknown
    input_kind: Annotated[InputKind | None, Field(alias="input")] = None
    joint: JointKind = JointKind.HINGE

    @property
    def named(self) -> dict[str, float]:
        """The n values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    def limits_of(self, name: str, otherwise: float) -> tuple[float, float]:
        """Return the limits of a parameter by name; ``otherwise`` twice if it was not fitted."""
        if name not in self.names:
            return otherwise, otherwise
        k = self.names.index(name)
        return float(self.lower[k]), float(self.upper[k])

    @property
    def parameters(self) -> LumpedParameters:
        """The estimate as parameters of the model."""
        return LumpedParameters(**self.fixed | self.named)

    @property
    def ratios(self) -> bool:
        """Whether the values are ratios to p1, which is neither known nor estimated."""
        return "p1" not in {*self.names, *self.fixed}

    @property
    def unestimated(self) -> tuple[str, ...]:
        """Names of values that the method sets without estimating them, by its finding."""
        findings = (
            finding for finding in self.findings if finding.kind is FindingKind.NOT_ESTIMATED
        )
        return next((finding.parameters for finding in findings), ())

    @property
    def open(self) -> tuple[str, ...]:
        """Names of the parameters of the scale for which these data give only a limit.

        Their half-width is at least their value: they might be 0, which no joint has.
        """
        widths = self.relative_half_widths
        scale = (name for name in OF_SCALE if name not in self.unestimated)
        return tuple(name for name in scale if 1 <= widths.get(name, 0.0) < math.inf)

    @property
    def at_limit(self) -> Estimate:
        """The same with an inertia that is open at its limit."""
        if "p1" not in self.open:
            return self
        at = np.array(self.names) == "p1"
        return replace(self, values=np.where(at, abs(self.values) + self.farther, self.values))

    def table(self, truth: Truth | None = None) -> tuple[Parameter, ...]:
        """Return a row per parameter, with the truth if given; those known exactly come last."""
        if isinstance(truth, LumpedParameters):
            truth = asdict(truth)
        errors = self.standard_errors
        rows = []
        for k, name in enumerate(self.names):
            if name in self.unestimated:
                continue
            if name in self.open:
                most = float(abs(self.values[k]) + self.farther[k])
                least = 0.0 if name == "p1" else -most
                rows.append(self._row(name, truth, value=None, lower=least, upper=most))
                continue
            left_out = [float(values[k]) for values in self.left_out.values()]
            rows.append(
                self._row(
                    name,
                    truth,
                    value=float(self.values[k]),
                    standard_error=or_none(errors[k]),
                    lower=or_none(self.lower[k]),
                    upper=or_none(self.upper[k]),
                    least_left_out=min(left_out, default=None),
                    largest_left_out=max(left_out, default=None),
                    on_bound=name in self.on_bound,
                )
            )
        exact: dict[str, Any] = {"standard_error": 0.0, "known": True}
        rows += [
            self._row(name, truth, value=value, lower=value, upper=value, **exact)
            for name, value in self.given.fixed.items()
        ]
        return tuple(rows)

    @property
    def given(self) -> Prior:
        """The values that were given, without the 0 of p4 and delay where there is no input."""
        if self.input_kind is not InputKind.NONE:
            return self.known
        absent = {name for name in OF_INPUT if self.known.fixed.get(name) == 0}
        return self.known.within(self.known.values.keys() - absent)

    def _row(self, name: str, truth: Mapping[str, float] | None, **numbers: Any) -> Parameter:  # noqa: ANN401 - as of `Parameter`
        term = TERMS[name]
        unit = unit_of(name, self.input_kind, self.joint)
        if self.ratios and not term.of_gain:
            unit = f"{unit}/({unit_of('p1', self.input_kind, self.joint)})"
        meaning, doubted = meaning_of(name, self.joint), False
        for finding in self.findings:
            if finding.parameters[:1] == (name,) and finding.kind in _OF_UNIT:
                silent = finding.kind is FindingKind.UNIT_ASSUMED
                meaning += f"; {taken_text(finding.parameters[1], silent=silent)}"
                doubted |= finding.doubts
        row = Parameter(
            name=name,
            meaning=meaning,
            unit=unit,
            true=None if truth is None else float(truth[name]),
            **numbers,
        )
        return replace(row, claim=row.rated(doubted=doubted).claim)

    def to_dict(self, truth: Truth | None = None) -> dict[str, Any]:
        """Return all fields, as JSON can hold them."""
        document: dict[str, Any] = finite(
            {
                **_saved().dump_python(self, mode="json", by_alias=True, exclude=_IN_PARAMETERS),
                "ratios": self.ratios,
                "parameters": {row["name"]: row for row in map(asdict, self.table(truth))},
                # what simulations use for them
                "unestimated": {n: self.named[n] for n in (*self.unestimated, *self.open)},
                "covariance": {"names": list(self.names), "matrix": self.covariance.tolist()},
                "left_out": left_out_content(self.names, self.left_out),
            }
        )
        return document

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Estimate:
        """Return the estimate of a `to_dict`; ValueError that names a field if it is none."""
        return _saved().validate_python(content).consistent

    @property
    def consistent(self) -> Estimate:
        """The same estimate; ValueError if its parts do not belong together."""
        named = {*self.names, *self.on_bound, *self.fixed, *self.unestimated}
        if not named <= TERMS.keys() or len({*self.names}) < len(self.names):
            raise ValueError("names that are no parameters, or twice the same")
        shape, covariance = self.values.shape, self.covariance
        if any(array.shape != shape for array in self._arrays) or covariance.shape != 2 * shape:
            raise ValueError("not as many values as names")
        errors = np.sqrt(np.nan_to_num(np.abs(np.diag(covariance))))
        rounded = 1e-9 * np.outer(errors, errors)  # where one is 0 but for rounding
        if not np.allclose(covariance, covariance.T, atol=rounded, equal_nan=True):
            raise ValueError("a covariance that is not symmetric")
        if (np.diag(covariance) < 0).any():
            raise ValueError("variances below 0")
        if self.freedom is not None and (self.freedom <= 0).any():
            raise ValueError("degrees of freedom that are not above 0")
        return self

    @property
    def usable(self) -> Estimate:
        """The same estimate; ValueError if its numbers are not finite or too large."""
        if not all(np.isfinite(array).all() for array in self._arrays):
            raise ValueError("values that are no numbers")
        others = (self.covariance, self.lower, self.upper, np.array(self.condition))
        if any((np.abs(array) > _LARGEST).any() for array in (*self._arrays, *others)):
            raise ValueError(f"numbers above {_LARGEST:g}")
        return self

    @property
    def _arrays(self) -> tuple[Samples, ...]:
        """(n,) arrays that hold a number for each name."""
        maybe = [self.freedom, self.bias, self.simulator, self.missing.rival]
        for rival in self.rivals:
            maybe += [rival.values, rival.half_widths]
        some = (array for array in maybe if array is not None)
        return (self.values, *self.left_out.values(), *some)

    @cached_property
    def level(self) -> Level:
        """Verdict on the values: good if the relative half-widths of the scale are small.

        Of a scale that is open, no value is given: the others decide.
        """
        if self.unsettled or any(finding.forbids for finding in self.findings):
            return Level.WARNING
        widths, trust = self.relative_half_widths, self.trust
        deciding = [name for name in OF_SCALE if name in widths]
        if self.open:  # then all others that are not 0 decide
            deciding = [n for n in PARAMETERS if n != "delay" and widths.get(n, math.inf) < 1]
        near = all(trust[name].level is Level.GOOD for name in deciding)
        near = near and bool(deciding or not self.open)
        doubted = any(finding.doubts for finding in self.findings)
        return Level.GOOD if near and not doubted else Level.CARE

    @property
    def trust(self) -> dict[str, Trust]:
        """How far each of the n values can be trusted, by its limits."""
        rows = zip(self.values.tolist(), self.lower.tolist(), self.upper.tolist(), strict=True)
        ratings = (trust_of(*row) for row in rows)
        rated = dict(zip(self.names, ratings, strict=True))
        return rated | dict.fromkeys(self.open, Trust.OPEN)

    @property
    def unsettled(self) -> bool:
        """Whether the fit did not converge, although it was not stopped."""
        stopped = any(finding.kind is FindingKind.SEARCH_STOPPED for finding in self.findings)
        return self.ending is not Ending.CONVERGED and not stopped

    @property
    def farther(self) -> Samples:
        """(n,) distances of each value from the farther limit of its interval."""
        return np.maximum(self.upper - self.values, self.values - self.lower)

    @property
    def interval_covariance(self) -> Samples:
        """(n, n) covariance, enlarged to the standard errors of the intervals."""
        errors = self.standard_errors
        widest = np.maximum(self.farther / SPREADS, errors)
        scale = np.divide(widest, errors, out=np.ones_like(errors), where=errors > 0)
        return np.asarray(self.covariance * np.outer(scale, scale))

    @property
    def relative_half_widths(self) -> dict[str, float]:
        """`farther` of each parameter over its value; infinite if unknown."""
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.nan_to_num(self.farther / np.abs(self.values), nan=np.inf)
        return dict(zip(self.names, shares.tolist(), strict=True))

    @property
    def standard_errors(self) -> Samples:
        """(n,) square roots of the variances."""
        return np.sqrt(np.diag(self.covariance))

    def applied(self, log: Log) -> tuple[LumpedParameters, dict[str, float]]:
        """Return the parameters of one log, and its zero and velocity where these are known."""
        local: dict[str, float] = {}
        for key in (None, log.added_mass, log.name):
            local |= self.local.get(key, {})
        if log.zero is not None and log.zero.fixed:
            local["zero"] = log.zero.value
        parameters = self.parameters
        return replace(parameters, bias=local.pop("bias", parameters.bias)), local

    def owners(self, masses: Iterable[AddedMass]) -> list[tuple[str, AddedMass | str | None]]:
        """Return name and owner of each zero (of ``masses``, if none was fitted) and bias."""
        owners = [
            (name, whose)
            for whose, values in self.local.items()
            for name in values
            if name != "velocity"
        ]
        if not any(name == "zero" for name, _ in owners):
            owners += [("zero", mass) for mass in masses]
        return owners

    def with_findings(self, *more: Finding) -> Estimate:
        """Return the estimate with further findings."""
        return replace(self, findings=(*self.findings, *more))

    @property
    def evidence(self) -> Evidence:
        """What its limits rest on; without degrees of freedom, the limits themselves."""
        half = self.farther
        if self.freedom is not None:
            of_simulator = 0.0 if self.simulator is None else np.diag(self.simulator**2)
            half = half_widths(self.covariance - of_simulator, self.freedom)
        return Evidence(
            values=self.values,
            half=half,
            least=lower_bounds(self.names) if self.least is None else self.least,
            left_out=[*self.left_out.values()],
            rivals=self.rivals,
            bias=self.bias,
            simulator=self.simulator,
        )

    def with_evidence(self, *rivals: Rival, simulator: Samples | None = None) -> Estimate:
        """Return the estimate with more rivals, and (n,) errors of a simulator, in its limits."""
        estimate = replace(self, rivals=(*self.rivals, *rivals))
        if simulator is not None:
            whole = simulator if self.simulator is None else np.hypot(simulator, self.simulator)
            covariance = self.covariance + np.outer(simulator, simulator)
            estimate = replace(estimate, simulator=whole, covariance=covariance)
        lower, upper = estimate.evidence.limits
        return replace(estimate, lower=lower, upper=upper)

    def resting_on(self, error: Samples) -> Estimate:
        """Return the estimate with (n,) errors of its logs' simulator, as standard uncertainty."""
        most = int(np.argmax(np.abs(error) / np.maximum(self.farther, np.finfo(float).tiny)))
        share = abs(error[most]) / max(abs(self.values[most]), abs(error[most]))
        finding = Finding(FindingKind.PLANT, (self.names[most],), number=float(share))
        return self.with_evidence(simulator=error).with_findings(finding)


def left_out_content(
    names: Sequence[str], left_out: Mapping[Hashable, Iterable[float]]
) -> list[dict[str, Any]]:
    """Return the leave-one-out estimates, by added mass, log or part, as JSON can hold them."""
    content = []
    for key, values in left_out.items():
        carried = {"added_mass": asdict(key)} if isinstance(key, AddedMass) else {}
        named = dict(zip(names, map(float, values), strict=True))
        content.append({"without": str(key), **carried, "values": named})
    return content


_IN_PARAMETERS = {"names", "values", "lower", "upper", "covariance", "left_out"}
"""Fields that documents have by parameter."""


def _by_name(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return a document with what it has by parameter, in the order of names."""
    names = content["covariance"]["names"]
    rows, others = content["parameters"], content["unestimated"]
    left_out = {
        _MASS.validate_python(part["added_mass"]) if "added_mass" in part else part["without"]: [
            part["values"][name] for name in names
        ]
        for part in content["left_out"]
    }
    return {
        **content,
        "names": names,
        "values": [others[name] if name in others else rows[name]["value"] for name in names],
        "lower": [rows.get(name, {}).get("lower") for name in names],
        "upper": [rows.get(name, {}).get("upper") for name in names],
        "covariance": content["covariance"]["matrix"] or np.zeros((0, 0)),
        "left_out": left_out,
    }


@cache
def _saved() -> TypeAdapter[Estimate]:
    return TypeAdapter(Annotated[Estimate, _reading(_by_name)])
