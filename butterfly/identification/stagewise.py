"""Which terms a fit has: one stagewise rule over the rows of the table of terms.

Each round asks of every row that a fit does not have, on the equations about its end: how likely is
such a score by chance (score test, clusters are logs, over all rows together: Holm, Scand. J.
Statist. 6, 1979); which share of the squared errors does it explain; does it predict the parts of
the data that were left out better (cross-validation; Stone, J. R. Statist. Soc. B 36, 1974), in
standard errors of that gain? How much is asked depends on how common the row is. The row with the
largest gain, and the next two as common, are fitted; the best stays if it keeps half of what was
promised and a joint may have it. A term that predicts no better once others are fitted goes again.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples, standard_error
from butterfly.identification.agreement import score_of
from butterfly.identification.scatter import Submodels
from butterfly.identification.trust import FEW, MATERIAL, Finding, FindingKind
from butterfly.model.parameters import AddedMass, friction_brakes, value_if_absent
from butterfly.model.prior import NO_PRIOR, Prior
from butterfly.model.terms import GEAR, OF_MASS, companions, is_simulated_with
from butterfly.progress import out_of_time
from butterfly.verdict import CONFIDENCE

PROMISED = 0.5
"""Share of a promised gain that a simulation keeps, if it is believed."""

_NEAR = 10.0  # ratio of inertias, within which linear equations may be believed

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
        lost |= OF_MASS
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
    return [float(speed) for speed in fastest * np.geomspace(*_SPEEDS)]


def stribeck_velocity(fastest: float, known: Prior) -> float:
    """Return the Stribeck velocity in rad/s to take where none is tried: the middle of these."""
    speeds = stribeck_velocities(fastest, known)
    return speeds[len(speeds) // 2]


ROUNDS = 4  # of terms that are added one after the other
_TIES = 2  # rows that are fitted besides the one with the largest gain


class _Level(NamedTuple):
    """What is asked of a row: either alternative, chance and gain, or gain and share."""

    chance: float  # largest, over all rows together, with a gain of one standard error
    least_ratio: float  # of the gain to its standard error, with a share of the squared errors


_COMMON, _RARE = _Level(0.01, 1.0), _Level(1e-3, 2.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class Offer:
    """A row that a fit lacks, tested on the equations about its end."""

    name: str
    chance: float  # of such a score, if the joint does not have it
    share: float  # of the squared errors that it explains
    gain: Samples  # (k,) by how much the error of each cell is less, predicted by the others
    values: Mapping[str, float]  # of all unknowns a step away, by label
    nested: Submodels  # the equations, with n unknowns, on which it was tested
    is_fitted: NDArray[np.bool_]  # (n,) which of these are fitted without the row

    @property
    def ratio(self) -> float:
        """The mean gain in standard errors."""
        mean, error = float(self.gain.mean()), standard_error(self.gain)
        return mean / error if error > 0 else math.copysign(math.inf, mean) if mean else 0.0

    def passes(self, level: _Level, chance: float, negligible: float) -> bool:
        """Whether a fit is worth trying, with a chance over all rows together."""
        if not self.gain.mean() > negligible:
            return False
        significant = chance < level.chance and self.ratio > 1
        return significant or (self.ratio > level.least_ratio and self.share > MATERIAL)

    def swapped(self, term: str) -> dict[str, float] | None:
        """Return the values, by label, with the row in place of a term; None of a worse fit."""
        names = np.array(self.nested.names)
        other = self.is_fitted & ~np.isin(names, [term, *companions({term})]) | (names == self.name)
        values = self.nested.fitted(np.array([self.is_fitted, other]))
        if not as_good(*np.sqrt(self.nested.costs(values))[::-1]):
            return None
        return dict(zip(self.nested.names, values[1].tolist(), strict=True))


class Model(Protocol):
    """A fit in some terms, to which one can be added."""

    @property
    def simulates(self) -> bool:
        """Whether that takes simulations, for which there may be no time."""

    @property
    def terms(self) -> frozenset[str]:
        """The optional terms that it has."""

    @property
    def nested(self) -> Submodels:
        """Its equations, and those of fits with fewer terms, about its end."""

    @property
    def is_fitted(self) -> NDArray[np.bool_]:
        """(n,) which of the parameters of these are fitted."""

    def offers(self, rows: Collection[str]) -> list[Offer]:
        """Test rows that it does not have."""

    def adding(self, offer: Offer) -> Self | None:
        """Fit with a row more; None if no joint has it, or it does not keep what it promised."""

    def without(self, names: Collection[str]) -> Self | None:
        """Fit without some terms; None if it is not as good as promised."""

    def confirms(self, rival: Mapping[str, float]) -> bool:
        """Whether the rival values, by label, that its equations promise are as good as its own."""


M = TypeVar("M", bound=Model)


@dataclass(frozen=True)
class ChosenTerms(Generic[M]):
    """A fit in chosen terms, and what speaks for others."""

    model: M
    path: tuple[tuple[str, ...], ...]  # the terms of each round, the first ones included
    ties: tuple[tuple[Offer, str], ...]  # rows that did as well as a term that was taken, and that
    # rows that are not fitted although significant, helpful (common) or material (rare)
    rivals: tuple[Offer, ...]
    # rows that pass and are not fitted: the best, then those with errors as small
    missing: tuple[Offer, ...]
    idle: tuple[str, ...]  # rows that were tried and are not fitted
    inseparable: tuple[str, ...]  # rows that the data cannot separate from the rest

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Which rows did not help, and which the data cannot separate from the rest."""
        rows = {FindingKind.NOT_HELPING: self.idle, FindingKind.INSEPARABLE: self.inseparable}
        return tuple(Finding(kind, names) for kind, names in rows.items() if names)

    def rival_values(self) -> list[Mapping[str, float]]:
        """Return the values, by label, of fits that predict as well, and of those with rivals."""
        swapped = (row.swapped(taken) for row, taken in self.ties)
        offered = [
            *(values for values in swapped if values),
            *(rival.values for rival in self.rivals),
        ]
        return [values for values in offered if self.model.confirms(values)]


