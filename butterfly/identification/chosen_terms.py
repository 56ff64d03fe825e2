"""Which terms a fit of free runs has: the stagewise rule, each row fitted to the logs anew.

A term that is not fitted may show as one that is: a spring that pulls to an angle of its own leaves
a bias, and its stiffness is read as a gravity moment. Where such a term, added, predicts held-out
logs better, the intervals include the values with it, however little of the error it explains.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.fit import MOST, PASSES, Fit, LackedTerm
from butterfly.identification.limits import Rival, independent_cells_of
from butterfly.identification.linearisation import Linearisation
from butterfly.identification.problem import Problem
from butterfly.identification.scatter import NEGLIGIBLE, Submodels, submodels_of
from butterfly.identification.stagewise import (
    PROMISED,
    ROUNDS,
    STRIBECK,
    Offer,
    as_good,
    candidates,
    is_near,
    offers_in,
    stagewise,
    stribeck_velocities,
)
from butterfly.identification.trust import FEW, MATTERS, SHOWS, Finding, FindingKind
from butterfly.logs.log import InputKind, Log, slow_interval
from butterfly.model.parameters import AddedMass, friction_brakes, value_if_absent
from butterfly.model.prior import Prior
from butterfly.model.terms import (
    COMMON,
    FOLLOWERS,
    OF_SERVO,
    PARAMETERS,
    RARE,
    TERMS,
    companions,
    offered,
)
from butterfly.progress import out_of_time

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
class FreeRunModel:
    """The end of a fit of free runs in some of the rows of a problem (see `stagewise.Model`)."""

    every: Problem  # with all rows
    fit: Fit  # in some of them
    rows: tuple[str, ...]  # that may be absent
    simulates: bool = True

    @cached_property
    def problem(self) -> Problem:
        """The problem in the values of the fit."""
        return self.every.of_fit(self.fit)

    @cached_property
    def first(self) -> dict[str, float]:
        """First guesses of all unknowns, by label."""
        return dict(zip(self.every.labels, self.every.initial.tolist(), strict=True))

    @property
    def terms(self) -> frozenset[str]:
        """The optional terms that it has."""
        return frozenset(self.problem.names).intersection(self.rows)

    @property
    def masses(self) -> list[AddedMass]:
        """The added mass of each log."""
        return [log.added_mass for log in self.problem.logs]

    @cached_property
    def nested(self) -> Submodels:
        """Its equations, and those of fits with fewer terms."""
        return nested_about(self.problem, self.fit.linearisation, len(self.every.keys))

    @property
    def is_fitted(self) -> NDArray[np.bool_]:
        """(n,) which of the parameters of these are fitted: all."""
        return np.ones(len(self.problem.labels), dtype=bool)

    def offers(self, rows: Collection[str]) -> list[Offer]:
        """Test rows that it does not have, on simulations that are differentiated by them."""
        offers = self._offers([name for name in rows if name != STRIBECK], {})
        if STRIBECK in rows:
            fastest = 2**0.5 * max(log.rms_speed for log in self.problem.logs)
            tried = [
                offer
                for speed in stribeck_velocities(fastest)
                for offer in self._offers([STRIBECK], {"stribeck_velocity": speed})
            ]
            offers += [max(tried, key=lambda offer: offer.share)] if tried else []
        return offers

    def _offers(self, rows: Sequence[str], settings: Mapping[str, float]) -> list[Offer]:
        if not rows:
            return []
        there = self._with(rows, settings)
        at = self.equations(there, there.values_from(self.problem, self.fit.values))
        if at is None:
            return []
        fitted = np.isin(there.labels, self.problem.labels)
        nested = nested_about(there, at, len(self.every.keys))
        return offers_in(replace(nested, settings=dict(settings)), fitted, rows, self.masses)

    def equations(
        self, there: Problem, values: Samples, *, slopes: bool = True
    ) -> Linearisation | None:
        """Return the equations of a problem in other terms about (n,) values; None of no motion.

        Without ``slopes`` they are errors alone, and have no prior.
        """
        try:
            at = there.equations(values, self.fit.linearisation, slopes=slopes)
            at = at.counting(there.options.loss)
            at = there.with_scaled_prior(at) if slopes else at
        except IdentifiabilityError:
            return None
        return at if at.is_finite else None

    def descended(
        self, there: Problem, at: Linearisation, most: int = MOST, enough: float = SHOWS
    ) -> Fit | None:
        """Return where a descent in other terms ends, as far as their choice needs it, if it does.

        A descent into ever stiffer joints, as a base that hardly moves, ends after as many steps of
        simulations as ``most`` expansions take at its start.
        """
        try:
            return there.descend(at, most, enough, most * at.steps)
        except IdentifiabilityError:
            return None

    def _with(self, rows: Iterable[str], values: Mapping[str, float]) -> Problem:
        """Return the problem with more rows, first guesses by label being as given."""
        wanted = {*self.problem.labels, *rows, *companions(rows)}
        indices = np.flatnonzero([label in wanted for label in self.every.labels])
        initial = np.array([{**self.first, **values}[self.every.labels[k]] for k in indices])
        there = replace(self.every.keeping(indices, initial), scatter=self.fit.scatter)
        return replace(there, initial=np.maximum(initial, there.lower))

    def adding(self, offer: Offer) -> Self | None:
        """Fit with a row more; None if no joint has it, or it does not keep what it promised."""
        moved = {label: offer.values[label] for label in (*self.fit.named, offer.name)}
        problem = self._with([offer.name], {**offer.nested.settings, **moved})
        promised = offer.share * float(self.nested.equations.squares.sum()) / 2
        enough = self.fit.cost - PROMISED * promised
        at = self.equations(problem, problem.initial)
        end = self.descended(problem, at, TRIAL) if at and at.cost <= enough else None
        if end is None:
            return None
        values, least = end.named, problem.named(problem.lower)
        free = all(values[n] > least[n] for n in (offer.name, "p1") if n in values)
        free &= all(values[name] <= TERMS[name].most for name in problem.labels if name in TERMS)
        possible = friction_brakes(values, self.masses)
        if not (end.converged and end.cost <= enough and free and possible):
            return None
        if end.linearisation.cells(1).conditioning.singular:
            return None
        return replace(self, fit=end)

    def without(self, names: Collection[str]) -> Self | None:
        """Fit without some terms; None if every simulation without them is twice as bad.

        Whether they help to predict is asked before. It begins where the equations promise most, if
        that is not so bad, or else nearby.
        """
        problem, enough = self.problem.without({*names}), self.fit.cost / PROMISED
        is_left = np.isin(self.problem.labels, problem.labels)
        promised = self.nested.fitted(is_left[np.newaxis])[0][is_left]
        guesses = [
            self.fit.values[is_left],
            np.array([self.first[label] for label in problem.labels]),
        ]
        if is_near(problem.named(promised), self.fit.named, self.masses):
            guesses.insert(0, promised)
        tried: list[Linearisation] = []
        for values in guesses:
            if at := self.equations(problem, values):
                tried.append(at)
                if at.cost <= enough:
                    break
        there = min(tried, key=lambda at: at.cost, default=None)
        end = self.descended(problem, there) if there else None
        return replace(self, fit=end) if end and end.cost <= enough else None

    def confirms(self, rival: Mapping[str, float]) -> bool:
        """Whether a rival, simulated once, follows the logs as well as the fit."""
        if not is_near(rival, self.fit.named, self.masses):
            return False
        terms = [name for name in rival if rival[name] != value_if_absent(name)]
        there = self._with([name for name in terms if name not in FOLLOWERS], rival)
        at = self.equations(there, there.initial, slopes=False)
        if at is None:
            return False
        its = nested_about(there, at, len(self.every.keys)).equations.squares
        return as_good(np.sqrt(its), np.sqrt(self.nested.equations.squares))


def nested_about(problem: Problem, at: Linearisation, most: int) -> Submodels:
    """Return fits with fewer terms, about equations in cells for ``most`` unknowns."""
    cells = at.cells(independent_cells_of(len(problem.motion), most))
    return submodels_of(cells, [log.added_mass for log in problem.logs], NEGLIGIBLE)


def choose(
    every: Problem,
    fit: Fit,
    rows: Sequence[str],
    rare: Collection[str],
    rounds: int = ROUNDS,
) -> Fit:
    """Choose from the rows of a problem, beginning with a fit in some of them.

    A fit to weighed logs keeps its terms but those on their bound: the mean of all logs needs them,
    but the friction of each log would take their place. With 0 ``rounds`` only missing terms are
    looked for.
    """
    if not rows or out_of_time("the selection of terms"):
        return fit
    model = FreeRunModel(every=every, fit=fit, rows=tuple(rows))
    staying = model.terms if fit.scatter else frozenset[str]()
    try:
        selection = stagewise(model, rows, rare, rounds, staying)
        chosen = selection.model.fit
        if fit.scatter is None and rounds:
            chosen = selection.model.problem.descend(chosen.linearisation)
    except IdentifiabilityError:
        if fit.scatter is None:
            raise
        return fit  # no weighed logs move as other terms would have it
    findings = [finding for finding in fit.findings if finding.kind is not FindingKind.NOT_HELPING]
    return replace(
        chosen,
        unweighed=fit.unweighed,
        rivals=tuple(selection.rival_values()),
        findings=tuple(dict.fromkeys([*findings, *selection.findings])),
        path=(*fit.path, *selection.path[bool(fit.path) :]),
        missing=tuple(map(_missing, selection.missing)),
    )


def _missing(offer: Offer) -> LackedTerm:
    """Return a row that passes and is not fitted, with its share of each log's errors."""
    nested, names = offer.nested, np.array(offer.nested.names)
    fits = nested.fitted(np.array([offer.is_fitted, offer.is_fitted | (names == offer.name)]))
    _, log = np.unique(nested.equations.log, return_inverse=True)
    before, after = (np.bincount(log, costs) for costs in nested.costs(fits))
    return LackedTerm(offer.name, offer.share, 1 - after / before, offer.values)


