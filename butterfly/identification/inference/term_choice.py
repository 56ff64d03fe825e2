"""Which terms are fitted: those that help to predict logs that were left out.

Of all sets of terms that are offered the one is sought that predicts best what it has not seen
(cross-validation; Stone, J. R. Statist. Soc. B 36, 1974), and of those that do so about as well the
smallest (the rule of one standard error; Breiman et al., Classification and Regression Trees, 1984,
section 3.4.3).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.blocks import Conditions
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.equations import CellEquations
from butterfly.identification.inference.agreement import friction_disagrees
from butterfly.identification.inference.identifiability import Conditioning
from butterfly.identification.inference.submodels import Submodels
from butterfly.identification.levels import CLEARLY, FEW
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Prior
from butterfly.model.terms import FOLLOWERS, GEAR, companions

CANDIDATES = ("drag", "load", "bias", "p3_offset", "stribeck")
"""Terms that are tried where none are asked for."""

RARER = (
    *("spring", "mass_inertia", "base_compliance", "dead_zone", "compression"),
    *("motor_friction", "load_friction", "slow_delay", "coulomb_slope", "load_drag"),
)
"""Terms that are tried one after the other beside those, by the rule of contrasts."""

NEGLIGIBLE = 1e-6
"""Of a motion, how well it is predicted at best: rounding leaves more."""

_SPEEDS = (0.03, 0.5, 10)  # least and largest Stribeck velocity over the largest speed; how many

BASE = "base_compliance"
"""The term of a base that gives."""

SCANNED = "stribeck"
"""The term whose velocity is tried."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TermChoice:
    """Terms that were chosen, and what speaks for others."""

    names: tuple[str, ...]  # of the parameters, the terms last
    terms: tuple[str, ...]  # chosen
    values: dict[str, float]  # of the parameters, by name, as the nested fit has them
    settings: dict[str, float]  # see `Submodels`
    # values, by name, of the fits that predict as well, with other terms or other settings
    rivals: tuple[dict[str, float], ...]
    not_helping: tuple[str, ...]  # terms that were offered and not chosen
    inseparable: tuple[str, ...]  # terms that the data cannot tell from the rest

    @property
    def rival_values(self) -> tuple[Samples, ...]:
        """Values of the parameters that were chosen, by the rivals; 0 for what they do without."""
        return tuple(np.array([each.get(name, 0.0) for name in self.names]) for each in self.rivals)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What there is to say of settings that were scanned, and of terms that are not fitted."""
        said = {
            FindingKind.NOT_HELPING: self.not_helping,
            FindingKind.INSEPARABLE: self.inseparable,
        }
        scanned = (
            Finding(FindingKind.SCANNED, (name,), number=value)
            for name, value in self.settings.items()
        )
        return (*scanned, *(Finding(kind, names) for kind, names in said.items() if names))


def candidates(names: Iterable[str], masses: Iterable[AddedMass], known: Prior) -> tuple[str, ...]:
    """Return the terms that are worth trying with some added masses, and some knowledge.

    What grows with the added mass shows with three of them: by two the scale of all is set. Without
    gravity friction with a gear may as well be uneven friction: it carries what accelerates alone.
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


def stribeck_velocities(fastest: float, known: Prior) -> list[float]:
    """Return Stribeck velocities in rad/s to try: none if its friction is known, one if it is."""
    if "stribeck" in known.parameters:
        return []
    if "stribeck_velocity" in known.fixed:
        return [known.fixed["stribeck_velocity"]]
    return [float(each) for each in fastest * np.geomspace(*_SPEEDS)]


def submodels_of(
    equations: CellEquations,
    parts: Sequence[Hashable],
    negligible: float = NEGLIGIBLE,
    conditions: Conditions | None = None,
) -> Submodels:
    """Return fits with fewer terms, which predict one of ``parts``, logs or stretches in turn."""
    cells = equations.independent
    few = cells.log.size > np.unique(cells.log).size
    folds = np.arange(cells.log.size) if few else folds_of([parts[k] for k in cells.log])
    slack = CLEARLY if few else 1.0
    return Submodels(
        equations=cells, folds=folds, negligible=negligible, slack=slack, conditions=conditions
    )


