"""Which terms are worth trying, and their stagewise choice where equations are linear in them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.inference.identifiability import Conditioning
from butterfly.identification.inference.stagewise import Offer, is_near, offers_in, stagewise
from butterfly.identification.inference.submodels import NEGLIGIBLE, Submodels, submodels_of
from butterfly.identification.levels import FEW
from butterfly.identification.linearisation import Linearisation
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import NO_PRIOR, Prior
from butterfly.model.terms import FOLLOWERS, GEAR, FrictionTerms, companions

STRIBECK = "stribeck"
"""The term whose velocity is scanned."""

_SPEEDS = (0.03, 0.5, 10)  # least and largest Stribeck velocity over the largest speed; how many


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


def usual_velocity(known: Prior) -> float:
    """Return the Stribeck velocity in rad/s: the known one, or else the model's default."""
    return known.fixed.get("stribeck_velocity", FrictionTerms.stribeck_velocity)


def stribeck_velocities(fastest: float, known: Prior = NO_PRIOR) -> list[float]:
    """Return Stribeck velocities in rad/s to try: none if its friction is known, one if it is."""
    if STRIBECK in known.parameters:
        return []
    if "stribeck_velocity" in known.fixed:
        return [known.fixed["stribeck_velocity"]]
    return [float(each) for each in fastest * np.geomspace(*_SPEEDS)]


def optional_terms(
    terms: Sequence[str] | None, offers: Iterable[str], masses: Iterable[AddedMass], known: Prior
) -> tuple[str, ...]:
    """Return the unknown ones of given terms, or, without any, the candidates of offers."""
    if terms is None:
        return candidates(offers, masses, known)
    return tuple(name for name in terms if name not in known.parameters)


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearProblem:
    """The equations of logs, which are linear in the parameters, with any terms."""

    # with n parameters at a Stribeck velocity in rad/s
    equations: Callable[[tuple[str, ...], float], Linearisation]
    base: tuple[str, ...]  # parameters that every fit has
    terms: tuple[str, ...]  # that may be absent
    masses: Sequence[AddedMass]  # of each log
    known: Prior
    fastest: float  # largest speed in rad/s
    negligible: float = NEGLIGIBLE  # size of an error by rounding

    def fitted(self, *, choosing: bool) -> TermChoice:
        """Return the fit with all terms, or, if ``choosing``, those that predict better."""
        speeds = [usual_velocity(self.known)]
        if STRIBECK in self.terms:
            speeds = stribeck_velocities(self.fastest, self.known)
        models = []
        for speed in speeds:
            equations = self.equations((*self.base, *self.terms), speed)
            nested = submodels_of(equations, self.masses, self.negligible)
            models.append(replace(nested, settings={"stribeck_velocity": speed}))
        model = LinearModel(models=tuple(models), optional=self.terms, masses=self.masses)
        return choose(model) if choosing else demanded(model, self.terms)


