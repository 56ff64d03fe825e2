"""Which terms a balance of fundamentals fits, and at which Stribeck velocity."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.describing_fit import DescribingFit
from butterfly.identification.inference.submodels import Nested
from butterfly.identification.inference.term_choice import (
    SCANNED,
    ScannedTerms,
    candidates,
    folds_of,
    missing_terms,
    stribeck_velocities,
    told_terms,
)
from butterfly.identification.phasors import Phasors
from butterfly.model.terms import offered

_OF_REST = "bias"


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
        offers = [n for n in offered("harmonic-balance") if n not in {SCANNED, _OF_REST}]
        known = fit.phasors.known
        every = candidates(offers, fit.phasors.masses, known)
        told = None if terms is None else told_terms(terms, {_OF_REST, *known.parameters})
        found = ScannedTerms.of(_Balances(fit), every, told, check=check)
        chosen, free = found.chosen, found.free
        names = chosen.names
        speed = chosen.settings.get("stribeck_velocity", fit.phasors.stribeck_velocity)
        best = fit.values_of(free.names, free.values).tolist() if free else []
        return cls(
            phasors=replace(fit.phasors, names=names, stribeck_velocity=speed),
            held=chosen.settings,
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
            held={} if SCANNED in idle else self.held,
            rivals=tuple(each[kept] for each in self.rivals),
            said=(*self.said, Finding(kind=FindingKind.NOT_HELPING, parameters=idle)),
            best={name: value for name, value in self.best.items() if name not in idle},
        )

    def judge(self, found: Estimate) -> Estimate:
        """Return the estimate, with what there is to say of terms."""
        return found.with_findings(*self.said, *missing_terms(found, self.best))


class _Balances:
    """The equations of a fit with more terms."""

    def __init__(self, fit: DescribingFit) -> None:
        self.always = fit.phasors.names
        self._fit, self._folds = fit, folds_of(fit.phasors.masses)

    @property
    def speeds(self) -> list[float]:
        phasors = self._fit.phasors
        fastest = float(np.max(np.abs(phasors.angle) * phasors.omega))
        return stribeck_velocities(fastest, phasors.known)

    def with_terms(self, terms: tuple[str, ...], speed: float | None) -> Nested:
        phasors = replace(self._fit.phasors, names=(*self.always, *terms))
        if speed is not None:
            phasors = replace(phasors, stribeck_velocity=speed)
        return self._fit.nested(phasors, self._folds)
