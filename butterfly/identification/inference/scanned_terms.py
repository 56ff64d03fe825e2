"""A choice of terms where the Stribeck velocity is no parameter, but tried at several values."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from butterfly.identification.inference.submodels import Nested
from butterfly.identification.inference.term_choice import TermChoice, choose_terms

SCANNED = "stribeck"
"""The term whose velocity is tried."""


class Equations(Protocol):
    """What gives the equations of a method with any terms."""

    @property
    def always(self) -> tuple[str, ...]:
        """Names of the parameters that are fitted with any terms."""

    @property
    def speeds(self) -> Sequence[float]:
        """Stribeck velocities in rad/s to try; none where that friction is known."""

    def with_terms(self, terms: tuple[str, ...], speed: float | None) -> Nested:
        """Return the equations with terms besides what is always fitted.

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
            free = choose_terms([*_fits(equations, tried)], always=equations.always)
            return cls(chosen=free, free=free)
        rest = tuple(name for name in told if name != SCANNED)
        with_it = SCANNED in told
        fits = [*_fits(equations, rest, plain=not with_it, scanned=with_it)]
        chosen = choose_terms(fits, always=equations.always, demanded=told)
        if not check:
            return cls(chosen=chosen, free=None)
        every = [*_fits(equations, tried, scanned=scan)]
        return cls(chosen=chosen, free=choose_terms(every, always=equations.always))


def _fits(
    equations: Equations, names: tuple[str, ...], *, plain: bool = True, scanned: bool = True
) -> Iterator[Nested]:
    """Yield the equations without Stribeck friction, and with it at one velocity after another."""
    if plain:
        yield equations.with_terms(names, None)
    if scanned:
        for speed in equations.speeds:
            nested = equations.with_terms((*names, SCANNED), speed)
            yield replace(nested, demanded=(SCANNED,), settings={"stribeck_velocity": speed})