class TermChoice(NamedTuple):
    """Chosen terms, with rivals and findings."""

    names: tuple[str, ...]  # of the parameters, the terms last
    terms: tuple[str, ...]  # chosen
    values: dict[str, float]  # of the parameters, by name
    settings: dict[str, float]  # see `Submodels`
    rivals: tuple[dict[str, float], ...]  # values, by name, of other fits that predict as well
    findings: tuple[Finding, ...]  # settings that were scanned, and terms that are not fitted
    path: tuple[tuple[str, ...], ...] = ()  # terms after each round of the choice

    @property
    def rival_values(self) -> tuple[Samples, ...]:
        """(n,) values of the chosen parameters in each rival; 0 of those that it does not have."""
        return tuple(np.array([each.get(name, 0.0) for name in self.names]) for each in self.rivals)


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel:
    """A fit of some of the terms of linear equations (see `stagewise.Model`).

    Several equations differ in the Stribeck velocity alone; the first ones are fitted.
    """

    models: tuple[Submodels, ...]
    optional: tuple[str, ...]  # terms that may be absent
    terms: frozenset[str] = frozenset()  # those that are fitted
    masses: Sequence[AddedMass] = ()
    simulates: bool = False

    @cached_property
    def nested(self) -> Submodels:
        """The equations that are fitted, about the values."""
        return self.models[0].about(self.values)

    @cached_property
    def kept(self) -> NDArray[np.bool_]:
        """(n,) which of the parameters are fitted."""
        absent = {*self.optional} - self.terms
        absent |= companions(absent) - companions(self.terms)
        return np.array([name not in absent for name in self.models[0].names])

    @cached_property
    def values(self) -> Samples:
        """(n,) values of the parameters; nan if the equations do not determine them."""
        return np.asarray(self.models[0].fitted(self.kept[np.newaxis])[0])

    def offers(self, rows: Collection[str]) -> list[Offer]:
        """Return score tests of missing terms, Stribeck's at the velocity that explains most."""
        found = []
        for row in rows:
            scanned = self.models if row == STRIBECK else self.models[:1]
            tried = [
                offer
                for each in scanned
                for offer in offers_in(each.about(self.values), self.kept, [row], self.masses)
            ]
            found += [max(tried, key=lambda each: each.share)] if tried else []
        return found

    def adding(self, offer: Offer) -> LinearModel | None:
        """Return the fit with a term more; None if its value is on a bound."""
        models = (offer.nested,) if offer.name == STRIBECK else self.models
        more = replace(self, models=models, terms=self.terms | {offer.name})
        place = more.nested.names.index(offer.name)
        return more if more.values[place] > more.nested.equations.lower[place] else None

    def without(self, name: str) -> LinearModel:
        """Return the fit without a term."""
        return replace(self, terms=self.terms - {name})

    def confirms(self, rival: Mapping[str, float]) -> bool:
        """Whether a rival is one: its equations are linear, so that all they promise holds."""
        here = dict(zip(self.nested.names, self.values.tolist(), strict=True))
        return is_near(rival, here, self.masses)

    @property
    def determined(self) -> bool:
        """Whether the equations determine the parameters."""
        return bool(np.isfinite(self.values).all())

    @property
    def refusal(self) -> IdentifiabilityError:
        """The error that names the parameters that the equations do not determine."""
        kept, whole = self.kept, self.models[0].equations
        alone = self.models[0].about(np.where(kept, whole.values, 0.0)).equations
        known = None if whole.prior is None else whole.prior.active[kept]
        names = tuple(np.array(whole.names)[kept].tolist())
        about = alone.values[kept], alone.residuals
        return Conditioning.of(alone.rows[:, kept], names, known, about).refusal

    def choice(
        self, rivals: Iterable[Mapping[str, float]] = (), findings: Iterable[Finding] = ()
    ) -> TermChoice:
        """Return the choice, with rivals and further findings."""
        scanned = self.nested.settings if STRIBECK in self.terms else {}
        terms = tuple(name for name in self.optional if name in self.terms)
        base = (n for n in self.nested.names if n not in FOLLOWERS.union(self.optional))
        return TermChoice(
            names=(*base, *terms),
            terms=terms,
            values=self.nested.equations.named | scanned,
            settings=scanned,
            rivals=tuple(dict(each) for each in rivals),
            findings=(
                *(Finding(FindingKind.SCANNED, (n,), number=v) for n, v in scanned.items()),
                *findings,
            ),
        )


def choose(model: LinearModel, rare: Collection[str] = ()) -> TermChoice:
    """Choose terms of linear equations; IdentifiabilityError if these are singular without any."""
    if not model.determined:
        raise model.refusal
    found = stagewise(model, model.optional, rare)
    choice = found.model.choice(found.rival_values(), found.findings)
    return choice._replace(path=found.path)


def demanded(model: LinearModel, terms: Sequence[str]) -> TermChoice:
    """Fit some terms, at the Stribeck velocity that predicts best.

    The last ones are dropped until the rest is identifiable. IdentifiabilityError if the equations
    are singular without any.
    """
    for count in range(len(terms), -1, -1):
        fits = [
            replace(model, models=(each,), terms=frozenset(terms[:count]))
            for each in model.models[: None if STRIBECK in terms[:count] else 1]
        ]
        determined = [each for each in fits if each.determined]
        if determined:
            lost = [Finding(FindingKind.INSEPARABLE, tuple(terms[count:]))] if terms[count:] else []
            return min(determined, key=_held_out_error).choice(findings=lost)
    raise model.refusal


def _held_out_error(model: LinearModel) -> float:
    """Return the mean error of held-out cells; of fitted ones where the rest is singular."""
    errors = model.nested.held_out(model.kept[np.newaxis])[0]
    finite = np.isfinite(errors).all()
    return float(np.mean(np.sqrt(errors if finite else model.nested.equations.squares)))
