"""Which terms a balance of fundamentals fits, and at which Stribeck velocity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from butterfly.identify.judgement.findings import Finding, FindingKind
from butterfly.identify.judgement.term_choice import (
    candidates,
    choose_terms,
    folds_of,
    missing_terms,
    stribeck_velocities,
)
from butterfly.model.terms import PARAMETERS, offered

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.identify.estimators.describing_fit import DescribingFit
    from butterfly.identify.judgement.nested import Nested
    from butterfly.identify.phasors import Phasors

_SCANNED, _OF_REST = "stribeck", "bias"


@dataclass(frozen=True, kw_only=True, eq=False)
class DescribingTerms:
    """Terms for a balance.

    Parameters
    ----------
    phasors
        The balance with them.
    held
        What is set, not fitted.
    rivals
        (n,) values of fits with other terms that predict as well.
    said
        What there is to say of terms that are not fitted.
    best
        What would have been chosen from all terms; empty if that was not asked.
    """

    phasors: Phasors
    held: dict[str, float]
    rivals: tuple[NDArray[np.float64], ...]
    said: tuple[Finding, ...]
    best: dict[str, float]

    @classmethod
    def of(
        cls, fit: DescribingFit, terms: tuple[str, ...] | None, *, check: bool
    ) -> DescribingTerms:
        """Choose from all terms, or, where they are told, only their Stribeck velocity.

        Parameters
        ----------
        fit
            Without any.
        terms
            Told, or None.
        check
            Whether to say which terms would help that were not told.
        """
        folds = folds_of(fit.phasors.masses)
        free = None
        if check or terms is None:
            offers = [n for n in offered("harmonic-balance") if n not in {_SCANNED, _OF_REST}]
            every = candidates(offers, fit.phasors.masses)
            fits = [_plain(fit, every, folds), *_scanned(fit, every, folds)]
            free = choose_terms(fits, always=PARAMETERS)
        chosen = free
        if terms is not None:
            terms = tuple(name for name in terms if name != _OF_REST)
            rest = tuple(name for name in terms if name != _SCANNED)
            fits = [_plain(fit, rest, folds)] if rest == terms else _scanned(fit, rest, folds)
            chosen = choose_terms(fits, always=PARAMETERS, demanded=terms)
        assert chosen is not None  # noqa: S101 - by one way or the other
        held = chosen.settings if _SCANNED in chosen.terms else {}
        names = (*PARAMETERS, *chosen.terms)
        speed = held.get("stribeck_velocity", fit.phasors.stribeck_velocity)
        best = fit.values_of(free.names, free.values).tolist() if free else []
        return cls(
            phasors=replace(fit.phasors, names=names, stribeck_velocity=speed),
            held=held,
            rivals=tuple(fit.values_of(names, each) for each in chosen.rivals),
            said=chosen.findings,
            best=dict(zip(free.names, best, strict=True)) if free else {},
        )

    def without(self, idle: tuple[str, ...]) -> DescribingTerms:
        """Return the terms without some that turned out to be nothing."""
        kept = np.array([name not in idle for name in self.phasors.names])
        names = tuple(name for name in self.phasors.names if name not in idle)
        return replace(
            self,
            phasors=replace(self.phasors, names=names),
            held={} if _SCANNED in idle else self.held,
            rivals=tuple(each[kept] for each in self.rivals),
            said=(*self.said, Finding(kind=FindingKind.NOT_HELPING, parameters=idle)),
            best={name: value for name, value in self.best.items() if name not in idle},
        )

    def judge(self, found: ParameterEstimate) -> ParameterEstimate:
        """Return the estimate, with what there is to say of terms."""
        return found.with_findings(*self.said, *missing_terms(found, self.best))


def _plain(fit: DescribingFit, names: tuple[str, ...], folds: NDArray[np.intp]) -> Nested:
    """Return the equations with terms, without Stribeck friction."""
    return fit.nested(replace(fit.phasors, names=(*PARAMETERS, *names)), folds)


def _scanned(fit: DescribingFit, names: tuple[str, ...], folds: NDArray[np.intp]) -> list[Nested]:
    """Return the equations with terms and Stribeck friction, at one velocity after another."""
    fastest = float(np.max(np.abs(fit.phasors.angle) * fit.phasors.omega))
    fits = []
    for speed in stribeck_velocities(fastest):
        with_it = (*PARAMETERS, *names, _SCANNED)
        nested = fit.nested(replace(fit.phasors, names=with_it, stribeck_velocity=speed), folds)
        settings = {"stribeck_velocity": speed}
        fits.append(replace(nested, demanded=(_SCANNED,), settings=settings))
    return fits