def inseparable_terms(at: Linearisation) -> tuple[str, ...]:
    """Return a term, and what comes with it, that the equations cannot separate from the others."""
    conditioning = at.cells(1).conditioning
    doubtful = [n for n in conditioning.weakest if n in {*COMMON, *offered("output-error")}]
    if not conditioning.singular or not doubtful:
        return ()
    together = {doubtful[-1], *TERMS[doubtful[-1]].follows}
    together |= companions(together)
    return tuple(name for name in at.names if name in together)


def separable(every: Problem, fit: Fit) -> Fit:
    """Fit again without what the equations cannot separate from the rest, and say so."""
    while lost := inseparable_terms(fit.linearisation):
        problem = every.of_fit(fit)
        indices = np.flatnonzero(~np.isin(problem.labels, lost))
        fewer = problem.keeping(indices, fit.values[indices])
        end = fewer.descend(fewer.equations(fewer.initial, fit.linearisation))
        finding = Finding(FindingKind.INSEPARABLE, parameters=lost)
        fit = replace(
            end,
            rivals=fit.rivals,
            missing=fit.missing,
            findings=(*fit.findings, finding),
            path=tuple(tuple(n for n in terms if n not in lost) for terms in fit.path),
        )
    return fit


class TwinTerm(NamedTuple):
    """A term that a fit lacks, and the fit's shared values with it."""

    name: str
    rival: Rival
    moved: dict[str, float]  # parameters that it moves, and the share

    @property
    def finding(self) -> Finding:
        """What it would move, and by which share at most."""
        return Finding(
            FindingKind.LIKE_TERM, (self.name, *self.moved), number=max(self.moved.values())
        )


