"""Which terms a fit of free runs has: the stagewise rule, each row fitted to the logs anew."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.fit import Equations, Minimum
from butterfly.identification.inference.blocks import independent_cells_of
from butterfly.identification.inference.identifiability import Conditioning
from butterfly.identification.inference.linear_terms import (
    STRIBECK,
    candidates,
    stribeck_velocities,
)
from butterfly.identification.inference.stagewise import (
    ChosenTerms,
    Offer,
    as_good,
    friction_brakes,
    is_near,
    offers_in,
    stagewise,
)
from butterfly.identification.inference.submodels import NEGLIGIBLE, Submodels, submodels_of
from butterfly.identification.levels import FEW, LOST, MOST, PASSES, SHOWS
from butterfly.identification.problem import Problem
from butterfly.logs.log import InputKind, Log, slow_interval
from butterfly.model.parameters import AddedMass, value_if_absent
from butterfly.model.prior import Prior
from butterfly.model.terms import COMMON, OF_SERVO, RARE, TERMS, companions, offered

TRIAL = 2 * PASSES  # expansions of a fit with a row more, the first where one step leads

_INDEPENDENT = 2 * FEW  # logs, from which on rare terms are tried


def offered_rows(logs: Sequence[Log], known: Prior) -> tuple[tuple[str, ...], set[str]]:
    """Return the terms that are tried where none are given, and which of them are rare."""
    driven = {log.input_kind for log in logs if log.setpoint is not None}
    common = {*COMMON, *(OF_SERVO if driven else ())}
    if driven <= {InputKind.CURRENT, InputKind.TORQUE}:  # which have no back EMF
        common -= {"back_emf"}
    rare = {*RARE} - common if len(logs) >= _INDEPENDENT else set()
    if not slow_interval(logs):
        rare -= {"slow_delay"}
    names = [name for name in TERMS if name in common | rare]
    return candidates(names, [log.added_mass for log in logs], known), rare


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """A problem in chosen terms, where its descent ended, and what speaks for others."""

    problem: Problem
    end: Minimum
    rivals: tuple[Samples, ...] = ()  # (s,) shared values of fits that predict as well
    findings: tuple[Finding, ...] = ()
    path: tuple[tuple[str, ...], ...] = ()  # terms after each round of their choice


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeRunModel:
    """The end of a fit of free runs in some of the rows of a problem (see `stagewise.Model`)."""

    every: Problem  # with all rows
    problem: Problem
    end: Minimum
    rows: tuple[str, ...]  # that may be absent
    simulates: bool = True

    @property
    def terms(self) -> frozenset[str]:
        """The optional terms that it has."""
        return frozenset(self.problem.names).intersection(self.rows)

    @property
    def values(self) -> dict[str, float]:
        """Its values by label."""
        return self.problem.named(self.end.values)

    @property
    def masses(self) -> list[AddedMass]:
        """The added mass of each log."""
        return [log.added_mass for log in self.problem.logs]

    @cached_property
    def nested(self) -> Submodels:
        """Its equations, and those of fits with fewer terms."""
        return nested_about(self.problem, self.end.at, len(self.every.keys))

    @property
    def kept(self) -> NDArray[np.bool_]:
        """(n,) which of the parameters of these are fitted: all."""
        return np.ones(len(self.problem.labels), dtype=bool)

    def offers(self, rows: Collection[str]) -> list[Offer]:
        """Test rows that it does not have, on simulations that are differentiated by them."""
        found = self._offers([name for name in rows if name != STRIBECK], {})
        if STRIBECK in rows:
            fastest = 2**0.5 * max(log.rms_speed for log in self.problem.logs)
            tried = [
                offer
                for speed in stribeck_velocities(fastest)
                for offer in self._offers([STRIBECK], {"stribeck_velocity": speed})
            ]
            found += [max(tried, key=lambda each: each.share)] if tried else []
        return found

    def _offers(self, rows: Sequence[str], settings: Mapping[str, float]) -> list[Offer]:
        if not rows:
            return []
        there = self._with(rows, settings)
        at = self.equations(there, there.values_from(self.problem, self.end.values))
        if not at.is_finite:
            return []
        kept = np.isin(there.labels, self.problem.labels)
        nested = nested_about(there, at, len(self.every.keys))
        return offers_in(replace(nested, settings=dict(settings)), kept, rows, self.masses)

    def equations(self, there: Problem, values: Samples) -> Equations:
        """Return the equations of a problem in other terms about (n,) values."""
        return there.weighed(self.simulated(there, values))

    def simulated(self, there: Problem, values: Samples) -> Equations:
        """Return the same without a prior, as rivals are compared by what their logs say."""
        return there.equations(values, self.end.at).counting(there.options.loss)

    def descended(
        self, there: Problem, at: Equations, most: int = MOST, enough: float = SHOWS
    ) -> Minimum:
        """Return where a descent in other terms ends, as far as their choice needs it.

        One into ever stiffer joints, as a base that hardly moves, takes no more steps than ``most``
        expansions at its start.
        """
        return there.descend(at, most, enough, most * at.steps)

    def _with(self, rows: Iterable[str], values: Mapping[str, float]) -> Problem:
        """Return the problem with more rows, first guesses by label being as given."""
        wanted = {*self.problem.labels, *rows, *companions(rows)}
        kept = np.flatnonzero([label in wanted for label in self.every.labels])
        first = dict(zip(self.every.labels, self.every.initial.tolist(), strict=True))
        initial = [{**first, **values}[self.every.labels[k]] for k in kept]
        there = self.every.keeping(kept, np.array(initial))
        return replace(there, initial=np.maximum(there.initial, there.lower))

    def adding(self, offer: Offer) -> Self | None:
        """Fit with a row more; None if no joint has it, or it does not keep what it promised."""
        moved = {label: offer.values[label] for label in (*self.values, offer.name)}
        problem = self._with([offer.name], {**offer.nested.settings, **moved})
        promised = offer.share * float(self.nested.equations.cost.sum()) / 2
        enough = self.end.at.cost - LOST * promised
        try:
            at = self.equations(problem, problem.initial)
            if not at.cost <= enough:
                return None
            end = self.descended(problem, at, TRIAL)
        except IdentifiabilityError:
            return None
        found = replace(self, problem=problem, end=end)
        values, least = problem.named(end.values), problem.named(problem.lower)
        free = all(values[n] > least[n] for n in (offer.name, "p1") if n in values)
        free &= all(values[name] <= TERMS[name].most for name in problem.labels if name in TERMS)
        possible = friction_brakes(values, self.masses)
        if not (end.converged and end.at.cost <= enough and free and possible):
            return None
        return None if conditioning_of(problem, end.at).singular else found

    def without(self, names: Collection[str]) -> Self:
        """Fit without some terms."""
        problem = self.problem.without({*names})
        kept = np.isin(self.problem.labels, problem.labels)
        values = self.nested.fitted(kept[np.newaxis])[0][kept]
        there = None
        if is_near(problem.named(values), self.values, self.masses):
            there = self.equations(problem, values)
        if there is None or not there.is_finite:
            there = self.equations(problem, self.end.values[kept])
        return replace(self, problem=problem, end=self.descended(problem, there))

    def confirms(self, rival: Mapping[str, float]) -> bool:
        """Whether a rival, simulated once, follows the logs as well as the fit."""
        if not is_near(rival, self.values, self.masses):
            return False
        there = self._with(rival, rival)
        try:
            at = self.simulated(there, there.initial)
        except IdentifiabilityError:
            return False
        if not at.is_finite:
            return False
        its = nested_about(there, at, len(self.every.keys)).equations.cost
        return as_good(np.sqrt(its), np.sqrt(self.nested.equations.cost))


def nested_about(problem: Problem, at: Equations, most: int) -> Submodels:
    """Return fits with fewer terms, about equations in cells for ``most`` unknowns."""
    count = independent_cells_of(len(at.logs), most)
    cells = at.cells(problem.labels, problem.lower, count)
    return submodels_of(cells, [log.added_mass for log in problem.logs], NEGLIGIBLE)


def stagewise_fit(
    every: Problem, fitted: Fitted, rows: Sequence[str], rare: Collection[str]
) -> Fitted:
    """Choose from the rows of a problem, beginning with a fit in some of them."""
    model = FreeRunModel(every=every, problem=fitted.problem, end=fitted.end, rows=tuple(rows))
    found = stagewise(model, rows, rare)
    return fitted_of(found, found.model.problem.descend(found.model.end.at), fitted)


def fitted_of(found: ChosenTerms[Any], end: Minimum, before: Fitted) -> Fitted:
    """Return the end of a fit in chosen terms, with what speaks for others."""
    problem, first = found.model.problem, before.path[-1] if before.path else ()
    labels = problem.labels[: problem.shared]
    rivals = (
        np.array([each.get(label, value_if_absent(label)) for label in labels])
        for each in found.rival_values()
    )
    said = [each for each in before.findings if each.kind is not FindingKind.NOT_HELPING]
    more = ((*first, *terms) for terms in found.path[bool(before.path) :])
    return Fitted(
        problem=problem,
        end=end,
        rivals=tuple(rivals),
        findings=tuple(dict.fromkeys([*said, *found.findings])),
        path=(*before.path, *more),
    )


def conditioning_of(problem: Problem, at: Equations) -> Conditioning:
    """Return how well equations tell the unknowns apart."""
    told = None if at.prior is None else at.prior.active
    return Conditioning.of(np.concatenate(at.compressed(1)[0]), problem.names, told)


def _inseparable(problem: Problem, at: Equations) -> tuple[str, ...]:
    """Return a term, and what comes with it, that the equations cannot tell from the others."""
    conditioning = conditioning_of(problem, at)
    doubtful = [n for n in conditioning.weakest if n in {*COMMON, *offered("output-error")}]
    if not conditioning.singular or not doubtful:
        return ()
    together = {doubtful[-1], *TERMS[doubtful[-1]].follows}
    together |= companions(together)
    return tuple(name for name in problem.names if name in together)


def separable(fitted: Fitted) -> Fitted:
    """Fit again without what the equations cannot tell from the rest, and say so."""
    while lost := _inseparable(fitted.problem, fitted.end.at):
        kept = np.flatnonzero([name not in lost for name in fitted.problem.names])
        fewer = fitted.problem.keeping(kept, fitted.end.values[kept])
        said = Finding(FindingKind.INSEPARABLE, parameters=lost)
        fitted = replace(
            fitted,
            problem=fewer,
            end=fewer.descend(fewer.equations(fewer.initial, fitted.end.at)),
            rivals=tuple(each[kept[kept < each.size]] for each in fitted.rivals),
            findings=(*fitted.findings, said),
            path=tuple(tuple(n for n in each if n not in lost) for each in fitted.path),
        )
    return fitted