def stagewise(
    model: M,
    rows: Sequence[str],
    rare: Collection[str],
    rounds: int = ROUNDS,
    staying: Collection[str] = (),
) -> ChosenTerms[M]:
    """Add and take away terms of some rows until none helps; of rare ones more is asked.

    In so many ``rounds``, or in none if only what is missing is asked. Those ``staying`` go only if
    they end on their bound.
    """
    refused: set[str] = set()
    gone: set[str] = set()  # since a term was added, which they may need
    needed: set[str] = set()  # though equations promise as much without them
    ties: list[tuple[str, str]] = []
    path, added = [_ordered(model.terms, rows)], 0
    while True:
        if idle := _idle(model, [n for n in rows if n not in needed], path[0], staying):
            fewer = model.without(idle)
            if fewer is None and len(idle) > 1:
                idle = idle[:1]  # which helps least
                fewer = model.without(idle)
            if fewer is None:
                needed.update(idle)
                continue
            gone.update(idle)
            model = fewer
            path.append(_ordered(model.terms, rows))
            continue
        absent = [name for name in rows if name not in model.terms | gone | refused]
        asked = [name for name in absent if is_simulated_with(name, model.terms)]
        offers = model.offers(asked) if asked else []
        last = added == rounds or (model.simulates and out_of_time("the selection of terms"))
        wider = None if last else _best(model, offers, rare, refused, ties)
        if wider is None:
            break
        gone.clear()
        added += 1
        model = wider
        path.append(_ordered(model.terms, rows))
    felt = {offer.name: offer for offer in offers}
    holm = _holm(offers)
    return ChosenTerms(
        model=model,
        path=tuple(path),
        ties=tuple((felt[n], term) for n, term in ties if n in felt and term in model.terms),
        rivals=tuple(
            offer
            for offer in offers
            if holm[offer.name] < 1 - CONFIDENCE
            or (offer.ratio > 1 and (offer.name not in rare or offer.share > MATERIAL))
        ),
        missing=_missing(offers, rare, model.nested.negligible),
        idle=tuple(name for name in rows if name in (gone | refused).union(felt)),
        inseparable=tuple(name for name in asked if name not in felt),
    )


def _missing(
    offers: Sequence[Offer], rare: Collection[str], negligible: float
) -> tuple[Offer, ...]:
    """Return the best of the rows that pass, and those that leave errors as small."""
    passing = sorted(
        _passing(offers, rare, negligible), key=lambda offer: -float(offer.gain.mean())
    )
    return tuple(offer for offer in passing if as_good(-offer.gain, -passing[0].gain))


def _passing(offers: Sequence[Offer], rare: Collection[str], negligible: float) -> list[Offer]:
    """Return the rows that are worth trying."""
    holm, levels = _holm(offers), dict.fromkeys(rare, _RARE)
    return [
        offer
        for offer in offers
        if offer.passes(levels.get(offer.name, _COMMON), holm[offer.name], negligible)
    ]


def _ordered(terms: Collection[str], rows: Sequence[str]) -> tuple[str, ...]:
    """Return the rows that are among some terms, in their order."""
    return tuple(name for name in rows if name in terms)


