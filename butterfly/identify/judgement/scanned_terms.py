"""A choice of terms where the Stribeck velocity is no parameter, but tried at several values."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

from butterfly.identify.judgement.term_choice import choose_terms, stribeck_velocities
from butterfly.model.terms import PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from butterfly.identify.judgement.nested import Nested
    from butterfly.identify.judgement.term_choice import TermChoice

SCANNED = "stribeck"
"""The term whose velocity is tried."""


class Equations(Protocol):
    """What gives the equations of a method with any terms."""

    @property
    def fastest(self) -> float:
        """Largest speed of the logs in rad/s."""

    def with_terms(self, terms: tuple[str, ...], speed: float | None) -> Nested:
        """Return the equations with terms besides `PARAMETERS`.

        Parameters
        ----------
        terms
            Their names.
        speed
            Stribeck velocity in rad/s; None where no term needs it.
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class ScannedTerms:
    """Terms for a method.

    Parameters
    ----------
    chosen
        Those to fit.
    free
        What would have been chosen from all terms; None if that was not asked.
    """

    chosen: TermChoice
    free: TermChoice | None

    @classmethod
    def of(
        cls,
        equations: Equations,
        tried: tuple[str, ...],
        told: tuple[str, ...] | None,
        *,
        check: bool,
        scan: bool = True,
    ) -> ScannedTerms:
        """Choose from all terms, or, where they are told, only their Stribeck velocity.

        Parameters
        ----------
        equations
            Of the method.
        tried
            Terms to choose from, besides Stribeck friction.
        told
            Terms that are wanted, or None.
        check
            Whether to say which terms would help that were not told.
        scan
            Whether Stribeck friction is among them.
        """
        if told is None:
            free = choose_terms([*_fits(equations, tried)], always=PARAMETERS)
            return cls(chosen=free, free=free)
        rest = tuple(name for name in told if name != SCANNED)
        with_it = SCANNED in told
        fits = [*_fits(equations, rest, plain=not with_it, scanned=with_it)]
        chosen = choose_terms(fits, always=PARAMETERS, demanded=told)
        if not check:
            return cls(chosen=chosen, free=None)
        every = [*_fits(equations, tried, scanned=scan)]
        return cls(chosen=chosen, free=choose_terms(every, always=PARAMETERS))


def _fits(
    equations: Equations, names: tuple[str, ...], *, plain: bool = True, scanned: bool = True
) -> Iterator[Nested]:
    """Yield the equations without Stribeck friction, and with it at one velocity after another."""
    if plain:
        yield equations.with_terms(names, None)
    if scanned:
        for speed in stribeck_velocities(equations.fastest):
            nested = equations.with_terms((*names, SCANNED), speed)
            yield replace(nested, demanded=(SCANNED,), settings={"stribeck_velocity": speed})
