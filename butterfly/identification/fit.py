"""Nonlinear least squares over many logs, within bounds and a trust region, and where it ends.

The sums J^T J and J^T r are all that a step needs. Steps are scaled by their effect on the
residuals, so that the units of the values do not matter. Each is the least-squares step within
bounds and a box, the trust region, whose size follows from actual over predicted decrease (Nocedal
& Wright, Numerical Optimization, 2nd ed. 2006, chapters 4 and 10). SciPy's `least_squares` expands
the cost two to ten times as often, as it verifies the last step too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from butterfly.arrays import ROUNDING, Samples, SavedSamples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.linearisation import Linearisation
from butterfly.identification.scatter import Scatter
from butterfly.identification.stagewise import is_near
from butterfly.identification.trust import SHOWS, Ending, Finding, FindingKind
from butterfly.logs.log import Log
from butterfly.model.parameters import value_if_absent
from butterfly.model.terms import PARAMETERS
from butterfly.progress import current_search

MOST = 60
"""Largest number of iterations; one that goes on has not converged."""

PASSES = 12
"""The same of an iteration that begins near its solution."""

CONVERGED = 0.01
"""Share of the cost that no further step of a fit that converged is predicted to take off."""

_NEARER = 0.9  # largest share of the way to a value that is never reached, in one step

_LAST = 1e-4  # share of the cost that an unverified last step may be predicted to take off
_REMAINDER = 0.1  # share of one residual's mean cost that it may leave
_POOR, _GOOD, _BETTER = 0.25, 0.75, 1.33  # shares of the predicted decrease


class LackedTerm(NamedTuple):
    """A significant term that a fit lacks."""

    name: str
    share: float  # of the squared errors that it explains
    shares: Samples  # (k,) the same of each log
    values: Mapping[str, float]  # of a fit with it, by name


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Where a fit of n values ended, and what speaks for others."""

    linearisation: Linearisation  # about the values there, by the last expansion
    ending: Ending = Ending.CONVERGED  # converged if no further decrease is predicted
    unsettled: Samples | None = None  # (n,) last or next step of the values, if it was stopped
    bread: Samples | None = None  # (n, n) derivatives of the gradient, of a robust loss
    evaluations: int = 0  # how often the cost was expanded
    scatter: Scatter | None = None  # by which the linearisation weighs logs, if it does
    unweighed: Linearisation | None = None  # where the fit of plain logs ended, then
    rivals: tuple[Mapping[str, float], ...] = ()  # values, by name, that follow the logs as well
    findings: tuple[Finding, ...] = ()
    path: tuple[tuple[str, ...], ...] = ()  # terms after each round of their choice
    missing: tuple[LackedTerm, ...] = ()  # the best, then those that explain the logs as well

    @property
    def values(self) -> Samples:
        """(n,) where it ended."""
        return self.linearisation.values

    @property
    def named(self) -> dict[str, float]:
        """The values by name."""
        return self.linearisation.named

    @property
    def cost(self) -> float:
        """Half the squared errors, and the penalty of what is known."""
        return self.linearisation.cost

    @property
    def converged(self) -> bool:
        """Whether no further decrease is predicted."""
        return self.ending is Ending.CONVERGED

    @property
    def scatters(self) -> bool:
        """Whether friction or gain differ from log to log by more than chance."""
        return any(finding.kind is FindingKind.SCATTER for finding in self.findings)

    @property
    def plain(self) -> Fit:
        """The fit before its logs were weighted."""
        if self.unweighed is None:
            return self
        return replace(self, linearisation=self.unweighed, unweighed=None, scatter=None)


Expand = Callable[[Samples, Linearisation], Linearisation]
"""From (n,) values, and the equations that a step leads from, to the equations about them."""


class Box(NamedTuple):
    """Bounds of values and of their steps."""

    lower: Samples  # (n,) lower bounds
    share: Samples | float = np.inf  # (n,) largest relative change in one step
    # (n,) limits that values never reach: a step covers at most nine tenths of the distance
    origin: Samples | float = -np.inf

    def about(self, values: Samples, most: Samples | float) -> tuple[Samples, Samples]:
        """Return the (n,) lower and upper limits of a step from values, at most ``most``."""
        with np.errstate(invalid="ignore"):
            room = np.fmin(most, self.share * abs(values))
        least = np.maximum(self.lower - values, -_NEARER * (values - self.origin))
        return np.maximum(least, -room), np.broadcast_to(room, values.shape)