def folds_of(parts: Sequence[Hashable]) -> NDArray[np.intp]:
    """Return the number of each log's part; where there are too few parts, each log is one."""
    different = list(dict.fromkeys(parts))
    if len(different) < FEW:
        return np.arange(len(parts))
    return np.array([different.index(part) for part in parts])


def choose_terms(
    fits: Sequence[Submodels],
    *,
    always: tuple[str, ...],
    demanded: tuple[str, ...] = (),
    most: int | None = None,
) -> TermChoice:
    """Choose from the terms of fits that have them all, about one or more settings.

    Every fit has the parameters ``always``, and ``most`` other terms at most. Terms that are
    ``demanded`` are not chosen, but wanted; the last of them are dropped that cannot be told from
    the others. Where friction follows a condition without a term that would help a little, the set
    that predicts best is taken, if its friction does not. IdentifiabilityError if the data do not
    even determine what every fit has.
    """
    offered = tuple(dict.fromkeys(n for nested in fits for n in nested.names if n not in always))
    trials = _all_trials(fits, always, demanded, most)
    best = min(trials, key=lambda trial: trial.score)
    as_good = [trial for trial in trials if _as_good(trial, best)]
    if not as_good:
        raise IdentifiabilityError(
            "simulations of these logs diverge, so no terms can be selected: try --method "
            "weak-form, which needs no simulation"
        )
    chosen = min(as_good, key=lambda trial: (len(trial.terms), trial.score))
    if chosen is not best and chosen.disagrees(always) and not best.disagrees(always):
        chosen = best
    tried = {name for trial in trials for name in trial.terms}
    return TermChoice(
        names=(*always, *chosen.terms),
        terms=chosen.terms,
        values=chosen.values,
        settings=chosen.nested.settings,
        rivals=tuple(trial.values for trial in as_good if trial is not chosen),
        not_helping=tuple(
            name for name in offered if name in tried and name not in FOLLOWERS.union(chosen.terms)
        ),
        inseparable=tuple(name for name in offered if name not in FOLLOWERS | tried),
    )


class _Trial(NamedTuple):
    """A set of terms, where it was fitted, what to, and (k,) errors of logs not seen before."""

    terms: tuple[str, ...]
    nested: Submodels
    fitted: Samples
    errors: Samples

    @property
    def score(self) -> float:
        return float(self.errors.mean())

    def disagrees(self, always: Sequence[str]) -> bool:
        """Whether the friction of the fit follows a condition."""
        if self.nested.conditions is None:
            return False
        (kept,) = _kept(self.nested, always, [self.terms])
        return friction_disagrees(self.nested.restricted(kept, self.fitted), self.nested.conditions)

    @property
    def values(self) -> dict[str, float]:
        named = zip(self.nested.names, self.fitted.tolist(), strict=True)
        return dict(named) | self.nested.settings


def _all_trials(
    fits: Sequence[Submodels], always: tuple[str, ...], demanded: tuple[str, ...], most: int | None
) -> list[_Trial]:
    """Try all that can be tried: of the parts of the data, or else of single logs."""
    by_log = [replace(nested, folds=np.arange(nested.folds.size)) for nested in fits]
    for wanted in [demanded[:count] for count in range(len(demanded), -1, -1)]:
        for split in (fits, by_log):
            if found := [each for own in split for each in _trials(own, always, wanted, most)]:
                return found
    if found := [each for nested in fits for each in _unforeseen(nested, always, demanded)]:
        return found
    (kept,) = _kept(fits[0], always, [()])
    alone = fits[0].restricted(kept, np.where(kept, fits[0].equations.values, 0.0))
    known = None if alone.prior is None else alone.prior.active
    there = alone.values, alone.residuals.ravel()
    raise Conditioning.of(alone.rows.reshape(there[1].size, -1), alone.names, known, there).refusal


