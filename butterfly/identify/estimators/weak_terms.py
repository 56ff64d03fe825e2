"""Which terms the weak form fits, and at which Stribeck velocity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from butterfly.identify.estimators.weak_fit import WeakFit
from butterfly.identify.judgement.term_choice import (
    candidates,
    choose_terms,
    folds_of,
    stribeck_velocities,
)
from butterfly.model.terms import PARAMETERS, FrictionTerms

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from butterfly.identify.estimators.weak_fit import Windows
    from butterfly.identify.judgement.findings import Finding
    from butterfly.identify.judgement.nested import Nested

CANDIDATES = ("drag", "load", "bias", "p3_offset")
"""Terms that are tried where none are told, besides Stribeck friction."""

_SCANNED = "stribeck"


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
        cls, windows: Sequence[Windows], terms: tuple[str, ...] | None, *, check: bool
    ) -> WeakTerms:
        """Choose from all terms, or, where they are told, only their Stribeck velocity.

        Parameters
        ----------
        windows
            Of the logs.
        terms
            Told, or None.
        check
            Whether to say which terms would help that were not told; Stribeck friction is not
            looked for then, since its scan costs more than the fit.
        """
        settings = FrictionTerms()
        tried = candidates(CANDIDATES, (each.added for each in windows))
        names = (*PARAMETERS, *(tried if terms is None else ()))
        first = WeakFit.of(windows, names, settings.stribeck_velocity)
        free = None
        if check or terms is None:
            fits = [_plain(first, windows, tried)]
            if terms is None:
                fits += _scanned(first, windows, tried)
            free = choose_terms(fits, always=PARAMETERS)
        chosen = free
        if terms is not None:
            rest = tuple(name for name in terms if name != _SCANNED)
            fits = [_plain(first, windows, rest)]
            if _SCANNED in terms:
                fits = _scanned(first, windows, rest)
            chosen = choose_terms(fits, always=PARAMETERS, demanded=terms)
        assert chosen is not None  # noqa: S101 - by one way or the other
        held = chosen.settings if _SCANNED in chosen.terms else {}
        slow = held.get("stribeck_velocity", settings.stribeck_velocity)
        return cls(
            fit=WeakFit.of(windows, chosen.names, slow, first.delay),
            held=held,
            rivals=chosen.rival_values,
            said=chosen.findings,
            best=free.best if free else {},
        )


def _plain(first: WeakFit, windows: Sequence[Windows], names: tuple[str, ...]) -> Nested:
    """Return the equations with terms, without Stribeck friction."""
    folds = folds_of([each.added for each in windows])
    return first.nested(windows, (*PARAMETERS, *names), first.slow, folds)


def _scanned(first: WeakFit, windows: Sequence[Windows], names: tuple[str, ...]) -> list[Nested]:
    """Return the equations with terms and Stribeck friction, at one velocity after another."""
    folds = folds_of([each.added for each in windows])
    fastest = max(each.averaging.fastest for each in windows)
    fits = []
    for speed in stribeck_velocities(fastest):
        nested = first.nested(windows, (*PARAMETERS, *names, _SCANNED), speed, folds)
        settings = {"stribeck_velocity": speed}
        fits.append(replace(nested, demanded=(_SCANNED,), settings=settings))
    return fits