def minimise(
    expand: Expand,
    at: Linearisation,
    box: Box,
    most: int = MOST,
    enough: float = ROUNDING,
    *,
    steps: float = np.inf,
) -> Fit:
    """Descend from equations about the (n,) first values to a minimum, in ``most`` expansions.

    Those take no more than so many ``steps`` of simulations, the last one aside.
    Where the cost curves more along a step than its derivatives predict, the next one is shorter by
    as much. Once predictions are right and decrease fast, the last step is taken without expanding
    the cost there; the descent ends before, where a step predicts or takes no more than a share
    ``enough`` of the cost. Where the trust region has shrunk, it has converged only if no step out
    of it predicts a decrease. IdentifiabilityError if the first equations are not finite.
    """
    if not at.is_finite:
        raise IdentifiabilityError(
            "the simulation diverges at the initial parameters of the fit, so they are not those "
            "of a joint"
        )
    size, evaluations, taken = np.sqrt(np.diag(at.curvature)), 0, 0
    unit = np.where(size > 0, 1 / np.where(size > 0, size, 1.0), np.maximum(abs(at.values), SHOWS))
    radius = max(float(np.linalg.norm(at.values / unit)), 1.0)
    rho, last, bends, search = 0.0, np.inf, 1.0, current_search()  # rho: actual over predicted
    while evaluations < most and last > enough * at.cost and not search.over and taken < steps:
        whole = at.step(*box.about(at.values, radius * unit))
        step, of_whole = whole / bends, at.decrease(whole)
        longest = float(abs(whole / unit).max())
        there = np.maximum(at.values + step, box.lower)
        within = longest < (1 - ROUNDING) * radius
        if within and (_is_last(at, of_whole, last, rho, bends) or longest < ROUNDING):
            end = replace(at.moved(there - at.values), values=there)
            return Fit(linearisation=end, evaluations=evaluations)
        if (within and of_whole <= enough * at.cost) or (not within and radius < ROUNDING):
            break
        tried = replace(expand(there, at), prior=at.prior)
        evaluations += 1
        taken += tried.steps
        predicted, longest = at.decrease(step), longest / bends
        rho = (at.cost - tried.cost) / predicted if tried.is_finite else -np.inf
        if rho > _POOR:
            bends = max(1.0, 1 + (1 - rho) * predicted / (0.5 * float(step @ at.curvature @ step)))
        if rho < _POOR:
            radius = _POOR * longest
        elif rho > _GOOD and longest >= (1 - ROUNDING) * radius:
            radius *= 2
        if rho > 0:
            last = at.cost - tried.cost
            at = tried
    predicted = at.decrease(at.step(*box.about(at.values, np.inf)))
    converged = (
        evaluations < most and taken < steps and predicted <= max(enough, CONVERGED) * at.cost
    )
    ending = Ending.CONVERGED if converged else Ending.STOPPED
    return Fit(linearisation=at, ending=ending, evaluations=evaluations)


def _is_last(at: Linearisation, predicted: float, last: float, rho: float, bends: float) -> bool:
    """Whether a step's predicted decrease is so small that the cost after it is not verified."""
    remainder = _REMAINDER * at.cost * last / at.residuals.size
    small = predicted <= _LAST * at.cost and predicted**2 < remainder
    # a shortened step leaves a share of what the whole one predicts
    sure = predicted * (bends - 1) ** 2 <= _LAST**2 * at.cost
    return (_GOOD < rho < _BETTER and small and sure) or predicted <= ROUNDING * at.cost


@dataclass(frozen=True, kw_only=True, eq=False)
class MissingTerms:
    """Terms that are not fitted and that improve the prediction of held-out logs."""

    terms: tuple[str, ...] = ()
    others: tuple[tuple[str, ...], ...] = ()  # sets of as many that predict as well
    share: float = 0.0  # of the squared residuals that they explain
    shares: Mapping[str, float] = field(default_factory=dict)  # the same of each log, by its name
    moved: tuple[str, ...] = ()  # parameters that they move by more than their intervals allow
    rival: SavedSamples | None = None  # (n,) values with them, if they move any so far

    @classmethod
    def of(
        cls,
        missing: Sequence[LackedTerm],
        here: Mapping[str, float],
        half: Samples,
        logs: Sequence[Log],
    ) -> MissingTerms:
        """Return what a choice from n values found to be missing.

        ``here``: the values, by name, with (n,) half-widths.
        """
        if not missing:
            return cls()
        best, *others = missing
        there = {name: best.values.get(name, value_if_absent(name)) for name in here}
        far = np.abs(np.subtract([*there.values()], [*here.values()])) > half
        moved = tuple(n for n, is_far in zip(here, far, strict=True) if is_far and n in PARAMETERS)
        near = is_near(there, here, [log.added_mass for log in logs])
        return cls(
            terms=(best.name,),
            others=tuple((term.name,) for term in others),
            share=best.share,
            shares=dict(zip((log.name for log in logs), best.shares.tolist(), strict=True)),
            moved=moved,
            rival=np.array([*there.values()]) if moved and near else None,
        )

    @property
    def names(self) -> str:
        """Names of the terms and of their alternatives."""
        return " or ".join(" + ".join(terms) for terms in (self.terms, *self.others) if terms)

    @property
    def findings(self) -> list[Finding]:
        """The finding that names them, and the parameters that they move; none without terms."""
        if not self.terms:
            return []
        return [Finding(FindingKind.MISSING_TERM, (self.names, *self.moved), number=self.share)]
