"""Which terms the weak form fits, and at which Stribeck velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.estimators.weak_fit import WeakFit, Windows
from butterfly.identification.inference.submodels import Nested
from butterfly.identification.inference.term_choice import (
    ScannedTerms,
    candidates,
    folds_of,
    stribeck_velocities,
    told_terms,
)
from butterfly.model.known import Knowledge
from butterfly.model.terms import PARAMETERS, FrictionTerms

CANDIDATES = ("drag", "load", "bias", "p3_offset")
"""Terms that are tried where none are told, besides Stribeck friction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WeakTerms:
    """Terms for the weak form, and the fit with them.

    Parameters
    ----------
    fit
        With the terms.
    held
        What is set, not fitted.
    rivals
        (n,) values of fits with other terms that predict as well.
    said
        What there is to say of terms that are not fitted.
    best
        What would have been chosen from all terms; empty if that was not asked.
    """

    fit: WeakFit
    held: dict[str, float]
    rivals: tuple[NDArray[np.float64], ...]
    said: tuple[Finding, ...]
    best: dict[str, float]

    @classmethod
    def of(
        cls,
        windows: Sequence[Windows],
        terms: tuple[str, ...] | None,
        known: Knowledge,
        *,
        check: bool,
    ) -> WeakTerms:
        """Choose from all terms, or, where they are told, only their Stribeck velocity.

        Parameters
        ----------
        windows
            Of the logs.
        terms
            Told, or None.
        known
            Of the robot.
        check
            Whether to say which terms would help that were not told; Stribeck friction is not
            looked for then, since its scan costs more than the fit.
        """
        usual = known.exact.get("stribeck_velocity", FrictionTerms.stribeck_velocity)
        always = known.fitted(PARAMETERS)
        tried = candidates(CANDIDATES, (each.added for each in windows), known)
        told = None if terms is None else told_terms(terms, known.parameters)
        first = WeakFit.of(windows, (*always, *(tried if told is None else ())), usual, known)
        equations = _Averages(first, windows, always)
        found = ScannedTerms.of(equations, tried, told, check=check, scan=False)
        chosen = found.chosen
        slow = chosen.settings.get("stribeck_velocity", usual)
        return cls(
            fit=WeakFit.of(windows, chosen.names, slow, known, first.about.delay),
            held=chosen.settings,
            rivals=chosen.rival_values,
            said=chosen.findings,
            best=found.free.best if found.free else {},
        )


class _Averages:
    """The equations of a fit with other terms."""

    def __init__(self, fit: WeakFit, windows: Sequence[Windows], always: tuple[str, ...]) -> None:
        self.always = always
        self._fit, self._windows = fit, windows
        self._folds = folds_of([each.added for each in windows])

    @property
    def speeds(self) -> list[float]:
        fastest = max(each.averaging.fastest for each in self._windows)
        return stribeck_velocities(fastest, self._fit.about.known)

    def with_terms(self, terms: tuple[str, ...], speed: float | None) -> Nested:
        slow = self._fit.about.slow if speed is None else speed
        return self._fit.nested(self._windows, (*self.always, *terms), slow, self._folds)
