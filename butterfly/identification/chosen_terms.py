"""Which terms a fit of free runs has: those that predict logs left out, and rarer ones it lacks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.blocks import Conditions, cells_of, independent_cells_of
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.fit import Equations, Minimum
from butterfly.identification.inference.agreement import contrasts_of, lacking_term
from butterfly.identification.inference.covariance import cluster_covariance
from butterfly.identification.inference.identifiability import Conditioning
from butterfly.identification.inference.term_choice import (
    BASE,
    CANDIDATES,
    RARER,
    SCANNED,
    TermChoice,
    choose_terms,
    submodels_of,
)
from butterfly.identification.levels import LOST, SPREADS
from butterfly.identification.problem import Problem
from butterfly.logs.log import InputKind, Log
from butterfly.model.terms import GEAR, TERMS, companions, offered
from butterfly.progress import out_of_time

TRIED = (*CANDIDATES, *companions({SCANNED}))
"""Terms that are tried where none are told."""

OF_SERVO = ("motor_friction", "load_friction", "back_emf", "compression", "latency")
"""Terms that are tried besides of a servo, which has a gear and can be switched off."""


def tried(logs: Iterable[Log]) -> tuple[str, ...]:
    """Return the terms that are tried where none are told; no back EMF of a torque drive."""
    kinds = {log.input_kind for log in logs if log.setpoint is not None}
    if not kinds:
        return TRIED
    against = {"back_emf"} if kinds <= {InputKind.CURRENT, InputKind.TORQUE} else set()
    return (*TRIED, *(name for name in OF_SERVO if name not in against))


def not_tried(problem: Problem) -> set[str]:
    """Return the terms that nobody looks for beside those that are fitted."""
    fitted = {*problem.names}
    idle = {*tried(problem.logs)} - fitted
    if BASE in fitted:  # on which friction of gears is not simulated
        return idle | {*GEAR}
    return idle | {BASE} if fitted & {*GEAR} else idle


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """A problem in chosen terms, where its descent ended, and what speaks for others."""

    problem: Problem
    end: Minimum
    rivals: tuple[Samples, ...] = ()  # (s,) shared values of fits that predict as well
    findings: tuple[Finding, ...] = ()


def helping(problem: Problem, at: Equations, always: Sequence[str] = ()) -> TermChoice:
    """Choose the terms that help to predict the free runs of logs left out."""
    every = {*tried(problem.logs), *RARER}
    optional = every.difference(always) | companions(every)
    cells = independent_cells_of(len(at.logs), len(problem.keys))
    conditions = Conditions.of(problem.logs, cells)
    masses = [log.added_mass for log in problem.logs]
    nested = submodels_of(problem.cells(at, cells), masses, conditions=conditions)
    return choose_terms([nested], always=tuple(n for n in problem.labels if n not in optional))


def fitted_with(problem: Problem, choice: TermChoice) -> Fitted:
    """Fit what was chosen, from the values that the nested fit has."""
    wanted, labels = {*choice.names, *companions(choice.names)}, problem.labels
    kept = np.flatnonzero([label in wanted for label in labels])
    here = dict(zip(labels, problem.initial.tolist(), strict=True))
    first, *others = (
        np.array([values.get(labels[k], here[labels[k]]) for k in kept])
        for values in (choice.values, *choice.rivals)
    )
    fewer = problem.keeping(kept, first)
    rivals = tuple(each[: fewer.shared] for each in others)
    return Fitted(problem=fewer, end=fewer.descend(), rivals=rivals, findings=choice.findings)


def lacking(wide: Problem, problem: Problem, values: Samples) -> str | None:
    """Return the rarer term, of those of a wide problem, that one in fewer unknowns lacks."""
    absent = [n for n, _ in wide.keys if n in RARER and (n, None) not in problem.keys]
    if not absent:
        return None
    cells = cells_of(len(wide.motion), len(wide.keys))
    return lacking_term(wide.cells(wide.about(problem, values), cells), absent, wide.conditions)


def chosen(wide: Problem, rarer: set[str], fitted: Fitted, always: tuple[str, ...]) -> Fitted:
    """Choose terms of a wide problem; of the rarer ones, one by one, those that the fit lacks."""
    (begun, name), common = (fitted, None), None
    while True:
        here, before = wide.without(rarer), fitted
        at = fitted.end.at
        if name or here.keys != fitted.problem.keys:
            at = here.about(fitted.problem, fitted.end.values)
        if not name and here.keys != fitted.problem.keys:  # at 0 some look like nothing
            at = here.descend(at).at
        fitted = fitted_with(here, helping(here, at, always))
        worse = name is not None and fitted.end.at.cost > before.end.at.cost
        if worse:
            fitted = before
        elif LOST * fitted.end.at.cost > before.end.at.cost:  # not what the derivatives said
            fitted = _without_nothing(begun)
        there = wide.without(not_tried(fitted.problem))
        name = None if worse else lacking(there, fitted.problem, fitted.end.values)
        if name is None or out_of_time("the selection of terms"):
            own = fitted.problem
            if common and contrasts_of(own.solved(fitted.end), own.conditions):
                return common  # it is no such term
            return fitted
        if name != "slow_delay":  # which stamps tell from all else
            common = common or fitted
        rarer, always = rarer - {name}, (*always, name)


def _without_nothing(fitted: Fitted) -> Fitted:
    """Fit again without the terms that are 0."""
    problem, optional = fitted.problem, {*tried(fitted.problem.logs), *RARER}
    pairs = zip(problem.names, fitted.end.values.tolist(), strict=True)
    keys = problem.without({name for name, value in pairs if not value} & optional).keys
    kept = np.flatnonzero([key in keys for key in problem.keys])
    fewer = problem.keeping(kept, fitted.end.values[kept])
    return Fitted(problem=fewer, end=fewer.descend())


def conditioning_of(problem: Problem, at: Equations) -> Conditioning:
    """Return how well equations tell the unknowns apart."""
    told = None if at.prior is None else at.prior.active
    return Conditioning.of(np.concatenate(at.compressed(1)[0]), problem.names, told)


def _inseparable(problem: Problem, at: Equations) -> tuple[str, ...]:
    """Return a term, and what comes with it, that the equations cannot tell from the others."""
    conditioning = conditioning_of(problem, at)
    doubtful = [n for n in conditioning.weakest if n in {*TRIED, *offered("output-error")}]
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
        fitted = Fitted(
            problem=fewer,
            end=fewer.descend(),
            rivals=tuple(each[kept[kept < each.size]] for each in fitted.rivals),
            findings=(*fitted.findings, said),
        )
    return fitted


def untold_shape(problem: Problem, end: Minimum) -> str | None:
    """Return what of the shape of a base's motion could as well be 0, or twice as large."""
    names = problem.names
    shape = [names.index(name) for name in sorted(companions({BASE})) if name in names]
    if not shape:
        return None
    found = problem.solved(end, cells=1)
    if mute := [k for k in shape if not found.rows[:, :, k].any()]:
        return names[mute[0]]
    covariance, _ = cluster_covariance(found.rows, found.residuals, found.prior)
    told = np.abs(found.values[shape]) / np.sqrt(np.diag(covariance)[shape])
    return names[shape[int(np.argmin(told))]] if np.min(told) < SPREADS else None
