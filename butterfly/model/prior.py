"""Known values of a robot before its logs are fitted, and their weight in the fit.

A prior is not a cluster: its weight is 1/uncertainty^2 against rows scaled to the variance of their
clusters, and its own uncertainty adds to the covariance. With the information H of the data, the
middle B of its sandwich and the prior's precision P,

    Cov = (H + P)^-1 (B + P) (H + P)^-1.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import InputError, nearest
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.model.terms import BASE_TERMS, GEAR, PARAMETERS, SETTINGS, TERMS, TORQUES, offered

PHYSICAL = {
    "resistance": "Ohm",
    "torque_constant": "N m/A",
    "back_emf_constant": "V s/rad",
    "gear_ratio": "turns of the motor per turn of the joint",
    "rotor_inertia": "kg m²",
    "hand_mass": "kg",
}
"""Physical values that may be known, with units: see `butterfly.identification.physical`."""

SCALES = {
    "mass_scale": "of all added masses together",
    "gravity_scale": "of gravity in the plane of motion: the level of the bench",
    "input_scale": "of the recorded input",
    "angle_scale": "of the recorded angle",
    "time_scale": "of the recorded time",
}
"""Scales that no log shows: true over recorded or given values, 1 ± an uncertainty."""

LAG = "lag"
"""Of the recorded angle behind the input in s, by a filter of the logger: 0 ± an uncertainty."""

_USUAL_DELAY = 5.0  # steps of the clock, the scale of an unknown delay

_LARGEST = sys.float_info.max

_EXPECTED = "a number, or {value: ..., uncertainty: ...}"
_TEXT = re.compile(r"(?P<value>[^±]+?)\s*(?:(?:±|\+-|\+/-)\s*(?P<uncertainty>.+))?")


@dataclass(frozen=True, kw_only=True)
class Known:
    """A value, and its standard uncertainty in the same unit: 0 if it is known exactly."""

    value: float
    uncertainty: float = 0.0
    heavy: bool = False  # whether it is a guess: half a Cauchy distribution, from the value up
    held: bool = False  # whether it sets the scale of a fit, which holds it in spite of that
    origin: str = ""  # whose value it is, of a motor that others measured

    @property
    def fixed(self) -> bool:
        """Whether a fit holds it: it is known exactly, or sets the scale."""
        return self.held or self.uncertainty == 0

    def times(self, factor: float) -> Known:
        """Return the value and uncertainty times a factor."""
        return replace(self, value=factor * self.value, uncertainty=factor * self.uncertainty)

    def precision(self, at: float) -> float:
        """Return the weight of the equivalent square at a value."""
        distance = (at - self.value) / self.uncertainty
        return (2 / (1 + distance**2) if self.heavy else 1.0) / self.uncertainty**2

    def penalty(self, at: float) -> float:
        """Return -2 log of the density at a value relative to its peak."""
        square = ((at - self.value) / self.uncertainty) ** 2
        return 2 * math.log1p(square) if self.heavy else square

    def __str__(self) -> str:
        if self.heavy:
            return f"{self.value:g} to about {self.value + self.uncertainty:g}"
        return f"{self.value:g}" if self.fixed else f"{self.value:g} ± {self.uncertainty:g}"


@dataclass(frozen=True)
class Prior:
    """All known values of a robot; those without uncertainty are exact."""

    # By names of `TERMS`, `PHYSICAL` and `SCALES`, and `LAG`
    values: Mapping[str, Known] = field(default_factory=dict)

    @classmethod
    def of(cls, given: Mapping[str, Any], source: object = "known") -> Prior:
        """Read numbers, texts such as ``1 ± 0.02``, or mappings; ``source`` is named in errors."""
        if not isinstance(given, Mapping):
            raise InputError(str(source), "known", given, "a mapping such as {'p4': 1.0}")
        valid = (*TERMS, *PHYSICAL, *SCALES, LAG)
        for name in given:
            if name not in valid:
                expected = nearest(name, valid)
                raise InputError(str(source), f"known.{name}", "an unknown name", expected)
        values = {name: known_of(value, source, f"known.{name}") for name, value in given.items()}
        for name, known in values.items():
            _require_possible(source, name, known)
        return cls(values)

    def __bool__(self) -> bool:
        return bool(self.values)

    def __or__(self, other: Prior) -> Prior:
        """Return both; the values of the other take precedence."""
        return Prior({**self.values, **other.values})

    @cached_property
    def parameters(self) -> dict[str, Known]:
        """Known parameters of the model."""
        return {name: known for name, known in self.values.items() if name in TERMS}

    @property
    def lower(self) -> dict[str, float]:
        """Lower ends of the half distributions."""
        return {name: known.value for name, known in self.parameters.items() if known.heavy}

    @cached_property
    def physical(self) -> dict[str, Known]:
        """Known physical values of motor and joint."""
        return {name: known for name, known in self.values.items() if name in PHYSICAL}

    @cached_property
    def scales(self) -> dict[str, float]:
        """Uncertainties of the scales."""
        return {name: known.uncertainty for name, known in self.values.items() if name in SCALES}

    @cached_property
    def fixed(self) -> dict[str, float]:
        """Values of the exactly known parameters."""
        return {name: known.value for name, known in self.parameters.items() if known.fixed}

    @cached_property
    def uncertain(self) -> dict[str, Known]:
        """Parameters known with an uncertainty."""
        return {name: known for name, known in self.parameters.items() if not known.fixed}

    def scale(self, carried: AddedMass = NO_ADDED_MASS) -> tuple[str, ...]:
        """Names of the known torques that are not 0 with an added mass: they set the scale."""
        torques = (name for name in self.parameters if name in TORQUES)
        return tuple(name for name in torques if self._at(name, carried) != 0)

    def _at(self, name: str, carried: AddedMass) -> float:
        """Return a known parameter under an added mass."""
        return self.parameters[name].value + carried.loads.get(name, 0.0)

    def reference(self, carried: AddedMass = NO_ADDED_MASS) -> str | None:
        """Name of the most precise torque of the scale; None if a fixed one sets it."""
        scale, known = self.scale(carried), self.parameters
        if not scale or any(known[name].fixed for name in scale):
            return None
        return min(scale, key=lambda name: known[name].uncertainty / abs(self._at(name, carried)))

    def weightless(self, masses: Iterable[AddedMass]) -> bool:
        """Whether no gravity moment acts with any of the masses, whatever the encoder zero."""
        carried = list(masses)
        balanced = self.fixed.get("p3") == 0 and not any(mass.gravity_moment for mass in carried)
        return balanced or not any(mass.gravity for mass in carried)

    def with_default_delay(self, step: float) -> Prior:
        """Return the prior, by default with half a Cauchy distribution of the delay.

        Its scale is set by the ``step`` of the clock; it only matters if the logs do not determine
        the delay.
        """
        usual = Known(value=0.0, uncertainty=_USUAL_DELAY * step, heavy=True)
        return self if "delay" in self.values else Prior({"delay": usual}) | self

    def holding(self, name: str) -> Prior:
        """Return the prior with one uncertain parameter held."""
        return self | Prior({name: replace(self.values[name], held=True)})

    @property
    def held(self) -> str | None:
        """Name of the uncertain parameter that is held, if any."""
        return next((name for name, known in self.values.items() if known.held), None)

    @property
    def given(self) -> Prior:
        """The values that were given: no guess of the delay, no uncertain parameter held."""
        values = self.values.items()
        return Prior(
            {name: replace(known, held=False) for name, known in values if not known.heavy}
        )

    def open(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return the names without a fixed value."""
        return tuple(name for name in names if name not in self.fixed)

    def fitted(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return the names to fit, and other uncertain parameters."""
        unknown = self.open(names)
        return (*unknown, *(name for name in self.uncertain if name not in unknown))

    def within(self, names: Iterable[str]) -> Prior:
        """Return the prior of some parameters, with physical values and scales."""
        wanted = {*names, *PHYSICAL, *SCALES, LAG}
        return Prior({name: known for name, known in self.values.items() if name in wanted})

    def agreeing(self, other: Prior, source: object) -> Prior:
        """Return both priors of one robot; InputError if they differ."""
        for name, theirs in other.values.items():
            mine = self.values.get(name, theirs)
            if mine != theirs:
                expected = f"{mine}, as in the other data"
                raise InputError(str(source), f"known.{name}", theirs, expected)
        return self | other

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for `of`."""
        return {name: plain(known) for name, known in self.values.items()}


NO_PRIOR = Prior()
"""No known values."""


def known_of(value: Any, source: object = "known", field: str = "value") -> Known:  # noqa: ANN401 - whatever was given
    """Read a number, text (``1 ± 0.02``, ``1+-0.02``), mapping, pair or `Known`, or refuse it."""
    number, uncertainty, origin = _parts(value, source, field)
    for part in (number, uncertainty):
        if isinstance(part, bool) or not isinstance(part, Real):
            raise InputError(str(source), field, value, _EXPECTED)
    if not abs(number) <= _LARGEST:
        raise InputError(str(source), field, number, "a finite number")
    if not 0 <= uncertainty <= _LARGEST:
        raise InputError(str(source), f"{field}.uncertainty", uncertainty, "0 or a positive number")
    return Known(value=float(number), uncertainty=float(uncertainty), origin=str(origin))


def _parts(value: Any, source: object, field: str) -> tuple[Any, Any, object]:  # noqa: ANN401 - whatever was given
    """Return a value, its uncertainty, and whose it is, unchecked."""
    if isinstance(value, Known):
        return value.value, value.uncertainty, value.origin
    if isinstance(value, Mapping):
        if not {"value"} <= value.keys() <= {"value", "uncertainty", "from"}:
            raise InputError(str(source), field, dict(value), _EXPECTED)
        return value["value"], value.get("uncertainty", 0.0), value.get("from", "")
    if isinstance(value, tuple | list) and len(value) == 2:  # noqa: PLR2004 - a value and its uncertainty
        return value[0], value[1], ""
    if not isinstance(value, str):
        return value, 0.0, ""
    match = _TEXT.fullmatch(value.strip())
    try:
        uncertainty = float((match and match["uncertainty"]) or 0.0)
        return float(match["value"] if match else value), uncertainty, ""
    except ValueError:
        raise InputError(str(source), field, value, "a number such as 1, or 1+-0.02") from None


def plain(known: Known) -> float | dict[str, float | str]:
    """Return a number, or a mapping with its uncertainty, and whose it is if others'."""
    if known.fixed:
        return known.value
    whose: dict[str, float | str] = {"from": known.origin} if known.origin else {}
    return {"value": known.value, "uncertainty": known.uncertainty, **whose}


def _require_possible(source: object, name: str, known: Known) -> None:
    """Refuse impossible values, and a scale other than 1 or a lag (correct the logs instead)."""
    nominal = {**dict.fromkeys(SCALES, 1.0), LAG: 0.0}.get(name, known.value)
    if known.value != nominal:
        expected = f"{nominal:g} ± its uncertainty"
        raise InputError(str(source), f"known.{name}", f"{known.value:g}", expected)
    lower = TERMS[name].lower if name in TERMS else 0.0
    positive = name in PHYSICAL and name not in {"rotor_inertia", "back_emf_constant"}
    if known.value < lower or (positive and known.value == 0):
        expected = "a positive number" if positive else f"{lower:g} or more"
        raise InputError(str(source), f"known.{name}", f"{known.value:g}", expected)


@dataclass(frozen=True, kw_only=True, eq=False)
class Penalty:
    """The term of a prior on n values in a sum of squares."""

    mean: Samples  # (n,) known values; arbitrary if unknown
    # (n,) weights relative to the rows: ``variance`` over that of each value; 0 if unknown
    weight: Samples
    variance: float = 1.0  # of a row, as realised by independent clusters

    @classmethod
    def of(
        cls,
        names: Sequence[Hashable],
        known: Mapping[Any, Known],
        variance: float = 1.0,
        values: Mapping[Any, float] | None = None,
    ) -> Penalty | None:
        """Return the penalty of the uncertain values by name; None if there are none.

        ``values``: where heavy tails are linearised, by default at their peak.
        """
        priors = [known[n] if n in known and known[n].uncertainty else None for n in names]
        if not any(priors):
            return None
        mean = np.array([prior.value if prior else 0.0 for prior in priors])
        weight = np.array(
            [
                variance * prior.precision((values or {}).get(name, prior.value)) if prior else 0.0
                for name, prior in zip(names, priors, strict=True)
            ]
        )
        return cls(mean=mean, weight=weight, variance=variance)

    @property
    def active(self) -> NDArray[np.bool_]:
        """(n,) whether a value is known."""
        return np.asarray(self.weight > 0)

    def weighed(self, variance: float) -> Penalty:
        """Return the penalty relative to rows of another variance."""
        weight = self.weight * (variance / self.variance)
        return replace(self, weight=weight, variance=variance)

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Penalty:
        """Return the penalty of some of the values."""
        return replace(self, mean=self.mean[index], weight=self.weight[index])

    def without(self, lost: NDArray[np.bool_]) -> Penalty:
        """Return the penalty without some of the values, by a mask."""
        return replace(self, weight=np.where(lost, 0.0, self.weight))

    def merged(self, other: Penalty | None, at: int) -> Penalty:
        """Return the penalty with what another, of all values but that numbered ``at``, adds."""
        if other is None:
            return self
        mean, weight = (np.insert(array, at, 0.0) for array in (other.mean, other.weight))
        mean = np.where(self.active, self.mean, mean)
        weight *= self.variance / other.variance
        return replace(self, mean=mean, weight=np.where(self.active, self.weight, weight))

    def padded(self, count: int) -> Penalty:
        """Return the penalty of these values and further, unknown ones."""
        none = np.zeros(count)
        return replace(self, mean=np.append(self.mean, none), weight=np.append(self.weight, none))

    def turned(self, slope: Samples, shift: Samples) -> Penalty:
        """Return the penalty of (n,) slope * (value - shift)."""
        return replace(self, mean=slope * (self.mean - shift), weight=self.weight / slope**2)

    def rows(self) -> tuple[Samples, Samples]:
        """Return (k, n) rows and (k,) targets of a regression on the values."""
        root = np.sqrt(self.weight[self.active])
        return np.diag(np.sqrt(self.weight))[self.active], root * self.mean[self.active]

    def cost(self, values: Samples) -> float:
        """Return half the weighted sum of squares of (n,) values."""
        return 0.5 * float(self.weight @ (values - self.mean) ** 2)

    def gradient(self, values: Samples) -> Samples:
        """(n,) derivatives of the cost."""
        return np.asarray(self.weight * (values - self.mean))

    @property
    def curvature(self) -> Samples:
        """(n, n) second derivatives of the cost."""
        return np.diag(self.weight)


_BY_ALL = {*PARAMETERS, *SETTINGS}


TAKES = {
    "harmonic-balance": {row.name for row in TERMS.values() if row.describing} - {*BASE_TERMS}
    | _BY_ALL,
    "weak-form": {row.name for row in TERMS.values() if row.basis} - {*GEAR}
    | {*offered("weak-form")}
    | _BY_ALL,
    "output-error": set(TERMS),
}
"""Names that may be known beforehand, by method."""


def usable(method: str, known: Prior) -> Prior:
    """Return the part of a prior that a method can use; any can use a term's absence."""
    return known.within(n for n, value in known.parameters.items() if _can_use(method, n, value))


def require_usable(method: str, known: Prior, names: tuple[str, ...] = PARAMETERS) -> None:
    """Raise InputError for known values that a method cannot use, or if all ``names`` are known."""
    if not known.open(names):
        expected = "at least one unknown parameter (to use known ones only: `predict`)"
        raise InputError(method, "known", f"{', '.join(names)}, all exactly", expected)
    for name in known.parameters.keys() - usable(method, known).parameters.keys():
        value = known.parameters[name]
        others = " or ".join(other for other in TAKES if _can_use(other, name, value))
        expected = f"the method {others}" if others else "an exact value"
        raise InputError(method, f"known.{name}", value, expected)


def _can_use(method: str, name: str, known: Known) -> bool:
    if not known.fixed:
        return name in TAKES[method] & {*PARAMETERS, *offered(method)}
    return known.value == 0 or name in TAKES[method]