def spoken_for(names: Iterable[str]) -> tuple[str, ...]:
    """Return the terms that are not among some names, and that one of these speaks for."""
    has = {*names}
    return tuple(row.name for row in TERMS.values() if row.shows_as & has and row.name not in has)


def twin_terms(every: Problem, fit: Fit, rows: Iterable[str]) -> list[TwinTerm]:
    """Return those of some rows of a problem that predict better than a fit and move parameters."""
    twins, model = [], FreeRunModel(every=every, fit=fit, rows=tuple(rows))
    shared = model.problem.labels[: model.problem.shared]
    for offer in (offer for name in rows for offer in model.offers([name])):
        if not (offer.ratio > 1 and model.confirms(offer.values)):
            continue
        there = np.array([offer.values[label] for label in offer.nested.names])
        about = offer.nested.about(there).equations
        half = dict(zip(about.names, about.half_widths.tolist(), strict=True))
        values = np.array([offer.values[label] for label in shared])
        widths = np.array([half[label] for label in shared])
        moved = {
            label: float(abs(value / old - 1))
            for label, value, old in zip(shared, values, fit.values, strict=False)
            if label in PARAMETERS and abs(value - old) > MATTERS * abs(old)
        }
        if moved:
            twins.append(TwinTerm(offer.name, Rival(values, widths), moved))
    return twins
