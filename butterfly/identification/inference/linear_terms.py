"""Which terms are worth trying, and a fit in some of them where equations are linear."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.identification.inference.stagewise import Offer, is_near, offers_in
from butterfly.identification.inference.submodels import Submodels
from butterfly.identification.levels import FEW
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import NO_PRIOR, Prior
from butterfly.model.terms import GEAR, companions

STRIBECK = "stribeck"
"""The term that needs a velocity."""

_SPEEDS = (0.03, 0.37, 3)  # least and largest Stribeck velocity over the largest speed; how many


def candidates(names: Iterable[str], masses: Iterable[AddedMass], known: Prior) -> tuple[str, ...]:
    """Return the terms that are identifiable with some added masses and known values.

    Terms that grow with the added mass need three of them: two determine the scale. Without gravity
    a gear's load is inertial alone: its friction cannot be distinguished from uneven friction.
    """
    carried = list(masses)
    effects = {mass.inertia_and_moment for mass in carried}
    lost = {*known.parameters, *companions(known.parameters)}
    if len(effects) < FEW:
        lost |= {"load", "load_drag", "mass_inertia"}
    if known.weightless(carried):
        lost |= {*GEAR}
    if known.weightless(carried) or any(mass.own_inertia for mass in carried):
        lost.add("mass_inertia")
    if known.weightless(carried) or ("p3" in known.parameters and len(effects) < FEW):
        lost.add("p3_offset")
    return tuple(name for name in names if name not in lost)


def stribeck_velocities(fastest: float, known: Prior = NO_PRIOR) -> list[float]:
    """Return Stribeck velocities in rad/s to try: the known one, or else shares of a speed."""
    if "stribeck_velocity" in known.fixed:
        return [known.fixed["stribeck_velocity"]]
    return [float(each) for each in fastest * np.geomspace(*_SPEEDS)]


def stribeck_velocity(fastest: float, known: Prior) -> float:
    """Return the Stribeck velocity in rad/s to take where none is tried: the middle of these."""
    speeds = stribeck_velocities(fastest, known)
    return speeds[len(speeds) // 2]


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel:
    """A fit of some of the terms of linear equations (see `stagewise.Model`)."""

    every: Submodels  # the equations with all terms
    optional: tuple[str, ...]  # terms that may be absent
    terms: frozenset[str] = frozenset()  # those that are fitted
    masses: Sequence[AddedMass] = ()
    simulates: bool = False

    @cached_property
    def nested(self) -> Submodels:
        """The equations about the values."""
        return self.every.about(self.values)

    @cached_property
    def kept(self) -> NDArray[np.bool_]:
        """(n,) which of the parameters are fitted."""
        absent = {*self.optional} - self.terms
        absent |= companions(absent) - companions(self.terms)
        return np.array([name not in absent for name in self.every.names])

    @cached_property
    def values(self) -> Samples:
        """(n,) values of the parameters; nan if the equations do not determine them."""
        return np.asarray(self.every.fitted(self.kept[np.newaxis])[0])

    def offers(self, rows: Collection[str]) -> list[Offer]:
        """Return score tests of missing terms."""
        return offers_in(self.nested, self.kept, rows, self.masses)

    def adding(self, offer: Offer) -> LinearModel | None:
        """Return the fit with a term more; None if its value is on a bound."""
        more = replace(self, terms=self.terms | {offer.name})
        place = more.nested.names.index(offer.name)
        return more if more.values[place] > more.nested.equations.lower[place] else None

    def without(self, names: Collection[str]) -> LinearModel:
        """Return the fit without some terms."""
        return replace(self, terms=self.terms.difference(names))

    def confirms(self, rival: Mapping[str, float]) -> bool:
        """Whether a rival is one: its equations are linear, so that all they promise holds."""
        here = dict(zip(self.nested.names, self.values.tolist(), strict=True))
        return is_near(rival, here, self.masses)

    @property
    def determined(self) -> bool:
        """Whether the equations determine the parameters."""
        return bool(np.isfinite(self.values).all())