def _trials(
    nested: Submodels, always: Sequence[str], demanded: Sequence[str], most: int | None
) -> Iterator[_Trial]:
    """Try all sets of terms that one fit has, and that have what is demanded."""
    must = {*nested.demanded, *demanded}
    tells = np.einsum("kii->i", nested.equations.curvature) > 0
    felt = {name for name, tell in zip(nested.names, tells.tolist(), strict=True) if tell}
    free = [n for n in nested.names if n not in {*always, *must, *FOLLOWERS} and not demanded]
    sets: list[tuple[str, ...]] = []
    for count in range(len(free[:most]) + 1):
        for more in combinations(free, count):
            wanted = {*more, *must}
            wanted |= companions(wanted) & felt
            sets.append(tuple(n for n in nested.names if n in wanted and n not in always))
    kept = _kept(nested, always, sets)
    for terms, fitted, errors in zip(sets, nested.fitted(kept), nested.held_out(kept), strict=True):
        if np.isnan(errors).any():
            continue
        trial = _Trial(terms, nested, fitted, np.sqrt(errors))
        if demanded or not _excess_over_none(trial):
            yield trial


def _unforeseen(
    nested: Submodels, always: Sequence[str], demanded: Sequence[str]
) -> Iterator[_Trial]:
    """Try what is demanded, and no more, on the logs themselves: none can be left out."""
    if nested.demanded and not demanded:
        return
    terms = tuple(name for name in nested.names if name in {*nested.demanded, *demanded})
    values = nested.fitted(_kept(nested, always, [terms]))
    if not np.isnan(values).any():
        yield _Trial(terms, nested, values[0], np.sqrt(nested.costs(values))[0])


def _excess_over_none(trial: _Trial) -> bool:
    """Whether all friction at rest would be Stribeck's: it then stands for something else."""
    if "stribeck" not in trial.terms:
        return False
    found = trial.values
    return "coulomb" in found and found["stribeck"] > 0 and found["coulomb"] <= 0


def _as_good(trial: _Trial, best: _Trial) -> bool:
    """Whether a set of terms predicts as well as the best, but for a standard error."""
    worse = trial.errors - best.errors
    error = float(np.std(worse, ddof=1)) / worse.size**0.5 if worse.size > 1 else 0.0
    return bool(worse.mean() <= max(best.nested.slack * error, best.nested.negligible))


def _kept(
    nested: Submodels, always: Sequence[str], sets: Sequence[Sequence[str]]
) -> NDArray[np.bool_]:
    """(t, n) which of the names of a fit each of t sets of terms has."""
    return np.array([[name in {*always, *terms} for name in nested.names] for terms in sets])


def scanned_terms(
    with_terms: Callable[[tuple[str, ...], float | None], Submodels],
    always: tuple[str, ...],
    terms: tuple[str, ...] | None,
    offers: Sequence[str],
    *,
    masses: Iterable[AddedMass],
    known: Prior,
    fastest: float,
) -> TermChoice:
    """Choose from what is offered and Stribeck friction; of ``terms`` asked for only its velocity.

    ``with_terms`` gives the equations with further terms, and a Stribeck velocity in rad/s, None
    where none needs it; ``fastest``: the largest speed of the logs in rad/s.
    """
    wanted = None if terms is None else tuple(n for n in terms if n not in known.parameters)
    names = candidates(offers, masses, known) if wanted is None else wanted
    names = tuple(name for name in names if name != SCANNED)
    fits = [] if wanted is not None and SCANNED in wanted else [with_terms(names, None)]
    if wanted is None or SCANNED in wanted:
        for speed in stribeck_velocities(fastest, known):
            nested = with_terms((*names, SCANNED), speed)
            settings = {"stribeck_velocity": speed}
            fits.append(replace(nested, demanded=(SCANNED,), settings=settings))
    return choose_terms(fits, always=always, demanded=wanted or ())