def _idle(
    model: Model, rows: Sequence[str], begun: Sequence[str], staying: Collection[str]
) -> tuple[str, ...]:
    """Return terms that help to predict no more than by chance, or not at all if they were added.

    Those on their bound are absent already. Others leave the equations one after the other, the one
    that helps least first. Where held-out data cannot be predicted at all, the term goes without
    which they are predicted best.
    """
    nested, mask, lost = model.nested, model.is_fitted, list[str]()
    on_bound = np.array(nested.names)[nested.equations.on_bound]
    if absent := tuple(name for name in _ordered(model.terms, rows) if name in on_bound):
        return absent
    open_ = [name for name in _ordered(model.terms, rows) if name not in staying]
    while terms := [name for name in open_ if name not in lost]:
        fewer = [mask & ~np.isin(nested.names, [n, *companions({n})]) for n in terms]
        whole, *errors = np.sqrt(nested.held_out(np.array([mask, *fewer])))
        whole = np.nan_to_num(whole, nan=float(np.finfo(np.float32).max))
        gains = {
            n: (error - whole, rest) for n, error, rest in zip(terms, errors, fewer, strict=True)
        }
        means = {
            name: float(np.mean(gain))
            for name, (gain, _) in gains.items()
            if np.isfinite(gain).all()
            and not gain.mean()
            > max(standard_error(gain) if name in begun else 0.0, nested.negligible)
        }
        if not means:
            break
        lost.append(min(means, key=lambda name: means[name]))
        mask = gains[lost[-1]][1]
    return tuple(lost)


def _best(
    model: M,
    offers: Sequence[Offer],
    rare: Collection[str],
    refused: set[str],
    ties: list[tuple[str, str]],
) -> M | None:
    """Fit the passing row with the largest gain and others near it; return the best that holds.

    Whether any is added is asked of that row; which one, of all that are as common, by their fits:
    one step predicts them too roughly to tell them apart.
    """
    negligible = model.nested.negligible
    ranked = sorted(offers, key=lambda offer: -float(offer.gain.mean()))
    passing = _passing(ranked, rare, negligible)
    while passing:
        first = passing[0]
        near = [
            offer
            for offer in ranked
            if offer is not first
            and offer.gain.mean() > negligible
            and offer.name not in refused
            and (offer in passing or offer.name not in rare or first.name in rare)
        ]
        tried = [(offer.name, model.adding(offer)) for offer in (first, *near[:_TIES])]
        fits = {name: fit for name, fit in tried if fit is not None}
        refused.update(name for name, fit in tried if fit is None)
        if fits:
            errors = {name: np.sqrt(fit.nested.equations.squares) for name, fit in fits.items()}
            lowest = min(errors, key=lambda name: float(np.sum(errors[name] ** 2)))
            alike = [name for name in fits if as_good(errors[name], errors[lowest])]
            taken = first.name if first.name in alike else lowest
            ties.extend((name, taken) for name in alike if name != taken)
            return fits[taken]
        passing = [offer for offer in passing if offer.name not in refused]
    return None


def as_good(errors: Samples, least: Samples) -> bool:
    """Whether (k,) errors of cells exceed others by no more than a standard error."""
    worse = errors - least
    return bool(worse.mean() <= standard_error(worse))


def is_near(
    values: Mapping[str, float], fitted: Mapping[str, float], masses: Iterable[AddedMass]
) -> bool:
    """Whether values from linear equations about a fit are near enough to be simulated.

    The values, by label, are finite, and the least inertia with an added mass is within ten times
    that of the fit, whose cost is the lowest that was simulated.
    """
    if not np.isfinite([*values.values()]).all():
        return False
    carried = min((mass.inertia for mass in masses), default=0.0)
    here, there = (point.get("p1", 0.0) + carried for point in (fitted, values))
    return "p1" not in fitted or here / _NEAR <= there <= _NEAR * here


def _holm(offers: Sequence[Offer]) -> dict[str, float]:
    """Return the chance of each row over all rows together."""
    chances, most = {}, 0.0
    for rank, offer in enumerate(sorted(offers, key=lambda offer: offer.chance)):
        most = max(most, offer.chance * (len(offers) - rank))
        chances[offer.name] = most
    return chances


def offers_in(
    nested: Submodels, mask: NDArray[np.bool_], rows: Collection[str], masses: Iterable[AddedMass]
) -> list[Offer]:
    """Test rows on equations that have them all, about the end of a fit of those in ``mask``.

    Rows that the equations cannot separate from the rest are left out.
    """
    equations, names = nested.equations, np.array(nested.names)
    about = replace(equations, held=equations.on_bound | ~mask)
    asked = [name for name in rows if name in nested.names]
    chances = {
        name: probability for name in asked if (probability := score_of(about, name)) is not None
    }
    if not chances:
        return []
    masks = np.array([mask, *(mask | (names == name) for name in chances)])
    fits = nested.fitted(masks)
    costs = nested.costs(fits).sum(axis=1)
    errors = np.sqrt(nested.held_out(masks))
    offers = []
    for k, (name, chance) in enumerate(chances.items(), 1):
        gain = errors[0] - errors[k]
        values = dict(zip(nested.names, fits[k].tolist(), strict=True))
        able = np.isfinite(fits[k]).all() and np.isfinite(gain).all()
        differs = values[name] != value_if_absent(name)
        possible = bool(able and differs and friction_brakes(values, masses))
        offers.append(
            Offer(
                name=name,
                chance=chance if possible else 1.0,
                share=float(1 - costs[k] / costs[0]) if possible and costs[0] > 0 else 0.0,
                gain=gain if possible else np.zeros_like(gain),
                values=values,
                nested=nested,
                is_fitted=mask,
            )
        )
    return offers
